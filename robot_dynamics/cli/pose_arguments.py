"""Coordinates of platforms and positions of joints as verbs take them: NAME=VALUE,... and NAME:FROM:TO:COUNT,..."""

import numpy as np

from robot_dynamics.errors import InvalidInputError, describe_unknown_name
from robot_dynamics.model.platform import COORDINATES

MAX_GRID_POINTS = 2000  # values of one coordinate
PLATFORM_COORDINATE = "coordinate of a platform"


def parse_assignments(option, text, known=COORDINATES, kind=PLATFORM_COORDINATE):
    """{name: value} of `z=0.8,roll=0.1`; names are among those that are known. Raises QuestionError."""
    values = {}
    for part in filter(None, (text or "").split(",")):
        name, _, value = part.partition("=")
        number = _number(value)
        if number is None:
            raise InvalidInputError(
                f"{option} {part}: NAME=VALUE with a finite number is needed, such as {known[0]}=0.8"
            )
        values[_known(option, name, known, kind)] = number
    return values


def parse_grid(option, text, counts=(1, 2)):
    """{coordinate: values} of `x:-0.1:0.1:41,z:0.7:0.9:41`, as many as `counts` allows. Raises QuestionError."""
    axes, parts = {}, text.split(",")
    for part in parts:
        name, *numbers = part.split(":")
        if len(numbers) != 3:
            raise InvalidInputError(f"{option} {part}: NAME:FROM:TO:COUNT is needed, such as x:-0.1:0.1:41")
        first, last = map(_number, numbers[:2])
        count = int(numbers[2]) if numbers[2].strip().isdecimal() else 0
        if first is None or last is None or first >= last or not 2 <= count <= MAX_GRID_POINTS:
            raise InvalidInputError(
                f"{option} {part}: a grid goes from a number to a larger one in 2 to {MAX_GRID_POINTS} values, as x:-0.1:0.1:41 "
                "does"
            )
        axes[_known(option, name, COORDINATES, PLATFORM_COORDINATE)] = np.linspace(first, last, count)
    if len(parts) not in counts or len(axes) != len(parts):
        many = " or ".join({1: "one", 2: "two"}[count] for count in counts)
        raise InvalidInputError(f"{option} {text}: {many} coordinates vary in a map, each once")
    return axes


def _known(option, name, known, kind):
    name = name.strip()
    if name not in known:
        raise InvalidInputError(f"{option}: {describe_unknown_name(kind, name, known)}")
    return name


def _number(text):
    """The finite number that a text is, None where it is none."""
    try:
        number = float(text)
    except ValueError:
        return None
    return number if np.isfinite(number) else None
