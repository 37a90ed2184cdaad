"""Payloads of known mass that robots carried in some recordings, by which gains of drives are found."""

from pathlib import Path

from robot_dynamics.errors import RecordingError

EXAMPLE = "such as --known-payload loaded.mcap=tool0:2.5"


def add_gain_arguments(parser):
    parser.add_argument("--gains", action="store_true",
                        help="find gains of drives too, by recordings with --known-payload and without")  # fmt: skip
    parser.add_argument("--known-payload", action="append", default=[], metavar="RECORDING=LINK:MASS",
                        help="what the robot carries on a link in one of the recordings [kg]; its centre and inertia "
                        "need not be known; several times for several")  # fmt: skip


def parse_known_payloads(arguments, robot, recordings):
    """{name of a recording: Payload} of parsed arguments and opened recordings, those to be fitted first.

    Raises RecordingError, also where nothing tells the gains that are asked for.
    """
    if arguments.known_payload and not arguments.gains:
        raise RecordingError("--known-payload is what --gains are found by: give both")
    if arguments.gains and not arguments.known_payload:
        raise RecordingError(
            "--gains: robots with twice the masses and twice the gains measure the same. Record one part of the runs "
            f"with a payload of known mass, and say so, {EXAMPLE}"
        )
    by_path = {recording.source.path.resolve(): recording.name for recording in recordings}
    fitted = {recording.name for recording in recordings[: len(arguments.recordings)]}
    loads = {}
    for text in arguments.known_payload:
        path, payload = _parsed(text)
        name = by_path.get(Path(path).resolve())
        if name is None:
            raise RecordingError(f"--known-payload {text}: {path} is none of the recordings")
        if name in loads:
            raise RecordingError(f"--known-payload {text}: {path} has a payload already")
        if robot.frame(payload.link).link == 0:
            raise RecordingError(f"--known-payload {text}: {payload.link} is fixed to the base: no joint carries it")
        loads[name] = payload
    missing = set(loads.values()) - {payload for name, payload in loads.items() if name in fitted}
    for payload in missing:
        raise RecordingError(f"--known-payload {payload.link}:{payload.mass:g} is in no recording that is fitted")
    return loads


def _parsed(text):
    """(path, Payload) of RECORDING=LINK:MASS."""
    from robot_dynamics.identification.drive_gains import Payload

    path, _, load = text.rpartition("=")
    link, _, mass = load.rpartition(":")
    try:
        payload = Payload(link, float(mass))
    except ValueError:
        payload = None
    if payload is None or not path or not link or not 0 < payload.mass < float("inf"):
        raise RecordingError(f"--known-payload {text}: RECORDING=LINK:MASS is needed, {EXAMPLE}")
    return path, payload
