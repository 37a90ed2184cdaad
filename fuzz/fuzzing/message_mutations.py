"""Messages of ROS as nested dictionaries (JSON), and their mutations, which keep the types of the fields."""

from __future__ import annotations

import copy
import random
from array import array
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

FLOATS = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-320,
    1e-9,
    1e9,
    1e154,
    1e300,
    -1e308,
    float("inf"),
    float("-inf"),
    float("nan"),
    3.14159,
]
INTEGERS = [0, 1, 2, 3, 255, 2**31 - 1, -(2**31), 2**32 - 1]
TEXTS = [
    "",
    "x",
    "panda_joint1",
    "panda_link8",
    "/",
    "a/b",
    "\x00",
    "é日",
    "x" * 1000,
    "\x1b[2J",
    "a\nb",
    "%s%n",
    "base",
    "nan",
]
MOST_ITEMS = 20_000  # of a list that is repeated
RANGES = {"int32": range(-(2**31), 2**31), "uint32": range(2**32)}  # of integers in the messages that are mutated


def mutate_tree(tree: Any, rng: random.Random) -> Any:
    """Return a copy of nested dictionaries and lists with one to four mutations."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.choice([1, 1, 1, 2, 3, 4])):
        places = list(_places(tree))
        if places:
            _change(*rng.choice(places), rng)
    return tree


def _places(tree: Any, depth: int = 0):
    """Yield (container, key) of all entries, of long lists some."""
    if isinstance(tree, dict):
        items = list(tree.items())
    elif isinstance(tree, list):
        step = max(1, len(tree) // 20)
        items = list(enumerate(tree))[::step]
    else:
        return
    for key, value in items:
        yield tree, key
        yield from _places(value, depth + 1)


def _change(container: Any, key: Any, rng: random.Random) -> None:
    value = container[key]
    kind = rng.random()
    if isinstance(container, list) and kind < 0.15:
        del container[key]
    elif isinstance(container, list) and kind < 0.3:
        container.insert(key, copy.deepcopy(rng.choice(container)))
    elif isinstance(container, list) and kind < 0.4:
        rng.shuffle(container)
    elif isinstance(value, bool):
        container[key] = not value
    elif isinstance(value, int):
        container[key] = rng.choice(INTEGERS) if kind < 0.7 else value + rng.randrange(-3, 4)
    elif isinstance(value, float):
        container[key] = rng.choice(FLOATS) if kind < 0.6 else rng.gauss(value, 1.0)
    elif isinstance(value, str):
        container[key] = rng.choice(TEXTS) if kind < 0.7 else value[: rng.randrange(len(value) + 1)] + rng.choice(TEXTS)
    elif isinstance(value, list):
        change = rng.randrange(4)
        if change == 0:
            container[key] = []
        elif change == 1:
            container[key] = value[: rng.randrange(len(value) + 1)]
        elif change == 2:
            container[key] = (value * rng.choice([2, 3, 100]))[:MOST_ITEMS]
        else:
            container[key] = value[::-1]


def fill_message(message: Any, content: Mapping[str, Any]) -> Any:
    """Set the fields of a message. Raises ValueError where there is no such field, or a value does not fit it."""
    types = message.get_fields_and_field_types()
    for name, value in content.items():
        if name not in types:
            raise ValueError(f"no field {name}")
        try:
            setattr(message, name, _field_value(types[name], getattr(message, name), value))
        except (AssertionError, TypeError, OverflowError, AttributeError) as error:
            raise ValueError(f"{name}: {error}") from None
    return message


def _field_value(type_name: str, present: Any, value: Any) -> Any:
    if isinstance(value, dict):
        return fill_message(present, value)
    if type_name in RANGES and value not in RANGES[type_name]:  # rclpy checks it when it sends the message
        raise ValueError(f"{value} is no {type_name}")
    if not isinstance(value, list):
        return value
    element = type_name.removeprefix("sequence<").removesuffix(">")
    if "/" in element:
        return [fill_message(_message_class(element)(), item) for item in value]
    if element == "double":
        return array("d", value)
    return list(value)


@cache
def _message_class(name: str) -> type:
    package, _, kind = name.partition("/")
    return getattr(import_module(f"{package}.msg"), kind)


def message_content(message: Any) -> Any:
    """The fields of a message as nested dictionaries."""
    if hasattr(message, "get_fields_and_field_types"):
        return {name: message_content(getattr(message, name)) for name in message.get_fields_and_field_types()}
    if isinstance(message, array | np.ndarray | list | tuple):
        return [message_content(item) for item in message]
    return message
