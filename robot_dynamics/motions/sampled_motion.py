"""Motions to be judged: of a recording, filtered, or planned ones in a CSV file with accelerations, as they are."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite, nan
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import make_interp_spline

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.tables import read_column_names

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from robot_dynamics.array_types import Array
    from robot_dynamics.recordings.recording import Recording

KINDS = ("position", "velocity", "acceleration")
MAX_CONTRADICTION = 0.2
"""Part of the changes of a signal by which they may differ from the integral of its rate: coarse samples do."""
SPLINE_DEGREE = 5
"""Of the spline through planned positions: its acceleration has two continuous derivatives."""


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """Samples of a motion of n joints.

    Attributes
    ----------
    times : (N,) [s], ascending.
    q, qd, qdd : (N, n) positions, velocities, accelerations [rad or m, with s].
    weights : (N,) time that each sample stands for [s]: of the trapezoidal rule, in each piece without a gap.
    cutoff : cut-off frequency of the filter [Hz]; None where nothing was filtered.
    """

    times: Array
    q: Array
    qd: Array
    qdd: Array
    weights: Array
    cutoff: float | None = None

    @property
    def duration(self) -> float:
        """Time [s] of all samples, without gaps."""
        return float(self.weights.sum())

    @property
    def has_gaps(self) -> bool:
        """Whether a part of the motion is missing between two samples."""
        return self.duration < float(self.times[-1] - self.times[0]) * (1 - 1e-9)


def trapezoid_weights(times: Array) -> Array:
    """Weights (N,) [s] of the trapezoidal rule at times (N,)."""
    steps = np.diff(times)
    weights: Array = (np.append(steps, 0.0) + np.append(0.0, steps)) / 2
    return weights


def planned_motion(path: Path, joint_names: Sequence[str], interpolate: bool = False) -> SampledMotion | None:
    """Read a CSV file that has time, <joint>.position, .velocity and .acceleration of all joints, without a filter.

    interpolate: take the positions alone, and differentiate the spline of degree 5 through them.

    Returns None for a file without such columns: a recording.

    Raises
    ------
    RecordingError
        The file cannot be read as CSV, a number is missing, times do not ascend, or rows are too few for a spline.
    """
    if path.suffix != ".csv" or not path.is_file():
        return None
    header = read_column_names(path)
    kinds = KINDS[:1] if interpolate else KINDS
    columns = ["time", *(f"{name}.{kind}" for kind in kinds for name in joint_names)]
    if not set(columns) <= set(header):
        return None
    table = _read_numbers(path, header)
    times, *values = (table[:, header.index(column)] for column in columns)
    if len(times) < 2:
        raise RecordingError(f"{path} has {len(times)} rows of numbers: two or more are needed")
    late = np.flatnonzero(np.diff(times) <= 0)
    if len(late):
        row = late[0] + 1
        raise RecordingError(
            f"{path}, row {row + 1}: time is {times[row]:g} s after {times[row - 1]:g} s in the row before: ascending "
            "times are needed"
        )
    q, *rates = np.reshape(values, (len(kinds), len(joint_names), len(times))).transpose(0, 2, 1)
    if interpolate:
        if len(times) <= SPLINE_DEGREE:
            raise RecordingError(f"{path} has {len(times)} rows: {SPLINE_DEGREE + 1} or more are needed for a spline")
        spline = make_interp_spline(times, q, k=SPLINE_DEGREE)
        rates = [spline(times, order) for order in (1, 2)]
    qd, qdd = rates
    return SampledMotion(times, q, qd, qdd, trapezoid_weights(times))


def describe_contradictions(motion: SampledMotion, joint_names: Sequence[str]) -> list[str]:
    """Say of which joints of a planned motion positions and velocities, or velocities and accelerations, do not fit.

    Their differences between samples are compared with the integrals of their rates by the trapezoidal rule, RMS over
    all samples.
    """
    steps = np.diff(motion.times)[:, None]
    sentences = []
    for values, rates, kinds in ((motion.q, motion.qd, KINDS[:2]), (motion.qd, motion.qdd, KINDS[1:])):
        changes, integrals = np.diff(values, axis=0), steps * (rates[1:] + rates[:-1]) / 2
        errors, scales = (np.sqrt(np.mean(part**2, axis=0)) for part in (changes - integrals, changes))
        largest = np.sqrt(np.mean(integrals**2, axis=0))
        contradictory = errors > MAX_CONTRADICTION * np.maximum(scales, largest)
        names = [name for name, is_wrong in zip(joint_names, contradictory, strict=True) if is_wrong]
        if names:
            sentences.append(
                f"the {kinds[1]} of {', '.join(names)} is not the derivative of the {kinds[0]}: the "
                "report counts each column as it is"
            )
    return sentences


def _read_numbers(path: Path, header: Sequence[str]) -> Array:
    """Read the rows (N, columns) below the header. Raises RecordingError where a cell is no finite number."""
    with path.open(newline="", encoding="utf-8", errors="replace") as file:
        reader = csv.reader(file)
        next(reader)
        rows = []
        for cells in reader:
            if not cells:
                continue
            if len(cells) != len(header):
                raise RecordingError(
                    f"{path}, line {reader.line_num}: {len(cells)} cells, but the header has {len(header)} names"
                )
            rows.append([_read_number(cell) for cell in cells])
            wrong = next((column for column, number in enumerate(rows[-1]) if not isfinite(number)), None)
            if wrong is not None:
                raise RecordingError(
                    f"{path}, line {reader.line_num}: {header[wrong]} is {cells[wrong]!r}: a finite number is needed"
                )
    return np.array(rows).reshape(len(rows), len(header))


def _read_number(cell: str) -> float:
    """Return the number in a cell, nan where there is none."""
    try:
        return float(cell)
    except ValueError:
        return nan


def recorded_motion_samples(recording: Recording, cutoff: float | None, rate: float | None) -> SampledMotion:
    """Read the filtered motion of a recording. Raises RecordingError."""
    pieces = list(recording.motions(cutoff=cutoff, rate=rate))
    weights, run = [], [pieces[0].times]
    for before, piece in pairwise(pieces):
        if abs(piece.time - before.end) > 0.5 / piece.rate:
            weights.append(trapezoid_weights(np.concatenate(run)))
            run = []
        run.append(piece.times)
    weights.append(trapezoid_weights(np.concatenate(run)))
    times, q, qd, qdd = (
        np.concatenate([getattr(piece, key) for piece in pieces]) for key in ("times", "q", "qd", "qdd")
    )
    return SampledMotion(times, q, qd, qdd, np.concatenate(weights), pieces[0].cutoff)
