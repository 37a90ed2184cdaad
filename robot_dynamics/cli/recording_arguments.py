"""What every verb that reads recordings asks for: the robot, its drives, topics, and how signals are filtered."""

from robot_dynamics.cli.robot_arguments import add_description_arguments, load_robot_argument
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import RecordingError


def add_recording_arguments(parser, recordings):
    """recordings: name and number of the positional arguments: ("recording", None) or ("recordings", "+")."""
    name, number = recordings
    parser.add_argument(name, nargs=number, metavar="RECORDING",
                        help="bag of rosbag2 (folder, .mcap or .db3), or CSV with columns time, <joint>.position, "
                        "<joint>.effort")  # fmt: skip
    parser.add_argument("--robot", required=True,
                        help="path of a URDF, MDH table or .par, or the name of a robot that ships")  # fmt: skip
    add_description_arguments(parser)
    parser.add_argument("--drives", metavar="FILE",
                        help="YAML: motors and their ratios, gains, offsets; see config/drives")  # fmt: skip
    parser.add_argument("--topic", action="append", default=[], metavar="TOPIC",
                        help="topic to read, several times for several; default: all of JointState, "
                        "and the one of Odometry where the base of the robot moves")  # fmt: skip
    parser.add_argument("--cutoff", type=float, metavar="HZ",
                        help="of the low-pass filter; default 8, or a fifth of the rate")  # fmt: skip
    parser.add_argument("--rate", type=float, metavar="HZ", help="of the grid; default: as recorded")


def open_recordings(arguments, paths):
    """(Dynamics, the Recordings at paths) of parsed arguments. Raises RobotDynamicsError."""
    # here, so that the other verbs do not load what filters recordings
    from robot_dynamics.recordings.drives import load_drives
    from robot_dynamics.recordings.recording import moving_base_link, open_recording

    if arguments.rate is not None and not 0 < arguments.rate < 1e6:
        raise RecordingError(f"--rate {arguments.rate:g}: samples per second are needed")
    dynamics = Dynamics(load_robot_argument(arguments))
    if dynamics.unactuated_joint_names:
        raise RecordingError(f"{dynamics.robot.name!r}: no motor drives {', '.join(dynamics.unactuated_joint_names)}: "
                             "recordings are taken of robots all joints of which have motors; passive joints of closed "
                             "loops need none")  # fmt: skip
    drives = load_drives(arguments.drives, dynamics.joint_names)
    return dynamics, [open_recording(path, drives, arguments.topic, moving_base_link(dynamics)) for path in paths]
