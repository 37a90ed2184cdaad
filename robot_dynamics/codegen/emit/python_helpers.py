"""Python source of operations that return NaN or infinities, as compiled code does, where `math` raises exceptions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_dynamics.codegen.trace.scalar import COSINE, DIVIDE, SIGN, SINE, SQUARE_ROOT

if TYPE_CHECKING:
    from robot_dynamics.codegen.trace.scalar import Operation

HELPERS: dict[Operation, str] = {
    SINE: '''
def sin(x):
    """The sine, NaN of an infinity."""
    return math.sin(x) if math.isfinite(x) else math.nan
''',
    COSINE: '''
def cos(x):
    """The cosine, NaN of an infinity."""
    return math.cos(x) if math.isfinite(x) else math.nan
''',
    SQUARE_ROOT: '''
def sqrt(x):
    """The square root, NaN of a negative number."""
    return math.sqrt(x) if x >= 0 else math.nan
''',
    SIGN: '''
def sign(x):
    """1, -1 or 0; NaN of NaN."""
    return 1.0 if x > 0 else -1.0 if x < 0 else x + 0.0
''',
    DIVIDE: '''
def divide(x, y):
    """x / y, also for y = 0."""
    if y == 0:
        return math.nan if x == 0 or x != x else math.copysign(math.inf, x) * math.copysign(1.0, y)
    return x / y
''',
}
