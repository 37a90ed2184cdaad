"""Identify what a link carries from a short recording: mass, centre of mass, and inertia where the motion shows it.

The description of --robot, with its --drives, must be that of the robot without load, identified before. What it does
not explain of the measured efforts is fitted by a body on --link, with viscous and Coulomb friction and an offset of
each joint. --empty names recordings without the load: errors of the model that they show too do not count as load.
Prints the values with their standard deviations, and writes the parameters payload.* of nodes. --set-node sets them on
a running node. The exit status is 0, or 3 if the recordings do not determine the payload.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from robot_dynamics.cli.output_files import (
    YAML_ENDINGS,
    allow_closed_stdout,
    check_ending,
    check_writable,
    write_text,
)
from robot_dynamics.cli.recording_arguments import add_band_argument, add_recording_arguments, open_recordings
from robot_dynamics.errors import RecordingError, RobotDynamicsError

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics

NAME = "identify-payload"
NOT_DETERMINED_EXIT_STATUS = 3


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_recording_arguments(parser, ("recordings", "+"))
    parser.add_argument(
        "--link",
        help="link that carries the payload, in whose frame the results are (default: the last one of the description)",
    )
    parser.add_argument(
        "--empty",
        action="append",
        default=[],
        metavar="RECORDING",
        help="recording without the payload, best of the same motion; repeat for several recordings. All parameters of "
        "the robot are then fitted too",
    )
    add_band_argument(parser)
    parser.add_argument(
        "--effort-accuracy",
        type=float,
        default=0.03,
        metavar="PART",
        help="relative standard deviation of the scale of the measured efforts, which no recording shows and which the "
        "deviation of the mass contains (default: %(default)s)",
    )
    parser.add_argument(
        "--output", metavar="FILE.yaml", help="write the parameters payload.* of nodes, for --params-file"
    )
    parser.add_argument("--json", metavar="FILE", help="write all results as JSON")
    parser.add_argument(
        "--set-node",
        action="append",
        default=[],
        metavar="NODE",
        help="set the parameters payload.* of a running node, such as /dynamics_server, if the recordings determine "
        "it; repeat for several nodes; needs ROS",
    )


def run(arguments: Namespace) -> int:
    """Identify the payload, print it, write the output files, set the nodes, and return the exit status."""
    if arguments.output is not None:
        check_ending(arguments.output, YAML_ENDINGS, "--output")
    for path in filter(None, (arguments.output, arguments.json)):
        check_writable(path)
    if not 0 <= arguments.effort_accuracy < 1:
        raise RecordingError(f"--effort-accuracy {arguments.effort_accuracy:g}: a part of 0 to 1 is needed")
    dynamics, recordings = open_recordings(arguments, [*arguments.recordings, *arguments.empty])
    link = payload_link(dynamics, arguments.link)
    from robot_dynamics.cli.payload_report import as_dict, parameters_file, print_payload
    from robot_dynamics.cli.progress import progress_wrapper
    from robot_dynamics.identification.payload_identification import identify_payload, node_parameters

    count = len(arguments.recordings)
    fit = identify_payload(
        dynamics,
        link,
        recordings[:count],
        recordings[count:],
        cutoff=arguments.cutoff,
        band=arguments.band,
        effort_accuracy=arguments.effort_accuracy,
        progress=lambda items, total: progress_wrapper(total, "recordings", unit=" parts")(items),
    )
    is_determined = fit.is_determined
    try:  # files first: the reader of stdout may be gone. Where a file cannot be written, the results are printed
        if arguments.output:
            write_text(arguments.output, parameters_file(link, fit))
        if arguments.json:
            write_text(arguments.json, json.dumps(as_dict(link, fit, dynamics), indent=1) + "\n")
    finally:
        with allow_closed_stdout():
            print_payload(link, fit, dynamics, arguments.effort_accuracy)
    if not is_determined:
        if arguments.set_node:
            raise RobotDynamicsError("--set-node: the recordings do not determine the payload, no parameter was set")
        return NOT_DETERMINED_EXIT_STATUS
    set_nodes(arguments.set_node, node_parameters(link, fit))
    return 0


def payload_link(dynamics: Dynamics, name: str | None) -> str:
    """Name of the link that carries the payload. Raises RobotDynamicsError if no joint moves it."""
    from robot_dynamics.checking.load_hint import last_link_name
    from robot_dynamics.identification.payload_identification import require_payload_link

    link = last_link_name(dynamics.robot) if name is None else name
    require_payload_link(dynamics.robot, link)
    return link


def set_nodes(names: list[str], values: dict[str, object]) -> None:
    """Set parameters of running nodes, and print which. Raises RobotDynamicsError where a node refuses or is absent."""
    if not names:
        return
    try:
        from robot_dynamics.nodes.running_nodes import set_node_parameters  # the only use of ROS in this verb
    except ModuleNotFoundError as error:
        raise RobotDynamicsError(
            f"--set-node needs ROS 2, of which {error.name} is missing: source it, or pip install 'robot_dynamics[ros]'"
        ) from error
    for name in set_node_parameters(names, values):
        print(f"set the payload of {name}")
