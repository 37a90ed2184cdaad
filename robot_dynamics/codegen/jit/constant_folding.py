"""What is known of a program before a call: its constants, its parameters, and what follows from them."""

import functools
import math
import operator

from robot_dynamics.codegen.emit.code_text import FUNCTIONS, INFIX
from robot_dynamics.codegen.emit.python_source import HELPERS
from robot_dynamics.codegen.trace.program import constant_values
from robot_dynamics.codegen.trace.scalar import PARAMETER
from robot_dynamics.errors import InvalidInputError


def fold_constants(program, parameters=None):
    """{node: float} of constants, of parameters {name: value} and of the setup; NaN and infinities as they come.

    Raises QuestionError where a parameter has no value; more than the program's may be among them.
    """
    parameters = parameters or {}
    missing = [name for name in program.parameters if name not in parameters]
    if missing:
        raise InvalidInputError(f"{program.name} needs a value for {', '.join(map(repr, missing[:40]))}")
    values, operations = constant_values(program), _careful_operations()
    for number, operation, operands in program.leaves:
        if operation == PARAMETER:
            values[number] = float(parameters[operands[0]])
    for number, operation, operands in program.setup:
        values[number] = operations[operation](*(values[operand] for operand in operands))
    return values


@functools.cache
def _careful_operations():
    """{operation: function} with the results of compiled code, never an exception."""
    scope = {"math": math}
    exec("\n".join(HELPERS.values()), scope)
    operations = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": scope["divide"]}
    found = {operation: operations[sign] for operation, sign in INFIX.items()}
    return found | {operation: scope[name] for operation, name in FUNCTIONS.items()}
