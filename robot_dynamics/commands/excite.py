"""Design a trajectory that excites a robot, for identify: Fourier series within joint limits.

It begins and ends at rest, and makes the condition number of the base parameters and frictions as small as is found.
Written is a CSV with columns time, <joint>.position, .velocity and .acceleration. Whether links hit each other, the
table or a cable is not known here: look at the motion before a robot runs it, and begin slowly.

It takes some seconds for an arm of seven joints; how long it will take is said at the beginning, and a bar on a
terminal shows how far it is. --time-limit ends it with the best trajectory so far.
"""

import io

import numpy as np

from robot_dynamics.commands.robot_arguments import add_robot_arguments, robot_of
from robot_dynamics.commands.written import write_text
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import QuestionError

NAME = "excite"


def add_arguments(parser):
    add_robot_arguments(parser)
    parser.add_argument("--output", metavar="FILE.csv", required=True, help="write the trajectory")
    parser.add_argument("--duration", type=float, default=20.0, metavar="S", help="default: %(default)s")
    parser.add_argument("--harmonics", type=int, default=5, help="of the series (default: %(default)s)")
    parser.add_argument("--rate", type=float, default=100.0, metavar="HZ", help="of what is written (%(default)s)")
    parser.add_argument("--acceleration", type=float, default=np.inf, metavar="A",
                        help="limit of all joints [rad/s² or m/s²]; default: none")  # fmt: skip
    parser.add_argument("--margin", type=float, default=0.05, metavar="PART",
                        help="of ranges and rates that is left free at each end (default: %(default)s)")  # fmt: skip
    parser.add_argument("--iterations", type=int, default=50, help="of the optimiser (default: %(default)s)")
    parser.add_argument("--time-limit", type=float, default=np.inf, metavar="S",
                        help="take the best trajectory so far after this time (default: none)")  # fmt: skip
    parser.add_argument("--seed", type=int, default=0)


def run(told):
    dynamics = Dynamics(robot_of(told))
    for name in ("duration", "rate", "acceleration", "iterations", "harmonics", "time_limit"):
        if not getattr(told, name) > 0:
            raise QuestionError(f"--{name.replace('_', '-')} {getattr(told, name):g}: more than 0 is needed")
    if not told.duration * told.rate < 1e7:
        raise QuestionError(
            f"--duration {told.duration:g} --rate {told.rate:g}: less than 10 million samples are needed"
        )
    from robot_dynamics.commands.progress import bar
    from robot_dynamics.identification.effort_columns import effort_columns
    from robot_dynamics.identification.excitation import exciting_trajectory, joint_bounds
    from robot_dynamics.replay.drives import direct_drives

    columns = effort_columns(dynamics, direct_drives(dynamics.joint_names), compiled=False)
    bounds = joint_bounds(dynamics, told.acceleration, told.margin)

    def estimated(seconds):
        print(f"{told.iterations} iterations for {len(columns.names)} parameters: about {max(1, round(seconds))} s",
              flush=True)  # fmt: skip

    with bar(told.iterations, "condition number", " iterations") as shown:
        found = exciting_trajectory(
            columns, bounds, duration=told.duration, harmonics=told.harmonics, iterations=told.iterations,
            seed=told.seed, time_limit=told.time_limit, estimated=estimated,
            told=lambda done, _: shown(done))  # fmt: skip
    write_text(told.output, table(found.trajectory, dynamics.joint_names, told.rate))
    if not found.complete:
        print(f"time limit of {told.time_limit:g} s after {found.iterations} of {told.iterations} iterations: this is "
              "the best trajectory so far")  # fmt: skip
    print(f"{told.output}: {told.duration:g} s, condition number {found.condition:.3g} of {len(columns.names)} "
          "parameters")  # fmt: skip


def table(trajectory, names, rate):
    """The CSV text of a FourierTrajectory, both ends included."""
    times = np.linspace(0, trajectory.duration, round(trajectory.duration * rate) + 1)
    columns = np.stack(trajectory(times), axis=-1).reshape(len(times), -1)
    head = ["time", *(f"{name}.{kind}" for name in names for kind in ("position", "velocity", "acceleration"))]
    text = io.StringIO()
    np.savetxt(text, np.column_stack([times, columns]), fmt="%.9g", delimiter=",", header=",".join(head), comments="")
    return text.getvalue()
