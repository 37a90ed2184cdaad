"""Design a trajectory that excites a robot, for identify: Fourier series within joint limits.

It begins and ends at rest, and makes the condition number of the base parameters and frictions as small as is found.
Written is a CSV with columns time, <joint>.position, .velocity and .acceleration. Whether links hit each other, the
table or a cable is not known here: look at the motion before a robot runs it, and begin slowly.

It takes some seconds for an arm of seven joints; how long it will take is said at the beginning, and a bar on a
terminal shows how far it is. --time-limit ends it with the best trajectory so far.
"""

import io

import numpy as np

from robot_dynamics.cli.output_files import write_text
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError

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


def run(arguments):
    dynamics = Dynamics(load_robot_argument(arguments))
    for name in ("duration", "rate", "acceleration", "iterations", "harmonics", "time_limit"):
        if not getattr(arguments, name) > 0:
            raise InvalidInputError(f"--{name.replace('_', '-')} {getattr(arguments, name):g}: more than 0 is needed")
    if not arguments.duration * arguments.rate < 1e7:
        raise InvalidInputError(
            f"--duration {arguments.duration:g} --rate {arguments.rate:g}: less than 10 million samples are needed"
        )
    from robot_dynamics.cli.progress import progress_bar
    from robot_dynamics.identification.excitation import design_excitation, joint_bounds
    from robot_dynamics.identification.identification_model import build_identification_model
    from robot_dynamics.recordings.drives import direct_drives

    columns = build_identification_model(dynamics, direct_drives(dynamics.joint_names), compiled=False)
    bounds = joint_bounds(dynamics, arguments.acceleration, arguments.margin)

    def on_estimate(seconds):
        print(f"{arguments.iterations} iterations for {len(columns.names)} parameters: about {max(1, round(seconds))} s",
              flush=True)  # fmt: skip

    with progress_bar(arguments.iterations, "condition number", " iterations") as shown:
        found = design_excitation(
            columns, bounds, duration=arguments.duration, harmonics=arguments.harmonics, iterations=arguments.iterations,
            seed=arguments.seed, time_limit=arguments.time_limit, on_estimate=on_estimate,
            on_iteration=lambda done, _: shown(done))  # fmt: skip
    write_text(arguments.output, trajectory_csv(found.trajectory, dynamics.joint_names, arguments.rate))
    if not found.complete:
        print(f"time limit of {arguments.time_limit:g} s after {found.iterations} of {arguments.iterations} iterations: this is "
              "the best trajectory so far")  # fmt: skip
    print(f"{arguments.output}: {arguments.duration:g} s, condition number {found.condition:.3g} of {len(columns.names)} "
          "parameters")  # fmt: skip


def trajectory_csv(trajectory, names, rate):
    """The CSV text of a FourierTrajectory, both ends included."""
    times = np.linspace(0, trajectory.duration, round(trajectory.duration * rate) + 1)
    columns = np.stack(trajectory(times), axis=-1).reshape(len(times), -1)
    head = ["time", *(f"{name}.{kind}" for name in names for kind in ("position", "velocity", "acceleration"))]
    text = io.StringIO()
    np.savetxt(text, np.column_stack([times, columns]), fmt="%.9g", delimiter=",", header=",".join(head), comments="")
    return text.getvalue()
