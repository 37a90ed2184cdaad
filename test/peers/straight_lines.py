"""Straight-line programs by their meaning: an interpreter independent of the emitters, and random programs for it."""

import math

import numpy as np
from hypothesis import strategies as st

from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace

SPECIAL = [0.0, -0.0, 1.0, -1.0, 5e-324, 1e308, -1e308, math.inf, -math.inf, math.nan]
NUMBERS = st.one_of(st.sampled_from(SPECIAL), st.floats(-10, 10))


def finite_only(function):
    return lambda x: function(x) if math.isfinite(x) else math.nan


def interpreted(program, inputs, parameters=None):
    """The outputs of a program as flat lists, by the meaning of its statements; entries may be arrays of samples."""
    rules = {"add": np.add, "subtract": np.subtract, "multiply": np.multiply, "divide": np.divide}
    rules |= {name: getattr(np, name) for name in ("sin", "cos", "sqrt", "sign")}
    if all(np.ndim(value) == 0 for values in inputs.values() for value in values):  # of one sample, not NumPy's own
        rules |= {name: finite_only(getattr(math, name)) for name in ("sin", "cos")}
    values = {}
    for number, kind, operands in program.leaves:
        if kind == "input":
            values[number] = np.float64(inputs[operands[0]][operands[1]])
        else:
            values[number] = np.float64(operands[0] if kind == "constant" else parameters[operands[0]])
    with np.errstate(all="ignore"):
        for number, operation, operands in program.setup + program.statements:
            values[number] = rules[operation](*(values[operand] for operand in operands))
    return [[sign * values[node] for node, sign in output.entries] for output in program.outputs]


@st.composite
def programs(draw):
    """A program of two inputs and two parameters, and of operations that Scalars have."""
    trace = Trace()
    pool = [*trace.input("x", 3), *trace.input("s_x", 2), *trace.parameters(["gear", "t1"])]
    for _ in range(draw(st.integers(0, 30))):
        a, b = (pool[draw(st.integers(0, len(pool) - 1))] for _ in range(2))
        operation = draw(st.sampled_from("+-*/nscrgk"))
        try:
            match operation:
                case "+" | "-" | "*" | "/":
                    scalar = {"+": a.__add__, "-": a.__sub__, "*": a.__mul__, "/": a.__truediv__}[operation](b)
                case "k":
                    scalar = a * draw(NUMBERS) + draw(NUMBERS)
                case _:
                    scalar = {"n": a.__neg__, "s": a.sin, "c": a.cos, "r": a.sqrt, "g": a.signum}[operation]()
        except (ZeroDivisionError, ValueError):  # operations that are not recorded
            continue
        pool.append(scalar)
    outputs = {"y": np.array(pool[-4:]).reshape(2, 2), "z": pool[len(pool) // 2]}
    return build_program(trace, "random", {"x": 3, "s_x": 2}, outputs)
