"""Report what a motion costs: efforts against limits, power, energy, and how fast it could be.

The motion is a bag or a CSV file as for replay-check, whose signals are filtered, or a planned motion: a CSV file with
the columns time, <joint>.position, <joint>.velocity and <joint>.acceleration of all independent joints, as excite
writes it, which is taken as it is. With --planned the positions of a CSV file are enough. Efforts are those of the
model, friction included. Limits of efforts and velocities are those of the description, and of motors in the file of
--drives, with torque-speed curves.

The report says by which factor the time of the whole motion could be scaled until the first limit is reached. --retime
finds the fastest motion along the same path, and writes it with --output. The robot needs a fixed base and a motor at
each independent joint.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.cli.joint_table import joint_table
from robot_dynamics.cli.output_files import check_ending, check_writable, output_file, write_text
from robot_dynamics.cli.recording_arguments import add_signal_arguments, open_recordings
from robot_dynamics.cli.robot_arguments import add_robot_arguments
from robot_dynamics.cli.text_table import print_table
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.optional_packages import import_optional

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robot_dynamics.cli.text_table import Cell
    from robot_dynamics.motions.actuator_limits import ActuatorLimits
    from robot_dynamics.motions.effort_model import EffortModel
    from robot_dynamics.motions.motion_cost import MotionCost
    from robot_dynamics.motions.retiming import RetimedMotion
    from robot_dynamics.motions.sampled_motion import SampledMotion
    from robot_dynamics.recordings.recording import Recording

NAME = "motion-report"
PICTURES = (".png", ".pdf", ".svg")
MOTION = ".csv"
ROUNDING = 1e-12  # relative


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_robot_arguments(parser)
    parser.add_argument("motion", metavar="MOTION", help="bag or CSV file with the motion")
    add_signal_arguments(parser)
    parser.add_argument(
        "--planned",
        action="store_true",
        help="the positions of the CSV file are planned, not measured: differentiate a spline through them, without a "
        "filter; velocities, accelerations and efforts are not read",
    )
    parser.add_argument(
        "--retime",
        action="store_true",
        help="find the fastest motion along the path within the limits, from rest to rest; pauses stay",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        action="append",
        default=[],
        help="picture of efforts, speeds and power over time (.png, .pdf or .svg), or the re-timed motion (.csv), at "
        "the rate of the motion or that of --rate; repeat for both",
    )
    parser.add_argument("--json", metavar="FILE", help="write all figures as JSON")


def run(arguments: Namespace) -> None:
    """Print the report, and write the outputs."""
    _check_outputs(arguments)
    dynamics, (recording,) = open_recordings(arguments, [arguments.motion])
    from robot_dynamics.motions.actuator_limits import find_actuator_limits
    from robot_dynamics.motions.effort_model import EffortModel
    from robot_dynamics.motions.motion_cost import compute_motion_cost
    from robot_dynamics.motions.retiming import retime
    from robot_dynamics.motions.sampled_motion import describe_contradictions

    model = EffortModel(dynamics, recording.drives)
    limits = find_actuator_limits(dynamics.robot, recording.drives)
    motion = _read_motion(arguments, recording, dynamics.joint_names)
    cost = compute_motion_cost(model, limits, motion)
    source = "planned" if motion.cutoff is None else f"filtered at {motion.cutoff:g} Hz"
    print(
        f"{arguments.motion} of {dynamics.robot.name!r}: {len(motion.times)} samples, {cost.duration:.4g} s, {source}"
    )
    if motion.cutoff is None:
        for sentence in describe_contradictions(motion, dynamics.joint_names):
            print(f"  note: {sentence}")
    print_cost(cost)
    print(f"\n{describe_time_scale(cost)}")
    retimed = None
    if arguments.retime:
        retimed = retime(model, limits, motion)
        print(describe_retiming(model, limits, cost, retimed))
        if motion.cutoff is not None:
            print(
                f"  note: begins at {motion.times[0]:.4g} s and ends at {motion.times[-1]:.4g} s of the recording, "
                "because the filter needs samples on both sides. If the positions are planned, use --planned"
            )
    for path in arguments.output:
        _write_output(path, arguments, model, limits, motion, cost, retimed)
    if arguments.json is not None:
        write_text(arguments.json, json.dumps(_to_json(cost, retimed, dynamics.joint_names), indent=2) + "\n")


def _check_outputs(arguments: Namespace) -> None:
    """Refuse outputs that cannot be written, before the computation."""
    for path in arguments.output:
        ending = check_ending(path, (*PICTURES, MOTION), "--output")
        if ending == MOTION and not arguments.retime:
            raise InvalidInputError(f"--output {path}: the re-timed motion is written with --retime, which is missing")
        if ending in PICTURES:
            import_optional("matplotlib.figure", "--output")
        check_writable(path)
    if arguments.json is not None:
        check_writable(arguments.json)


def _read_motion(arguments: Namespace, recording: Recording, joint_names: Sequence[str]) -> SampledMotion:
    """Read a planned motion as it is, and others through the filter of recordings."""
    from robot_dynamics.motions.sampled_motion import planned_motion, recorded_motion_samples

    options = (arguments.cutoff, arguments.start, arguments.end, arguments.samples)
    is_whole = all(option is None for option in options)  # with one of them, the signals are those of a recording
    if is_whole:
        planned = planned_motion(Path(arguments.motion), joint_names, arguments.planned)
        if planned is not None:
            return planned
    if arguments.planned:
        reason = "it is no CSV file with time and <joint>.position of all independent joints"
        if not is_whole:
            reason = (
                "leave out --cutoff, --from, --to and --samples: a planned motion is taken as a whole, without a filter"
            )
        raise InvalidInputError(f"{arguments.motion} with --planned: {reason}")
    return recorded_motion_samples(recording, arguments.cutoff, arguments.rate)


def print_cost(cost: MotionCost) -> None:
    """Print what a motion costs as tables."""
    rows: list[list[Cell]] = [
        [
            actuator.name,
            "N" if actuator.is_prismatic else "N m",
            _rounded(actuator.rms_effort),
            _rounded(actuator.peak_effort),
            _rounded(actuator.peak_time),
            _rounded(actuator.effort_limit),
            _percent(actuator.effort_usage, actuator.effort_limit),
            _rounded(actuator.peak_speed),
            _rounded(actuator.speed_limit),
            _percent(actuator.speed_usage, actuator.speed_limit),
        ]
        for actuator in cost.actuators
    ]
    header = ["joint", "unit", "RMS", "peak", "at [s]", "limit", "used [%]", "speed", "limit", "used [%]"]
    print_table(header, rows, "Efforts and speeds [rad/s or m/s]")
    energies: list[list[Cell]] = [
        [
            joint.name,
            _rounded(joint.supplied),
            _rounded(joint.regenerated),
            _rounded(joint.friction),
            _rounded(joint.peak_power),
            _rounded_mean(joint.mean_power, joint.peak_power),
            _rounded(joint.position_margin),
        ]
        for joint in cost.joints
    ]
    totals = [sum(getattr(joint, key) for joint in cost.joints) for key in ("supplied", "regenerated", "friction")]
    peak = float(np.abs(cost.powers.sum(axis=1)).max())
    mean = sum(joint.mean_power for joint in cost.joints)
    energies.append(["all", *map(_rounded, totals), _rounded(peak), _rounded_mean(mean, peak), None])
    header = ["joint", "supplied", "regenerated", "friction", "peak power", "mean power", "to position limit"]
    print_table(header, energies, "Energy [J], power [W], and least distance from a position limit [rad or m]")
    print(f"\na supply common to all joints delivers {cost.shared_energy:.4g} J")


def describe_time_scale(cost: MotionCost) -> str:
    """Return sentences about the limits and the scaling of time."""
    if cost.is_too_heavy:
        number = int(cost.effort_usages.max(axis=0).argmax())
        return f"limits are passed however slow the motion is, first by {cost.actuators[number].name}"
    verdict = "no limit is passed" if cost.is_within_limits else "limits are passed"
    if cost.time_scale is None:
        return f"{verdict}; no limit is reached however fast the motion is"
    scale = cost.time_scale
    seconds = f"{cost.duration * scale.scale:.4g} s instead of {cost.duration:.4g} s"
    can = "can take" if scale.scale <= 1 else "must take"
    return (
        f"{verdict}: the motion {can} {scale.scale:.4g} times its time, {seconds}. {scale.actuator} then reaches its "
        f"{scale.quantity} limit, at {cost.times[scale.sample] * scale.scale:.4g} s"
    )


def describe_retiming(model: EffortModel, limits: ActuatorLimits, cost: MotionCost, retimed: RetimedMotion) -> str:
    """Return sentences about a re-timed motion: its duration, and its limits."""
    motion = retimed.motion
    usages = limits.usage(model.efforts(model.close_loops(motion.q), motion.qd, motion.qdd), motion.qd)
    both = np.maximum(*usages)
    shares = [
        f"{name} {share:.0%}"
        for name, share in zip(limits.names, motion.weights @ (both > 0.99) / motion.duration, strict=True)
        if share >= 0.005
    ]
    ratio = motion.duration / cost.duration
    return "\n".join(
        [
            f"re-timed: {motion.duration:.4g} s, {ratio:.4g} times its time, from rest to rest",
            f"  limits: at {len(motion.times)} points at most {both.max():.3%} of a limit is used",
            f"  near its limit: {', '.join(shares) or 'no joint'} of the time",
            f"  path: within {retimed.deviation.max():.2g} rad or m of the samples",
        ]
    )


def _write_output(
    path: str,
    arguments: Namespace,
    model: EffortModel,
    limits: ActuatorLimits,
    motion: SampledMotion,
    cost: MotionCost,
    retimed: RetimedMotion | None,
) -> None:
    """Write the re-timed motion, or a picture of it, or of the motion itself."""
    if Path(path).suffix.lower() == MOTION:
        assert retimed is not None, "checked before"
        rate = arguments.rate or (len(motion.times) - 1) / motion.duration
        write_text(path, motion_csv(model, retimed.resample(rate)))
        return
    from robot_dynamics.motions.motion_cost import compute_motion_cost
    from robot_dynamics.motions.motion_plot import draw_motion_cost  # here, because it is slow to import

    shown = cost if retimed is None else compute_motion_cost(model, limits, retimed.motion)
    title = f"{model.robot.name}: {Path(arguments.motion).name}{', re-timed' if retimed is not None else ''}"
    with output_file(path) as file:
        draw_motion_cost(file, shown, title)


def motion_csv(model: EffortModel, motion: SampledMotion) -> str:
    """Format a motion as CSV, with its efforts."""
    efforts = model.efforts(model.close_loops(motion.q), motion.qd, motion.qdd)
    signals = {"position": motion.q, "velocity": motion.qd, "acceleration": motion.qdd, "effort": efforts}
    return joint_table(motion.times, model.dynamics.joint_names, signals)


def _to_json(cost: MotionCost, retimed: RetimedMotion | None, joint_names: Sequence[str]) -> dict[str, Any]:
    """Return all figures as data for JSON; null stands for a limit that does not exist."""
    figures: dict[str, Any] = {
        "duration": cost.duration,
        "within_limits": cost.is_within_limits,
        "too_heavy": cost.is_too_heavy,
        "shared_energy": cost.shared_energy,
        "actuators": [_finite_values(asdict(actuator)) for actuator in cost.actuators],
        "joints": [_finite_values(asdict(joint)) for joint in cost.joints],
        "time_scale": None if cost.time_scale is None else asdict(cost.time_scale),
    }
    if retimed is not None:
        figures["retimed"] = {
            "duration": retimed.motion.duration,
            "deviation": dict(zip(joint_names, retimed.deviation.tolist(), strict=True)),
        }
    return figures


def _finite_values(values: dict[str, Any]) -> dict[str, Any]:
    return {key: None if isinstance(value, float) and not isfinite(value) else value for key, value in values.items()}


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _rounded_mean(mean: float, peak: float) -> float:
    """Zero where the mean is what rounding leaves of values up to the peak."""
    return _rounded(mean) if abs(mean) > ROUNDING * abs(peak) else 0.0


def _percent(part: float, limit: float) -> float | None:
    """Percents to a tenth: 100.2 is beyond a limit."""
    return round(100 * part, 1) if isfinite(limit) else None
