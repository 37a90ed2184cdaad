"""Identify a robot from recordings: fit base parameters, frictions and offsets to measured efforts.

Prints the residuals of each joint, and the parameters with their standard deviations. The description of --robot needs
the right geometry; its masses may be wrong or missing. --output writes a description with the physically consistent
inertias that are nearest to the fit. --output-drives writes what a description cannot contain: offsets of efforts,
drive gains, and friction and rotor inertia of motors that turn with several joints. replay-check reads both. --gains
identifies drive gains too.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from concurrent.futures import Executor
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from robot_dynamics.cli.executors import add_executor_arguments, open_executor
from robot_dynamics.cli.output_files import (
    YAML_ENDINGS,
    YAML_HINT,
    allow_closed_stdout,
    check_ending,
    check_writable,
    write_text,
)
from robot_dynamics.cli.payload_arguments import add_gain_arguments, parse_known_payloads
from robot_dynamics.cli.recording_arguments import add_recording_arguments, open_recordings
from robot_dynamics.errors import RecordingError
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.identification.drive_gains import DriveGains
    from robot_dynamics.identification.fitting import Fit
    from robot_dynamics.identification.identification_model import EffortModel, JointEffortModel
    from robot_dynamics.identification.samples import Samples
    from robot_dynamics.recordings.recording import Recording

NAME = "identify"
ModelT = TypeVar("ModelT", bound="EffortModel")
MAX_HOLD_OUT = 0.95


class Identification(NamedTuple):
    """A fit, the samples that were fitted, and the drive gains if they were identified."""

    fit: Fit
    samples: Samples[JointEffortModel]
    gains: DriveGains | None


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_recording_arguments(parser, ("recordings", "+"))
    add_executor_arguments(parser)
    parser.add_argument(
        "--band",
        type=float,
        metavar="HZ",
        help="cut-off frequency of the filter of efforts and regressor; default: --cutoff, at most 10",
    )
    parser.add_argument(
        "--method",
        choices=("weighted", "ordinary", "robust"),
        default="weighted",
        help="least squares weighted by the variance of each joint, ordinary, or robust against outliers such as "
        "collisions (default: %(default)s)",
    )
    parser.add_argument(
        "--no-rotor-inertia", action="store_true", help="do not identify rotor inertias as separate parameters"
    )
    add_gain_arguments(parser)
    parser.add_argument(
        "--hold-out",
        type=float,
        default=0.0,
        metavar="PART",
        help="part of each recording, at its end, that is used for validation and not for the fit: 0.3 is the last "
        "30 %% (default: 0)",
    )
    parser.add_argument(
        "--validate",
        action="append",
        default=[],
        metavar="RECORDING",
        help="recording that is used for validation and not for the fit; repeat for several recordings",
    )
    parser.add_argument("--output", metavar="FILE.yaml", help="write the identified robot as an MDH table")
    parser.add_argument(
        "--output-drives", metavar="FILE.yaml", help="write the identified drives, for --drives of replay-check"
    )
    parser.add_argument("--json", metavar="FILE", help="write all results as JSON")


def run(arguments: Namespace) -> None:
    """Identify the robot, print the results and write the output files."""
    for option, path in (("--output", arguments.output), ("--output-drives", arguments.output_drives)):
        if path is not None:
            check_ending(path, YAML_ENDINGS, option, YAML_HINT)
    for path in filter(None, (arguments.output, arguments.output_drives, arguments.json)):
        check_writable(path)
    dynamics, recordings = open_recordings(arguments, [*arguments.recordings, *arguments.validate])
    if not 0 <= arguments.hold_out < MAX_HOLD_OUT:
        raise RecordingError(f"--hold-out {arguments.hold_out:g}: a part of 0 to {MAX_HOLD_OUT} is needed")
    if arguments.hold_out and arguments.validate:
        raise RecordingError("--hold-out and --validate exclude each other: use one of the two")
    from robot_dynamics.cli.identification_report import as_dict, print_fit, print_gains
    from robot_dynamics.identification.fitting import select_essential_parameters
    from robot_dynamics.identification.physical_consistency import fit_consistent_robot, import_convex_solver
    from robot_dynamics.recordings.drives import write_drives

    writes_robot = bool(arguments.output or arguments.output_drives)
    if writes_robot:
        import_convex_solver()  # fails before the computation if the solver is missing
    with open_executor(arguments) as executor:
        fit, samples, gains = identify(arguments, dynamics, recordings, executor)
        consistent = fit_consistent_robot(fit) if writes_robot else None
        consistent_quality = None if consistent is None else samples.quality(consistent.values)
    essential = select_essential_parameters(fit)
    try:  # files first: the reader of stdout may be gone. Where a file cannot be written, the results are printed
        if consistent is not None and arguments.output:
            write_text(arguments.output, write_mdh_yaml(consistent.robot))
        if consistent is not None and arguments.output_drives:
            write_text(arguments.output_drives, write_drives(consistent.drives))
        if arguments.json:
            results = as_dict(fit, essential, consistent_quality, gains)
            write_text(arguments.json, json.dumps(results, indent=1) + "\n")
    finally:
        with allow_closed_stdout():
            print_fit(fit, essential, consistent_quality)
            if gains is not None:
                print_gains(gains)


def identify(
    arguments: Namespace, dynamics: Dynamics, recordings: list[Recording], executor: Executor | None
) -> Identification:
    """Fit the parameters, and the gains with --gains, to opened recordings, those for validation last."""
    from robot_dynamics.cli.progress import progress_wrapper
    from robot_dynamics.identification.drive_gains import PayloadIdentificationModel, identify_gains
    from robot_dynamics.identification.fitting import fit_parameters
    from robot_dynamics.identification.identification_model import build_identification_model
    from robot_dynamics.identification.samples import Samples

    def samples_of(
        recordings: list[Recording], model: ModelT, *, start_fraction: float = 0.0, end_fraction: float = 1.0
    ) -> Samples[ModelT]:
        return Samples(
            recordings,
            model,
            cutoff=arguments.cutoff,
            band=arguments.band,
            start_fraction=start_fraction,
            end_fraction=end_fraction,
            executor=executor,
            progress=progress_wrapper(len(recordings), "recordings", unit=" recordings"),
        )

    payloads = parse_known_payloads(arguments, dynamics.robot, recordings)
    rotor_inertia = not arguments.no_rotor_inertia
    robot_model = build_identification_model(dynamics, recordings[0].drives, rotor_inertia=rotor_inertia)
    model: JointEffortModel = robot_model
    count = len(arguments.recordings)
    training_end = 1 - arguments.hold_out
    gains = None
    if arguments.gains:
        payload_model = PayloadIdentificationModel(robot_model, tuple(dict.fromkeys(payloads.values())), payloads)
        gains = identify_gains(samples_of(recordings[:count], payload_model, end_fraction=training_end))
        recordings = [replace(recording, drives=gains.drives) for recording in recordings]
        model = gains.model
    samples = samples_of(recordings[:count], model, end_fraction=training_end)
    validation = None
    if arguments.hold_out:
        validation = samples_of(recordings[:count], model, start_fraction=training_end)
    elif arguments.validate:
        validation = samples_of(recordings[count:], model)
    fit = fit_parameters(samples, method=arguments.method, validation=validation)
    return Identification(fit if gains is None else gains.include_gain_uncertainty(fit), samples, gains)
