"""ROS messages from the YAML of a command line, and back."""

import array
import importlib
from typing import Any

import numpy as np
from rosidl_parser.definition import AbstractSequence, NamespacedType


def interface_type(name: str) -> Any:
    """The class of an interface: `std_msgs/msg/String`, `std_srvs/srv/Trigger`."""
    package, folder, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.{folder}"), kind)


def fill(message: Any, values: dict[str, Any]) -> Any:
    """Put nested dicts and lists into a message, as the command line of ROS 2 does."""
    for field, kind in zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True):
        if field in values:
            setattr(message, field, filled(kind, values[field], getattr(message, field)))
    unknown = set(values) - set(message.get_fields_and_field_types())
    assert not unknown, f"{type(message).__name__} has no field {', '.join(sorted(unknown))}"
    return message


def filled(kind: Any, value: Any, present: Any) -> Any:
    """A value of YAML as the type of a field; `present` has the type of a basic field."""
    if isinstance(kind, AbstractSequence):
        return [filled(kind.value_type, item, 0.0) for item in value]
    if isinstance(kind, NamespacedType):
        return fill(interface_type(f"{'/'.join(kind.namespaces)}/{kind.name}")(), value)
    return type(present)(value) if isinstance(value, int) and not isinstance(value, bool) else value


def plain(value: Any) -> Any:
    """A message as dicts, lists and numbers."""
    if hasattr(value, "get_fields_and_field_types"):
        return {field: plain(getattr(value, field)) for field in value.get_fields_and_field_types()}
    if isinstance(value, list | tuple | array.array | np.ndarray):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value
