"""Parameters of nodes as data: from a ParameterSpec come the declaration, the validation and the tables of the docs."""

import re
from array import array
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, Literal, TypeAlias

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from robot_dynamics.errors import InvalidInputError, RobotDynamicsError, describe_unknown_name

ReadAt: TypeAlias = Literal["startup", "configuration", "runtime"]
ListKind: TypeAlias = Literal["names", "numbers"]
ParameterValues: TypeAlias = dict[str, Any]
"""Validated values by name; the type of each value is that of its specification."""

UNIT = re.compile(r"\[([^\]]+)\]")


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter of a node.

    Attributes
    ----------
    name : of the parameter.
    default : its type is that of the values: text, truth value, integer, number, or list of as many numbers. For a
        list of any length it is an empty text, or a list, and `list_kind` says what the entries are.
    description : text of the descriptor, with the unit in brackets.
    list_kind : what the entries of a list of any length are; None for other parameters.
    size : number of entries that such a list has if it is not empty; None: any.
    lower_bound : smallest accepted number, or entry of a list; None: any number, also nan and inf.
    is_bound_excluded : whether `lower_bound` itself is refused.
    upper_bound : values from here on are refused, where there is a lower bound; None: also inf is accepted.
    special_values : numbers that are accepted besides the range, for example 0 for "off".
    choices : accepted texts; empty: any.
    read_at : when the node reads it. "startup": a change is refused. "configuration": it takes effect when the node is
        configured, or when robot, simulation or check are built again. "runtime": a change takes effect at once.
    """

    name: str
    default: bool | int | float | str | list[float]
    description: str
    list_kind: ListKind | None = None
    size: int | None = None
    lower_bound: float | None = None
    is_bound_excluded: bool = False
    upper_bound: float | None = inf
    special_values: tuple[float, ...] = ()
    choices: tuple[str, ...] = ()
    read_at: ReadAt = "runtime"

    @property
    def unit(self) -> str:
        """Unit in the description, empty if it has none."""
        match = UNIT.search(self.description)
        return match[1] if match else ""

    @property
    def accepted_range(self) -> str:
        """The accepted numbers as words, empty if any number is accepted."""
        if self.lower_bound is None:
            return ""
        lowest = f"more than {self.lower_bound:g}" if self.is_bound_excluded else f"{self.lower_bound:g} or more"
        special = "".join(f"{value:g}, or " for value in self.special_values)
        end = f", and less than {self.upper_bound:g}," if self.upper_bound not in (None, inf) else ""
        return f"{special}{lowest}{end}"

    def validate(self, value: object) -> Any:
        """Return a value in the type of the parameter. Raises InvalidInputError with the accepted values."""
        if self.list_kind == "names":
            return parse_names(self.name, value)
        if self.list_kind == "numbers":
            return self._validate_numbers(value)
        if isinstance(self.default, int) and not isinstance(self.default, bool):
            return parse_integer(self.name, value, least=int(self.lower_bound or 0))
        converted = convert_parameter(self.default, self.name, value, self.description)
        if isinstance(converted, float) and not self._is_accepted(converted):
            raise InvalidInputError(
                f"parameter {self.name} is {converted:g}: {self.accepted_range} is needed, {self.description}"
            )
        if self.choices and converted not in self.choices:
            raise InvalidInputError(f"parameter {self.name}: {describe_unknown_name('value', converted, self.choices)}")
        return converted

    def _validate_numbers(self, value: object) -> list[float]:
        if self.size is not None:
            values = to_python_value(self.name, value)
            if np.size(values) == 0 or values == "":
                return []
            return convert_parameter([0.0] * self.size, self.name, values, self.description)
        numbers = parse_numbers(self.name, value, self.description)
        if not all(map(self._is_accepted, numbers)):
            raise InvalidInputError(
                f"parameter {self.name} is {numbers}: numbers of {self.accepted_range} are needed, {self.description}"
            )
        return numbers

    def _is_accepted(self, number: float) -> bool:
        if self.lower_bound is None or number in self.special_values:
            return True
        if not number >= self.lower_bound or (self.is_bound_excluded and number == self.lower_bound):
            return False
        return self.upper_bound is None or number < self.upper_bound


ParameterSpecs: TypeAlias = Mapping[str, ParameterSpec]


def by_name(*specs: ParameterSpec) -> dict[str, ParameterSpec]:
    """Return specifications by the name of the parameter, in the same order."""
    return {spec.name: spec for spec in specs}


def declare_parameters(node: Node, specs: ParameterSpecs) -> None:
    """Declare the parameters of a node.

    The types are checked by `validate`, not by rclpy, which would refuse an integer for a decimal number.

    rcl reads `[]` in a parameter file, and after -p, as a parameter without type and value. Nothing else has that
    effect, so the empty list is put back: `ros2 param dump` would write `null`, which rcl reads as the text 'null'.
    """
    for spec in specs.values():
        descriptor = ParameterDescriptor(description=spec.description, dynamic_typing=True)
        if node.declare_parameter(spec.name, spec.default, descriptor).type_ == Parameter.Type.NOT_SET:
            node.set_parameters([Parameter(spec.name, value=[])])


def read_parameters(node: Node, specs: ParameterSpecs) -> ParameterValues:
    """Return the validated values of declared parameters. Raises InvalidInputError."""
    return {name: spec.validate(node.get_parameter(name).value) for name, spec in specs.items()}


def validate_changes(specs: ParameterSpecs, parameters: Iterable[Parameter]) -> ParameterValues:
    """Return the validated values of those of the changed parameters that `specs` has. Raises InvalidInputError."""
    return {p.name: specs[p.name].validate(p.value) for p in parameters if p.name in specs}


def refuse_startup_changes(specs: ParameterSpecs, parameters: Iterable[Parameter]) -> None:
    """Raise InvalidInputError if one of the changed parameters is read at startup."""
    for parameter in parameters:
        if parameter.name in specs and specs[parameter.name].read_at == "startup":
            raise InvalidInputError(f"parameter {parameter.name} is read at startup: restart the node to change it")


def try_parameter_change(change: Callable[[], object]) -> SetParametersResult:
    """Try a change, and return the result: refused with the message of a RobotDynamicsError, else successful."""
    try:
        change()
    except RobotDynamicsError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


def to_python_value(name: str, value: object) -> Any:
    """Return the value of a parameter with lists as Python lists: rclpy returns lists of numbers as array.array.

    Raises InvalidInputError for None, which is how a client of the node removes a parameter.
    """
    if value is None:
        raise InvalidInputError(f"parameter {name} is read by this node and cannot be removed")
    return list(value) if isinstance(value, tuple | array) else value


def convert_parameter(default: bool | float | str | list[float], name: str, value: object, description: str) -> Any:
    """Return a value in the type, and if it is a list in the length, of `default`. Raises InvalidInputError."""
    value = to_python_value(name, value)
    if isinstance(default, str | bool):
        if isinstance(value, type(default)):
            return value
        needed = "a text" if isinstance(default, str) else "true or false"
        raise InvalidInputError(f"parameter {name} is {value!r}: {needed} is needed")
    try:
        numbers = np.array(value, dtype=float)
    except (TypeError, ValueError):
        numbers = None
    entries = value if isinstance(value, list) else [value]
    has_other_types = any(isinstance(entry, str | bool) for entry in entries)
    if numbers is None or has_other_types or numbers.shape != np.shape(default):
        needed = "a number is" if isinstance(default, float) else f"{np.size(default)} numbers are"
        raise InvalidInputError(f"parameter {name} is {value!r}: {needed} needed, {description}")
    return numbers.tolist()


def as_list(value: object) -> list[Any]:
    """Return the entries of the value of a parameter: one if it is no list, none if it is an empty text."""
    entries: list[Any] = [] if isinstance(value, str) and not value else np.ravel(np.asarray(value)).tolist()
    return entries


def parse_names(name: str, value: object) -> tuple[str, ...]:
    """Return the names in the value of a parameter. Raises InvalidInputError."""
    value = to_python_value(name, value)
    entries = as_list(value)
    if not all(isinstance(entry, str) and entry for entry in entries):
        raise InvalidInputError(f"parameter {name} is {value!r}: a list of names is needed")
    return tuple(entries)


def parse_numbers(name: str, value: object, description: str) -> list[float]:
    """Return the numbers in the value of a parameter, as many as it has. Raises InvalidInputError."""
    entries = as_list(to_python_value(name, value))
    numbers: list[float] = convert_parameter([0.0] * len(entries), name, entries, description)
    return numbers


def parse_integer(name: str, value: object, least: int) -> int:
    """Return the value of an integer parameter, `least` or more. Raises InvalidInputError."""
    value = to_python_value(name, value)
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise InvalidInputError(f"parameter {name} is {value!r}: a whole number from {least} on is needed")
    return value
