"""Plays scripts of events to the law in C++, by the program `player` of the build."""

import os
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np

BUILD = Path(os.environ["CONTROL_BUILD"])
NO_REFERENCE = ("", "none yet", "ended", "timed out", "dropped")
POINT_RESULTS = ("accepted", "wrong size", "not finite", "too old", "beyond limits")


class Sent(NamedTuple):
    """Efforts, empty where a tick found no fault, and why they are what they are."""

    efforts: np.ndarray
    activity: str
    fault: str
    no_reference: str
    saturated: tuple
    stalls: int


class Script:
    """Commands for the player, and after `play` the results of those that have one."""

    def __init__(self):
        self.lines = []

    def add(self, command, *values):
        """Add a command with numbers, arrays or words."""
        words = [command]
        for value in values:
            words += [value] if isinstance(value, str) else [repr(float(number)) for number in np.ravel(value)]
        self.lines.append(" ".join(words))

    def play(self, module, sanitized=False):
        """Results, in order: Sent for efforts, words for other commands."""
        player = BUILD / ("player_sanitized" if sanitized else "player")
        command = [str(player), str(BUILD / "modules" / f"lib{module}_module.so")]
        done = subprocess.run(command, input="\n".join(self.lines), capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr[-3000:]
        return [_result(line) for line in done.stdout.splitlines()]


def _result(line):
    fields = line.split("\t")
    if len(fields) == 1:
        return line.split()
    efforts, activity, fault, no_reference, saturated, stalls = fields
    return Sent(
        np.array(efforts.split(), dtype=float),
        activity,
        fault,
        NO_REFERENCE[int(no_reference)],
        tuple(digit == "1" for digit in saturated),
        int(stalls),
    )
