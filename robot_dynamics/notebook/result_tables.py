"""Results of models as HTML: a table of one sample, a plot of a batch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.notebook.markup import block, heading, paragraph, table
from robot_dynamics.notebook.plots import curves, figure_picture

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lxml.html import HtmlElement

    from robot_dynamics.array_types import Array
    from robot_dynamics.flexible.elastodynamics import NaturalFrequencies
    from robot_dynamics.flexible.flexible_arm import FlexibleDynamicsResult
    from robot_dynamics.identification.base_parameters import BaseParameters
    from robot_dynamics.notebook.markup import Cell
    from robot_dynamics.results import DynamicsResult, Equilibrium, JointMotion
    from robot_dynamics.simulation.rollouts import Rollouts

MAX_ROWS = 60
POSITION, VELOCITY, ACCELERATION = "position [rad or m]", "velocity [rad/s or m/s]", "acceleration [rad/s² or m/s²]"
EFFORT = "effort [N m or N]"


def dynamics_result_html(result: DynamicsResult) -> HtmlElement:
    """Return efforts and accelerations of the independent joints."""
    quantities = {EFFORT: result.efforts, ACCELERATION: result.accelerations}
    return _joint_quantities("Dynamics: independent joints, in the order of Dynamics.joint_names", quantities)


def motion_html(motion: JointMotion) -> HtmlElement:
    """Return the motion of all joints."""
    quantities = {POSITION: motion.positions, VELOCITY: motion.velocities, ACCELERATION: motion.accelerations}
    return _joint_quantities("Motion of all joints, in the order of Dynamics.all_joint_names", quantities)


def flexible_result_html(result: FlexibleDynamicsResult) -> HtmlElement:
    """Return efforts and accelerations of the joints."""
    quantities = {EFFORT: result.efforts, ACCELERATION: result.accelerations}
    return _joint_quantities("Dynamics of a flexible arm: joints", quantities)


def equilibrium_html(equilibrium: Equilibrium) -> HtmlElement:
    """Return positions and efforts, and whether the equilibrium is stable."""
    stable = np.asarray(equilibrium.stable)
    state = f"{int(stable.sum())} of {stable.size} are stable" if stable.ndim else ("stable" if stable else "unstable")
    quantities = {POSITION: equilibrium.positions, EFFORT: equilibrium.efforts}
    return _joint_quantities(f"Equilibrium, {state}: joints in the order of Dynamics.joint_names", quantities)


def rollouts_html(rollouts: Rollouts) -> HtmlElement:
    """Return the motion of the first simulation."""
    count = len(rollouts.positions)
    title = f"{count} simulations of {len(rollouts.times) - 1} steps; the first one:"
    quantities = {POSITION: rollouts.positions[0], VELOCITY: rollouts.velocities[0]} if count else {}
    return block(heading(title), figure_picture(lambda: curves(quantities, rollouts.times, "time [s]"), title))


def natural_frequencies_html(natural: NaturalFrequencies) -> HtmlElement:
    """Return the frequencies, and the coordinate that moves most in each mode; of a batch the range."""
    if natural.frequencies.ndim > 1:
        rows: list[list[Cell]] = [
            [str(k), float(np.nanmin(values)), float(np.nanmax(values))]
            for k, values in enumerate(natural.frequencies.reshape(-1, natural.frequencies.shape[-1]).T, start=1)
        ]
        title = f"Natural frequencies at {natural.frequencies[..., 0].size} poses"
        return block(heading(title), table(("mode", "least [Hz]", "greatest [Hz]"), rows[:MAX_ROWS]))
    rows = [
        [str(k), float(frequency), natural.coordinates[int(np.argmax(np.abs(shape)))] if shape.any() else ""]
        for k, (frequency, shape) in enumerate(zip(natural.frequencies, natural.mode_shapes, strict=True), start=1)
    ]
    return block(heading("Natural frequencies"), table(("mode", "[Hz]", "moves most"), rows[:MAX_ROWS]))


def base_parameters_html(parameters: BaseParameters) -> HtmlElement:
    """Return the groups of parameters."""
    expressions = parameters.expressions
    title = f"{len(expressions)} base parameters of {len(parameters.names)} parameters"
    rows: list[list[Cell]] = [[str(number), text] for number, text in enumerate(expressions[:MAX_ROWS], start=1)]
    return block(heading(title), table(("", "sum"), rows), *_rest(len(expressions)))


def _joint_quantities(title: str, quantities: Mapping[str, Array]) -> HtmlElement:
    """Return quantities (..., n) of joints: a table of one sample, a plot of a batch (N, n)."""
    arrays = [np.asarray(values, dtype=float) for values in quantities.values()]
    if arrays[0].ndim == 1:
        columns = zip(*arrays, strict=True)
        rows: list[list[Cell]] = [[str(number), *map(float, row)] for number, row in enumerate(columns, start=1)]
        return block(heading(title), table(("joint", *quantities), rows[:MAX_ROWS]), *_rest(len(rows)))
    title = f"{title}; {arrays[0][..., 0].size} samples"
    flat = {name: array.reshape(-1, array.shape[-1]) for name, array in zip(quantities, arrays, strict=True)}
    samples = np.arange(len(next(iter(flat.values()))), dtype=float)
    plot = figure_picture(lambda: curves(flat, samples, "sample"), title)
    return block(heading(title), _ranges(flat), plot)


def _ranges(quantities: Mapping[str, Array]) -> HtmlElement:
    """Return a table of the range of each quantity (N, n) of each joint."""
    header = ["joint", *(f"{name}, {end}" for name in quantities for end in ("least", "greatest"))]
    rows: list[Sequence[Cell]] = []
    for joint in range(min(MAX_ROWS, next(iter(quantities.values())).shape[-1])):
        columns = [values[:, joint][np.isfinite(values[:, joint])] for values in quantities.values()]
        ends = [float(end) for column in columns for end in (column.min(initial=np.inf), column.max(initial=-np.inf))]
        rows.append([str(joint + 1), *ends])
    return table(header, rows)


def _rest(count: int) -> list[HtmlElement]:
    return [paragraph(f"and {count - MAX_ROWS} more")] if count > MAX_ROWS else []
