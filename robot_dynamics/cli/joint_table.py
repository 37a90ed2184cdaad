"""CSV text of the signals of joints over time, with the columns that verbs for recordings read."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from robot_dynamics.array_types import Array


def joint_table(times: Array, joint_names: Sequence[str], signals: Mapping[str, Array]) -> str:
    """Return a CSV table with the columns time and <joint>.<signal>.

    Parameters
    ----------
    times : (N,) array [s]
    joint_names : sequence of n str
    signals : mapping of str to (N, n) array
        Values of the joints by the name of the signal: position, velocity, acceleration, effort.
    """
    values = np.stack(list(signals.values()), axis=-1).reshape(len(times), -1)
    header = ["time", *(f"{name}.{signal}" for name in joint_names for signal in signals)]
    text = io.StringIO()
    table = np.column_stack([times, values])
    np.savetxt(text, table, fmt="%.9g", delimiter=",", header=",".join(header), comments="")
    return text.getvalue()
