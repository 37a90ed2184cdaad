"""Design an excitation trajectory for identify: a Fourier series within the joint limits.

The trajectory begins and ends at rest. It minimises the condition number of the regressor of base parameters, frictions
and offsets: the lower it is, the better the parameters can be told apart. The output is a CSV file with the columns
time, <joint>.position, <joint>.velocity and <joint>.acceleration. The robot needs a fixed base and no closed loops.

Collisions of the links with each other, a table or a cable are not checked: inspect the motion before a robot executes
it, and begin slowly.

It takes some seconds for an arm with seven joints. The estimated time is printed at the beginning, and a terminal
shows a progress bar. --time-limit ends the design with the best trajectory so far.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.cli.joint_table import joint_table
from robot_dynamics.cli.output_files import write_text
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.identification.fourier_trajectory import FourierTrajectory

NAME = "excite"
POSITIVE_ARGUMENTS = ("duration", "rate", "acceleration", "iterations", "harmonics", "time_limit")
MAX_SAMPLES = 1e7


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_robot_arguments(parser)
    parser.add_argument("--output", metavar="FILE.csv", required=True, help="output file of the trajectory")
    parser.add_argument(
        "--duration", type=float, default=20.0, metavar="S", help="duration of the motion (default: %(default)s)"
    )
    parser.add_argument(
        "--harmonics", type=int, default=5, help="number of harmonics of the Fourier series (default: %(default)s)"
    )
    parser.add_argument(
        "--rate", type=float, default=100.0, metavar="HZ", help="sample rate of the output (default: %(default)s)"
    )
    parser.add_argument(
        "--acceleration",
        type=float,
        default=np.inf,
        metavar="A",
        help="acceleration limit of all joints [rad/s² or m/s²] (default: none)",
    )
    parser.add_argument(
        "--margin",
        type=float,
        default=0.05,
        metavar="PART",
        help="part of the position range that the motion leaves free at each end, and of the velocity limit "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--iterations",
        type=int,
        default=50,
        help="maximum number of optimiser iterations (default: %(default)s)",
    )
    parser.add_argument(
        "--time-limit",
        type=float,
        default=np.inf,
        metavar="S",
        help="stop after this time with the best trajectory so far (default: none)",
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of the random initial trajectories (default: %(default)s)"
    )


def run(arguments: Namespace) -> None:
    """Design the trajectory and write it."""
    dynamics = Dynamics(load_robot_argument(arguments))
    _check_arguments(arguments)
    from robot_dynamics.cli.progress import progress_bar
    from robot_dynamics.identification.excitation import design_excitation
    from robot_dynamics.identification.fourier_trajectory import joint_bounds
    from robot_dynamics.identification.identification_model import build_identification_model
    from robot_dynamics.recordings.drives import direct_drives

    model = build_identification_model(dynamics, direct_drives(dynamics.joint_names), compiled=False)
    bounds = joint_bounds(dynamics, arguments.acceleration, arguments.margin)
    parameter_count = len(model.names)

    def print_estimate(seconds: float) -> None:
        print(
            f"{arguments.iterations} iterations for {parameter_count} parameters: about {max(1, round(seconds))} s",
            flush=True,
        )

    with progress_bar(arguments.iterations, "condition number", " iterations") as show_progress:
        excitation = design_excitation(
            model,
            bounds,
            duration=arguments.duration,
            harmonics=arguments.harmonics,
            iterations=arguments.iterations,
            seed=arguments.seed,
            time_limit=arguments.time_limit,
            on_estimate=print_estimate,
            on_iteration=lambda done, _: show_progress(done),
        )
    write_text(arguments.output, trajectory_csv(excitation.trajectory, dynamics.joint_names, arguments.rate))
    if not excitation.complete:
        print(
            f"time limit of {arguments.time_limit:g} s reached after {excitation.iterations} of {arguments.iterations} "
            "iterations: this is the best trajectory so far"
        )
    print(
        f"{arguments.output}: {arguments.duration:g} s, condition number {excitation.condition:.3g} of "
        f"{parameter_count} parameters"
    )


def trajectory_csv(trajectory: FourierTrajectory, names: Sequence[str], rate: float) -> str:
    """Format samples of a trajectory as CSV, its first and last point included.

    names: (n,) of the joints; rate: samples per second.
    """
    times = np.linspace(0, trajectory.duration, round(trajectory.duration * rate) + 1)
    signals = dict(zip(("position", "velocity", "acceleration"), trajectory(times), strict=True))
    return joint_table(times, names, signals)


def _check_arguments(arguments: Namespace) -> None:
    for name in POSITIVE_ARGUMENTS:
        value = getattr(arguments, name)
        if not value > 0:
            raise InvalidInputError(f"--{name.replace('_', '-')} {value:g}: more than 0 is needed")
    if not arguments.duration * arguments.rate < MAX_SAMPLES:
        raise InvalidInputError(
            f"--duration {arguments.duration:g} --rate {arguments.rate:g}: less than 10 million samples are needed"
        )
