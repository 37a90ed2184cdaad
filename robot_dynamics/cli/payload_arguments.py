"""Arguments for payloads of known mass, which the identification of drive gains needs."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from robot_dynamics.errors import RecordingError

if TYPE_CHECKING:
    from robot_dynamics.identification.drive_gains import Payload
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.recordings.recording import Recording

EXAMPLE = "such as --known-payload loaded.mcap=tool0:2.5"


def add_gain_arguments(parser: ArgumentParser) -> None:
    """Add the options of the identification of drive gains."""
    parser.add_argument(
        "--gains",
        action="store_true",
        help="identify drive gains too, from recordings with and without --known-payload",
    )
    parser.add_argument(
        "--known-payload",
        action="append",
        default=[],
        metavar="RECORDING=LINK:MASS",
        help="payload [kg] on a link in one of the recordings, which is named by its path or its file name; its centre "
        "of mass and inertia need not be known; repeat for several recordings",
    )


def parse_known_payloads(arguments: Namespace, robot: Robot, recordings: Sequence[Recording]) -> dict[str, Payload]:
    """Parse the known payloads by the name of their recording.

    recordings: opened recordings, those to be fitted first. Raises RecordingError, also if --gains has no payload to
    identify the gains with.
    """
    if arguments.known_payload and not arguments.gains:
        raise RecordingError("--known-payload is used only with --gains: add --gains")
    if arguments.gains and not arguments.known_payload:
        raise RecordingError(
            "--gains: a robot with twice the masses and twice the gains gives the same measurements. Record some of "
            f"the runs with a payload of known mass, and give it with --known-payload, {EXAMPLE}"
        )
    names = {recording.source.path.resolve(): recording.name for recording in recordings}
    fitted = {recording.name for recording in recordings[: len(arguments.recordings)]}
    payloads: dict[str, Payload] = {}
    for text in arguments.known_payload:
        path, payload = _parse_payload(text)
        name = names.get(Path(path).resolve()) or _recording_of_file_name(text, path, recordings)
        if name in payloads:
            raise RecordingError(f"--known-payload {text}: {path} has a payload already")
        if robot.frame(payload.link).link == 0:
            raise RecordingError(f"--known-payload {text}: {payload.link} is fixed to the base: no joint carries it")
        payloads[name] = payload
    for payload in set(payloads.values()) - {payload for name, payload in payloads.items() if name in fitted}:
        raise RecordingError(f"--known-payload {payload.link}:{payload.mass:g} is in no recording that is fitted")
    return payloads


def _recording_of_file_name(text: str, file_name: str, recordings: Sequence[Recording]) -> str:
    """The name of the recording with a file name. Raises RecordingError if there is none, or several."""
    names = [recording.name for recording in recordings if Path(recording.name).name == file_name]
    if len(set(names)) == 1:
        return names[0]
    reason = "is the name of several recordings" if names else "is not one of the recordings"
    known = ", ".join(dict.fromkeys(names or [recording.name for recording in recordings]))
    raise RecordingError(f"--known-payload {text}: {file_name} {reason}. Name one of: {known}")


def _parse_payload(text: str) -> tuple[str, Payload]:
    """Parse the path and the payload of RECORDING=LINK:MASS."""
    from robot_dynamics.identification.drive_gains import Payload

    path, _, load = text.rpartition("=")
    link, _, mass_text = load.rpartition(":")
    try:
        mass = float(mass_text)
    except ValueError:
        mass = 0.0
    if not path or not link or not 0 < mass < float("inf"):
        raise RecordingError(f"--known-payload {text}: RECORDING=LINK:MASS is needed, {EXAMPLE}")
    return path, Payload(link, mass)
