"""Rows of the table of identified parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from robot_dynamics.identification.friction_terms import SHIFT_PARAMETER, STRIBECK_PARAMETER

if TYPE_CHECKING:
    from robot_dynamics.array_types import BoolArray
    from robot_dynamics.identification.fitting import Fit


class ParameterRow(NamedTuple):
    """A parameter in SI units; expression: the sum of parameters that it stands for."""

    name: str
    expression: str
    value: float
    deviation: float
    deviation_within_run: float
    description: float
    is_essential: bool
    is_seen: bool


def parameter_rows(fit: Fit, essential: BoolArray) -> Iterator[ParameterRow]:
    """Rows of all parameters of a fit; essential: (P,) which are essential.

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
            is_essential=stribeck.is_essential,
            is_seen=row.is_seen and stribeck.is_seen,
        )
