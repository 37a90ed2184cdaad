"""Identification of a payload from recordings with it, and without it, of a robot whose description has no payload."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.determination import EFFORT_ACCURACY
from robot_dynamics.model.inertia import symmetric_entries

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.identification.payload_fit import PayloadFit
    from robot_dynamics.identification.payload_model import PayloadModel
    from robot_dynamics.identification.samples import ProgressWrapper, Samples
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.recordings.recording import Recording


def require_payload_link(robot: Robot, link: str) -> None:
    """Refuse a robot without masses, and a link that no joint moves.

    Raises
    ------
    RecordingError
        The description has no masses, or the link is fixed to the base.
    InvalidInputError
        The robot has no such link.
    """
    if robot.is_massless:
        raise RecordingError(
            f"the description of {robot.name!r} has no masses: its efforts without load are not known. Identify it "
            "first from recordings without load, with the verb identify"
        )
    if robot.frame(link).link == 0 and not robot.moving_base:
        raise RecordingError(f"link {link}: it is fixed to the base: no joint carries it")


def identify_payload(
    dynamics: Dynamics,
    link: str,
    loaded: Sequence[Recording],
    empty: Sequence[Recording] = (),
    *,
    cutoff: float | None = None,
    band: float | None = None,
    effort_accuracy: float = EFFORT_ACCURACY,
    progress: ProgressWrapper | None = None,
) -> PayloadFit:
    """Fit the payload on a link.

    Parameters
    ----------
    dynamics : model of the robot without load.
    link : frame that carries the payload, and in which its parameters are.
    loaded, empty : recordings with the payload, and without it.
    cutoff, band : cut-off frequencies [Hz] of the filters of signals, and of efforts and regressor; None: the defaults.
    effort_accuracy : as of `fit_payload`.
    progress : as of Samples.

    Raises
    ------
    RecordingError, MissingPackageError
        As `fit_payload`.
    """
    # imported here so that nodes and verbs start without what fits
    from robot_dynamics.identification.identification_model import build_identification_model
    from robot_dynamics.identification.payload_fit import fit_payload
    from robot_dynamics.identification.payload_model import PayloadModel
    from robot_dynamics.identification.samples import Samples

    names = frozenset(recording.name for recording in empty)
    repeated = names & {recording.name for recording in loaded}
    if repeated:
        raise RecordingError(f"{min(repeated)}: the same recording is named as one with and without the payload")
    robot_model = build_identification_model(dynamics, loaded[0].drives)

    def samples_of(model: PayloadModel) -> Samples[PayloadModel]:
        return Samples([*loaded, *empty], model, cutoff=cutoff, band=band, progress=progress)

    model = PayloadModel(robot_model, link, robot_model, empty_recordings=names)
    return fit_payload(samples_of, model, effort_accuracy=effort_accuracy)


def node_parameters(link: str, fit: PayloadFit) -> dict[str, object]:
    """Parameters payload.* of nodes for an identified payload, the link last."""
    inertia = fit.inertia
    return {
        "payload.mass": float(inertia.mass),
        "payload.first_moments": inertia.first_moments.tolist(),
        "payload.inertia": [float(entry) for entry in symmetric_entries(inertia.second_moments)],
        "payload.link": link,
    }
