"""Arguments of the verbs that read recordings: the robot, its drives, topics and filters."""

from __future__ import annotations

import re
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable
from math import inf
from typing import TYPE_CHECKING

from robot_dynamics.cli.robot_arguments import ROBOT_HELP, add_description_arguments, load_robot_argument
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import RecordingError

if TYPE_CHECKING:
    from robot_dynamics.recordings.recording import Recording
    from robot_dynamics.recordings.sample_range import SampleRange


def add_recording_arguments(parser: ArgumentParser, recordings: tuple[str, str | None]) -> None:
    """Add the arguments of recordings.

    recordings: name and nargs of the positional argument, ("recording", None) or ("recordings", "+").
    """
    name, nargs = recordings
    parser.add_argument(
        name,
        nargs=nargs,
        metavar="RECORDING",
        help="rosbag2 bag (folder, .mcap or .db3), or CSV file with the columns time, <joint>.position, <joint>.effort "
        "and optionally <joint>.velocity",
    )
    parser.add_argument("--robot", required=True, help=ROBOT_HELP)
    add_description_arguments(parser)
    add_signal_arguments(parser)


def add_signal_arguments(parser: ArgumentParser) -> None:
    """Add the options that say how signals of recordings are read."""
    parser.add_argument(
        "--drives",
        metavar="FILE",
        help="YAML file that converts measured signals to those of the joints: ratios, gains and offsets of motors; "
        "see config/drives",
    )
    parser.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="TOPIC",
        help="topic to read; repeat for several topics (default: all topics of type JointState, and the topic of type "
        "Odometry if the base of the robot moves)",
    )
    parser.add_argument(
        "--cutoff",
        type=float,
        metavar="HZ",
        help="cut-off frequency of the low-pass filter of efforts and velocities (default: 8, or a fifth of the rate)",
    )
    parser.add_argument(
        "--rate",
        type=float,
        metavar="HZ",
        help="samples per second to which signals are interpolated (default: as recorded)",
    )
    parser.add_argument(
        "--from",
        dest="start",
        type=float,
        metavar="S",
        help="use each recording from this time on, in seconds after its first message; times of the results count "
        "from there",
    )
    parser.add_argument(
        "--to", dest="end", type=float, metavar="S", help="use each recording up to this time, in seconds as for --from"
    )
    parser.add_argument(
        "--samples",
        metavar="A:B",
        help="use the messages (rows of a CSV file) with the numbers A to B - 1 of each recording; the first one is 0, "
        "A or B may be left out",
    )


def add_band_argument(parser: ArgumentParser) -> None:
    """Add the option of the filter before a fit."""
    parser.add_argument(
        "--band",
        type=float,
        metavar="HZ",
        help="cut-off frequency of the filter of efforts and regressor; default: --cutoff, at most 10",
    )


def parse_sample_range(arguments: Namespace) -> SampleRange:
    """The part of each recording that --from, --to and --samples select. Raises RecordingError."""
    from robot_dynamics.recordings.sample_range import SampleRange

    start = arguments.start
    end = arguments.end
    for option, time in (("--from", start), ("--to", end)):
        if time is not None and not 0 <= time < inf:
            raise RecordingError(f"{option} {time:g}: seconds after the first message are needed, 0 or more")
    if end is not None and end <= (start or 0):
        raise RecordingError(f"--to {end:g}: a time after --from {start or 0:g} is needed")
    if arguments.samples is None:
        return SampleRange(start, end)
    match = re.fullmatch(r"(\d*):(\d*)", arguments.samples)
    if match is None:
        raise RecordingError(f"--samples {arguments.samples}: A:B with whole numbers is needed, as 0:2000 or 500:")
    first, last = (int(number) if number else None for number in match.groups())
    if last is not None and last <= (first or 0):
        raise RecordingError(f"--samples {arguments.samples}: the second number must be larger than the first")
    return SampleRange(start, end, first, last)


def open_recordings(arguments: Namespace, paths: Iterable[str]) -> tuple[Dynamics, list[Recording]]:
    """Load the robot of parsed arguments and open the recordings at paths. Raises RobotDynamicsError."""
    # imported here so that the other verbs do not load the packages that filter recordings
    from robot_dynamics.recordings.drives import load_drives
    from robot_dynamics.recordings.recording import moving_base_link, open_recording, require_motors

    if arguments.rate is not None and not 0 < arguments.rate < 1e6:
        raise RecordingError(f"--rate {arguments.rate:g}: a number of samples per second is needed, more than 0")
    dynamics = Dynamics(load_robot_argument(arguments))
    require_motors(dynamics)
    drives = load_drives(arguments.drives, dynamics.joint_names)
    base = moving_base_link(dynamics)
    part = parse_sample_range(arguments)
    return dynamics, [open_recording(path, drives, arguments.topic, base, part) for path in paths]
