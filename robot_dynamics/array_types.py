"""Aliases for array types.

A type states the kind of the entries. The docstring of a function states the shape: ``(..., n)`` is n entries after any
batch axes.
"""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Array", "ArrayLike", "BoolArray", "ByteArray", "IntArray", "ScalarArray"]

Array: TypeAlias = NDArray[np.float64]
"""Floating-point numbers."""

BoolArray: TypeAlias = NDArray[np.bool_]
"""Truth values."""

ByteArray: TypeAlias = NDArray[np.uint8]
"""Bytes."""

IntArray: TypeAlias = NDArray[np.intp]
"""Indices."""

ScalarArray: TypeAlias = NDArray[Any]
"""Numbers, or the symbols of a trace (dtype object), as the recursions over generic scalars use them."""
