"""Programs evaluated with complex numbers, and their derivatives by complex steps, which lose no digits."""

import numpy as np

from robot_dynamics.codegen.trace.scalar import (
    ADD,
    CONSTANT,
    COSINE,
    DIVIDE,
    INPUT,
    MULTIPLY,
    SIGN,
    SINE,
    SQUARE_ROOT,
    SUBTRACT,
)

STEP = 1e-30

OPERATIONS = {
    ADD: np.add,
    SUBTRACT: np.subtract,
    MULTIPLY: np.multiply,
    DIVIDE: np.divide,
    SINE: np.sin,
    COSINE: np.cos,
    SQUARE_ROOT: np.sqrt,
    SIGN: lambda x: np.sign(np.real(x)),
}


def evaluate(program, inputs):
    """Outputs {name: (N, ...)} of a program at inputs {name: (N, size)}, complex or not."""
    values = {}
    for number, operation, operands in program.leaves:
        if operation == INPUT:
            name, position = operands
            values[number] = inputs[name][:, position]
        else:
            assert operation == CONSTANT, operation
            values[number] = operands[0]
    for number, operation, operands in (*program.setup, *program.statements):
        values[number] = OPERATIONS[operation](*(values[operand] for operand in operands))
    samples = len(next(iter(inputs.values())))
    outputs = {}
    for output in program.outputs:
        entries = [sign * (values[node] + np.zeros(samples)) for node, sign in output.entries]
        outputs[output.name] = np.stack(entries, axis=1).reshape(samples, *output.shape)
    return outputs


def directional_derivatives(program, inputs, directions):
    """Derivatives {output: (..., c)} of a program at one sample {name: (size,)}.

    directions: {name: (size, c)}; inputs without direction are constant.
    """
    columns = next(iter(directions.values())).shape[1]
    moved = {}
    for name, values in inputs.items():
        moved[name] = np.repeat(np.asarray(values, dtype=complex)[None], columns, axis=0)
        if name in directions:
            moved[name] += 1j * STEP * directions[name].T
    with np.errstate(all="ignore"):
        outputs = evaluate(program, moved)
    return {name: np.moveaxis(values.imag / STEP, 0, -1) for name, values in outputs.items()}
