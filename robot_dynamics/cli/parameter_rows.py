"""The table of identified parameters."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from robot_dynamics.cli.text_table import print_table, round_to_digits
from robot_dynamics.identification.friction_terms import SHIFT_PARAMETER, STRIBECK_PARAMETER

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.cli.text_table import Cell
    from robot_dynamics.identification.fitting import Fit

MAX_EXPRESSION_LENGTH = 60
MIN_WRITTEN = 1e-4  # of the deviation: smaller values of a written robot are rounding errors
LEGEND = (
    "deviation: standard deviation, from the scatter between seconds of motion, and for friction 2 % between runs.\n"
    "written: of the robot of --output, within physical limits. not essential: the fit is as good without this\n"
    "parameter. not seen: the motion does not show it; the fit keeps what the description says, and the written robot\n"
    "what is near to it and explains the efforts best."
)


class ParameterRow(NamedTuple):
    """A parameter in SI units.

    expression: the sum of parameters that it stands for; written: value of the written robot, None if there is none.
    """

    name: str
    expression: str
    value: float
    deviation: float
    deviation_within_run: float
    description: float
    written: float | None
    is_essential: bool
    is_seen: bool


def parameter_rows(fit: Fit, essential: BoolArray, written: Array | None) -> Iterator[ParameterRow]:
    """Rows of all parameters of a fit.

    essential: (P,) which are essential; written: (P,) values of the written robot, None if there is none.

    A Stribeck velocity is fitted by its shift S = Fst ln(vs / v0); its row has vs, with the deviation vs σ(S) / |Fst|.
    """
    model = fit.model
    columns = zip(
        model.names,
        model.expressions,
        fit.values.tolist(),
        fit.deviations_between_runs.tolist(),
        fit.standard_deviations.tolist(),
        fit.prior.values.tolist(),
        [None] * len(model.names) if written is None else written.tolist(),
        essential.tolist(),
        fit.seen.tolist(),
        strict=True,
    )
    rows = [ParameterRow(*column) for column in columns]
    first = len(model.parameter_indices)
    velocities = {
        number: term.velocity for number, term in enumerate(model.terms, first) if term.parameter == SHIFT_PARAMETER
    }
    by_name = {row.name: row for row in rows}
    for number, row in enumerate(rows):
        if number not in velocities:
            yield row
            continue
        stribeck = by_name[row.name.replace(SHIFT_PARAMETER, STRIBECK_PARAMETER, 1)]
        relative = row.deviation_within_run / max(abs(stribeck.value), 1e-300)
        yield row._replace(
            value=velocities[number],
            deviation=velocities[number] * relative,
            deviation_within_run=velocities[number] * relative,
            written=None if written is None else velocities[number],
            is_essential=stribeck.is_essential,
            is_seen=row.is_seen and stribeck.is_seen,
        )


def print_parameters(rows: Sequence[ParameterRow]) -> None:
    """Print the table of the parameters."""
    cells: list[list[Cell]] = []
    for row in rows:
        name = textwrap.shorten(row.expression, MAX_EXPRESSION_LENGTH, placeholder=" ...")
        value = round_to_digits(row.value, 4) if row.is_seen else None
        deviation = round_to_digits(row.deviation, 2) if row.is_seen else None
        written = None if row.written is None else round_to_digits(row.written, 4)
        if written is not None and abs(written) < MIN_WRITTEN * row.deviation:
            written = 0.0  # a limit, to the accuracy of the solver
        remark = "" if row.is_essential else "not essential" if row.is_seen else "not seen"
        cells.append([name, value, deviation, written, round_to_digits(row.description, 4), remark])
    print_table(["parameter", "value", "deviation", "written", "description", ""], cells, "Parameters, SI")
    print(LEGEND)


def describe_negative_values(fit: Fit) -> list[str]:
    """Names and values of frictions and rotor inertias of a fit that are negative, which no written robot has.

    Single parameters are named beyond their standard deviation, sums in any case.
    """
    values = dict(zip(fit.model.names, fit.values.tolist(), strict=True))
    negative = [
        f"{name} {value:.2g}"
        for (name, value), deviation, is_seen in zip(values.items(), fit.standard_deviations, fit.seen, strict=True)
        if name.partition(".")[0] in ("Ia", "Fv", "Fs", "mu") and value < -deviation and is_seen
    ]
    for joint in fit.model.dynamics.joint_names:
        dry = values.get(f"Fs.{joint}", 0.0) + values.get(f"Fst.{joint}", 0.0)
        viscous = values.get(f"Fv.{joint}", 0.0) - abs(values.get(f"Fva.{joint}", 0.0))
        if f"Fst.{joint}" in values and dry < 0:
            negative.append(f"Fs + Fst of {joint} {dry:.2g}")
        if f"Fva.{joint}" in values and viscous < 0:
            negative.append(f"Fv - |Fva| of {joint} {viscous:.2g}")
    return negative
