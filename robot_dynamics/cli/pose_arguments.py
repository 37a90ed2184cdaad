"""Coordinates and joint positions on the command line: NAME=VALUE,... and NAME:FROM:TO:COUNT,..."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError, describe_unknown_name
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.plots.colour_scale import ColourScale

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

MAX_GRID_POINTS = 2000  # values of one coordinate
PLATFORM_COORDINATE = "coordinate of a platform"
COUNT_WORDS = {1: "one", 2: "two"}


def parse_assignments(
    option: str, text: str | None, names: Sequence[str] = COORDINATES, kind: str = PLATFORM_COORDINATE
) -> dict[str, float]:
    """Parse values by name, such as `z=0.8,roll=0.1`.

    names: names that are allowed; kind: term for them in messages. Raises InvalidInputError.
    """
    values = {}
    for part in filter(None, (text or "").split(",")):
        name, _, value = part.partition("=")
        number = _parse_number(value)
        if number is None:
            raise InvalidInputError(
                f"{option} {part}: NAME=VALUE with a finite number is needed, such as {names[0]}=0.8"
            )
        values[_parse_name(option, name, names, kind)] = number
    return values


def parse_grid(option: str, text: str, counts: Sequence[int] = (1, 2)) -> dict[str, Array]:
    """Parse the values of grid coordinates, such as `x:-0.1:0.1:41,z:0.7:0.9:41`.

    counts: allowed numbers of coordinates. Raises InvalidInputError.
    """
    axes: dict[str, Array] = {}
    parts = text.split(",")
    for part in parts:
        name, *numbers = part.split(":")
        if len(numbers) != 3:
            raise InvalidInputError(f"{option} {part}: NAME:FROM:TO:COUNT is needed, such as x:-0.1:0.1:41")
        first, last = map(_parse_number, numbers[:2])
        count = int(numbers[2]) if numbers[2].strip().isdecimal() else 0
        if first is None or last is None or first >= last or not 2 <= count <= MAX_GRID_POINTS:
            raise InvalidInputError(
                f"{option} {part}: a grid goes from a number to a larger one in 2 to {MAX_GRID_POINTS} values, such as "
                "x:-0.1:0.1:41"
            )
        axes[_parse_name(option, name, COORDINATES, PLATFORM_COORDINATE)] = np.linspace(first, last, count)
    if len(parts) not in counts or len(axes) != len(parts):
        allowed = " or ".join(COUNT_WORDS[count] for count in counts)
        raise InvalidInputError(f"{option} {text}: {allowed} coordinates vary in a map, each once")
    return axes


def parse_scale(option: str, text: str | None) -> ColourScale | None:
    """Parse the colour scale of a map, such as `0:50`; None where there is no text. Raises InvalidInputError."""
    if text is None:
        return None
    ends = [_parse_number(part) for part in text.split(":")]
    numbers = [number for number in ends if number is not None]
    if len(ends) != 2 or len(numbers) != 2 or not 0 <= numbers[0] < numbers[1]:
        raise InvalidInputError(f"{option} {text}: LOW:HIGH is needed, zero or more, and the larger number last: 0:50")
    return ColourScale(*numbers)


def _parse_name(option: str, text: str, names: Sequence[str], kind: str) -> str:
    name = text.strip()
    if name not in names:
        raise InvalidInputError(f"{option}: {describe_unknown_name(kind, name, names)}")
    return name


def _parse_number(text: str) -> float | None:
    """Parse a finite number; None if the text is not one."""
    try:
        number = float(text)
    except ValueError:
        return None
    return number if np.isfinite(number) else None
