"""Parameters of nodes: declared with what they are, read in the type that they need, or refused with a reason."""

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult

from robot_dynamics.errors import QuestionError, RobotDynamicsError


def declare(node, parameters):
    """Declare parameters {name: (default, what it is)} of a node. They are typed below, not by rclpy: an integer where
    a decimal number belongs is no reason to refuse."""
    for name, (default, description) in parameters.items():
        node.declare_parameter(name, default, ParameterDescriptor(description=description, dynamic_typing=True))


def judged(change):
    """The SetParametersResult of a change that is tried: refused with the reason where it raises one."""
    try:
        change()
    except RobotDynamicsError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


def typed_as(default, name, value, description):
    """The value of a parameter in the type, and of a list in the length, of `default`. Raises QuestionError."""
    if isinstance(default, str | bool):
        if isinstance(value, type(default)):
            return value
        raise QuestionError(
            f"parameter {name} is {value!r}: {'a text' if isinstance(default, str) else 'true or false'} is needed"
        )
    size = np.size(default)
    try:
        found = np.array(value, dtype=float)
    except (TypeError, ValueError):
        found = np.array("none")
    texts = any(isinstance(item, str | bool) for item in (value if isinstance(value, list | tuple) else [value]))
    if found.dtype.kind != "f" or texts or found.shape != np.shape(default):
        need = "a number is" if isinstance(default, float) else f"{size} numbers are"
        raise QuestionError(f"parameter {name} is {value!r}: {need} needed, {description}")
    return found.tolist()


def listed(value):
    """The list that the value of a parameter is: of one where it is no list, of none where it is an empty text."""
    return [] if isinstance(value, str) and not value else np.ravel(value).tolist()


def names(name, value):
    """The names (a tuple) that the value of a parameter is a list of. Raises QuestionError."""
    values = listed(value)
    if not all(isinstance(item, str) and item for item in values):
        raise QuestionError(f"parameter {name} is {value!r}: a list of names is needed")
    return tuple(values)


def numbers(name, value, description):
    """The numbers (a list), as many as there are, that the value of a parameter is. Raises QuestionError."""
    values = listed(value)
    return typed_as([0.0] * len(values), name, values, description)


def whole_number(name, value, least):
    """The value of a parameter that counts something. Raises QuestionError."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise QuestionError(f"parameter {name} is {value!r}: a whole number from {least} on is needed")
    return value
