"""The response of payload_identifier: an identified payload as a message."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import Point, Vector3

from robot_dynamics.identification.payload_identification import node_parameters
from robot_dynamics.model.inertia import INERTIA_ENTRIES, symmetric_entries
from robot_dynamics.nodes.codecs.fields import to_float_array
from robot_dynamics_interfaces.srv import IdentifyPayload

if TYPE_CHECKING:
    from collections.abc import Iterator

    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.identification.payload_fit import PayloadFit

NAMES = (*(f"inertia {entry}" for entry in INERTIA_ENTRIES), "centre x", "centre y", "centre z", "mass")
"""What the entries of `PayloadFit.deviations` are of."""
REMEDY = "measure a longer motion, in which gravity acts on the load from all sides"


def write_payload(fit: PayloadFit, link: str, dynamics: Dynamics) -> IdentifyPayload.Response:
    """The response with an identified payload, without set_nodes.

    No single value counts as determined where the payload is not: the others, on which it depends, may be wrong.
    """
    deviations = fit.deviations
    determined = (fit.determined & fit.is_determined).tolist()
    parameters = node_parameters(link, fit)
    return IdentifyPayload.Response(
        success=fit.is_determined,
        message="; ".join(_sentences(fit)),
        determined=fit.is_determined,
        link=link,
        mass=float(fit.inertia.mass),
        centre=Point(**dict(zip("xyz", fit.centre.tolist(), strict=True))),
        inertia=np.array(symmetric_entries(fit.central_inertia), dtype=float),
        mass_deviation=float(deviations[9]),
        centre_deviation=Vector3(**dict(zip("xyz", deviations[6:9].tolist(), strict=True))),
        inertia_deviation=deviations[:6],
        mass_determined=determined[9],
        centre_determined=determined[6:9],
        inertia_determined=determined[:6],
        prediction_error=fit.prediction_error,
        blocks=fit.blocks,
        first_moments=np.array(parameters["payload.first_moments"], dtype=float),
        origin_inertia=np.array(parameters["payload.inertia"], dtype=float),
        joint_names=list(dynamics.joint_names),
        residual_rms=to_float_array(fit.quality.rms),
        residual_rms_without_load=to_float_array(fit.empty_quality.rms),
    )


def _sentences(fit: PayloadFit) -> Iterator[str]:
    """What is not determined, and the warnings and notes of a fit."""
    missing = [name for name, is_determined in zip(NAMES, fit.determined, strict=True) if not is_determined]
    if not fit.is_determined:
        yield (
            f"the load is not determined: mass {fit.inertia.mass:.3g} ± {fit.deviations[9]:.2g} kg, the efforts that "
            f"it needs in other motions are predicted with a standard deviation of {100 * fit.prediction_error:.3g} %: "
            f"{REMEDY}"
        )
    elif missing:
        yield f"not determined: {', '.join(missing)}"
    yield from fit.warnings
    yield from (f"{name}: {sentence}" for name, sentences in fit.notes.items() for sentence in sentences)
