"""Parameters of nodes: declared with what they are, read in the type that they need, or refused with a reason."""

from array import array

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.parameter import Parameter

from robot_dynamics.errors import InvalidInputError, RobotDynamicsError


def declare_parameters(node, parameters):
    """Declare parameters {name: (default, what it is)} of a node. They are typed below, not by rclpy: an integer where
    a decimal number belongs is no reason to refuse.

    rcl reads `[]` in a parameter file, and behind -p, as a parameter without type and value. Nothing else does that, so
    the empty list is put back: `ros2 param dump` would write `null` otherwise, which rcl reads as the text 'null'.
    """
    for name, (default, description) in parameters.items():
        descriptor = ParameterDescriptor(description=description, dynamic_typing=True)
        if node.declare_parameter(name, default, descriptor).type_ == Parameter.Type.NOT_SET:
            node.set_parameters([Parameter(name, value=[])])


def try_parameter_change(change):
    """The SetParametersResult of a change that is tried: refused with the reason where it raises one."""
    try:
        change()
    except RobotDynamicsError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


def to_python_value(name, value):
    """The value of a parameter with lists as Python lists, for rclpy gives lists of numbers as array.array.

    Raises QuestionError where there is no value, which is how a client of the node removes a parameter.
    """
    if value is None:
        raise InvalidInputError(f"parameter {name} is read by this node and cannot be removed")
    return list(value) if isinstance(value, tuple | array) else value


def convert_parameter(default, name, value, description):
    """The value of a parameter in the type, and of a list in the length, of `default`. Raises QuestionError."""
    value = to_python_value(name, value)
    if isinstance(default, str | bool):
        if isinstance(value, type(default)):
            return value
        raise InvalidInputError(
            f"parameter {name} is {value!r}: {'a text' if isinstance(default, str) else 'true or false'} is needed"
        )
    size = np.size(default)
    try:
        found = np.array(value, dtype=float)
    except (TypeError, ValueError):
        found = np.array("none")
    texts = any(isinstance(item, str | bool) for item in (value if isinstance(value, list) else [value]))
    if found.dtype.kind != "f" or texts or found.shape != np.shape(default):
        need = "a number is" if isinstance(default, float) else f"{size} numbers are"
        raise InvalidInputError(f"parameter {name} is {value!r}: {need} needed, {description}")
    return found.tolist()


def as_list(value):
    """The list that the value of a parameter is: of one where it is no list, of none where it is an empty text."""
    return [] if isinstance(value, str) and not value else np.ravel(value).tolist()


def parse_names(name, value):
    """The names (a tuple) that the value of a parameter is a list of. Raises QuestionError."""
    values = as_list(to_python_value(name, value))
    if not all(isinstance(item, str) and item for item in values):
        raise InvalidInputError(f"parameter {name} is {to_python_value(name, value)!r}: a list of names is needed")
    return tuple(values)


def parse_numbers(name, value, description):
    """The numbers (a list), as many as there are, that the value of a parameter is. Raises QuestionError."""
    values = as_list(to_python_value(name, value))
    return convert_parameter([0.0] * len(values), name, values, description)


def parse_integer(name, value, least):
    """The value of a parameter that counts something. Raises QuestionError."""
    value = to_python_value(name, value)
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise InvalidInputError(f"parameter {name} is {value!r}: a whole number from {least} on is needed")
    return value
