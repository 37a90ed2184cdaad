"""Identify a robot from recordings: fit base parameters, frictions and offsets to measured efforts.

Prints a verdict on how well the recordings determine the robot, the residuals of each joint, and the parameters with
their standard deviations. The description of --robot needs the right geometry; its masses may be wrong or missing.
--output writes a description with the physically consistent inertias that are nearest to the fit. --output-drives
writes what a description cannot contain: offsets of efforts, drive gains, and friction and rotor inertia of motors that
turn with several joints. replay-check reads both. --gains identifies drive gains too. The exit status is 0, or 3 if the
recordings do not determine the robot.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from robot_dynamics.cli.executors import add_executor_arguments, open_executor
from robot_dynamics.cli.friction_arguments import add_friction_argument, dynamics_to_identify, parse_friction
from robot_dynamics.cli.output_files import (
    YAML_ENDINGS,
    YAML_HINT,
    allow_closed_stdout,
    check_ending,
    check_writable,
    write_text,
)
from robot_dynamics.cli.payload_arguments import add_gain_arguments, parse_known_payloads
from robot_dynamics.cli.recording_arguments import add_band_argument, add_recording_arguments, open_recordings
from robot_dynamics.errors import MissingPackageError, RecordingError, SingularModelError
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml

if TYPE_CHECKING:
    from robot_dynamics.cli.friction_report import FrictionResults
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.identification.drive_gains import DriveGains
    from robot_dynamics.identification.fitting import Fit
    from robot_dynamics.identification.identification_model import EffortModel, JointEffortModel
    from robot_dynamics.identification.physical_consistency import ConsistentRobot, WrittenRobot
    from robot_dynamics.identification.samples import Samples
    from robot_dynamics.recordings.recording import Recording

NAME = "identify"
ModelT = TypeVar("ModelT", bound="EffortModel")
MAX_HOLD_OUT = 0.95
NOT_DETERMINED_EXIT_STATUS = 3


class Identification(NamedTuple):
    """A fit, the samples that were fitted and those for validation, and the drive gains if they were identified.

    source: samples for other models; friction: friction models of the joints, None if none was tried.
    """

    fit: Fit
    samples: Samples[JointEffortModel]
    validation: Samples[JointEffortModel] | None
    source: _SampleSource
    gains: DriveGains | None = None
    friction: FrictionResults | None = None

    def samples_of_written(
        self, consistent: ConsistentRobot
    ) -> tuple[Samples[JointEffortModel], Samples[JointEffortModel] | None]:
        """The samples, and those for validation, with the loads of the consistent robot if friction depends on them."""
        model = self.fit.model
        if not model.has_load_terms:
            return self.samples, self.validation
        values = consistent.values[: len(model.parameter_indices)]
        model = model.with_terms(model.terms, values)
        return self.source.training(model), self.source.validation(model)


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_recording_arguments(parser, ("recordings", "+"))
    add_executor_arguments(parser)
    add_band_argument(parser)
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
    add_friction_argument(parser)
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


def run(arguments: Namespace) -> int:
    """Identify the robot, print the results, write the output files, and return the exit status."""
    for option, path in (("--output", arguments.output), ("--output-drives", arguments.output_drives)):
        if path is not None:
            check_ending(path, YAML_ENDINGS, option, YAML_HINT)
    for path in filter(None, (arguments.output, arguments.output_drives, arguments.json)):
        check_writable(path)
    friction = parse_friction(arguments)
    dynamics, recordings = open_recordings(arguments, [*arguments.recordings, *arguments.validate])
    if not 0 <= arguments.hold_out < MAX_HOLD_OUT:
        raise RecordingError(f"--hold-out {arguments.hold_out:g}: a part of 0 to {MAX_HOLD_OUT} is needed")
    if arguments.hold_out and arguments.validate:
        raise RecordingError("--hold-out and --validate exclude each other: use one of the two")
    from robot_dynamics.cli.identification_report import IdentificationResults, as_dict, print_results
    from robot_dynamics.identification.alternatives import try_alternatives
    from robot_dynamics.identification.determination import judge_determination
    from robot_dynamics.identification.fitting import select_essential_parameters
    from robot_dynamics.identification.physical_consistency import import_convex_solver
    from robot_dynamics.recordings.drives import write_drives

    writes_robot = bool(arguments.output or arguments.output_drives)
    if writes_robot:
        import_convex_solver()  # fails before the computation if the solver is missing
    with open_executor(arguments) as executor:
        identification = identify(arguments, dynamics_to_identify(dynamics, friction), recordings, executor)
        written, notes = _compute_written_robot(identification, is_required=writes_robot)
    fit = identification.fit
    results = IdentificationResults(
        fit=fit,
        essential=select_essential_parameters(fit),
        determination=judge_determination(fit),
        written=written,
        alternatives=try_alternatives(fit),
        gains=identification.gains,
        friction=identification.friction,
        notes=notes,
    )
    try:  # files first: the reader of stdout may be gone. Where a file cannot be written, the results are printed
        if written is not None and arguments.output:
            write_text(arguments.output, write_mdh_yaml(written.consistent.robot))
        if written is not None and arguments.output_drives:
            write_text(arguments.output_drives, write_drives(written.consistent.drives))
        if arguments.json:
            write_text(arguments.json, json.dumps(as_dict(results), indent=1) + "\n")
    finally:
        with allow_closed_stdout():
            print_results(results)
    return NOT_DETERMINED_EXIT_STATUS if results.determination.verdict == "not determined" else 0


def _compute_written_robot(
    identification: Identification, *, is_required: bool
) -> tuple[WrittenRobot | None, tuple[str, ...]]:
    """Compute the physically consistent robot with its residuals, and notes if that is impossible and not required."""
    from robot_dynamics.identification.physical_consistency import WrittenRobot, fit_consistent_robot

    try:
        consistent = fit_consistent_robot(identification.fit)
    except MissingPackageError as error:
        if is_required:
            raise
        return None, (f"the physically consistent robot was not computed: {error}",)
    except SingularModelError as error:
        if is_required:
            raise
        return None, (str(error),)
    samples, validation = identification.samples_of_written(consistent)
    return (
        WrittenRobot(
            consistent,
            samples.quality(consistent.values),
            None if validation is None else validation.quality(consistent.values),
        ),
        (),
    )


@dataclass(frozen=True)
class _SampleSource:
    """Samples of opened recordings, those for validation last, with the settings of the arguments."""

    arguments: Namespace
    recordings: list[Recording]
    executor: Executor | None

    def training(self, model: ModelT) -> Samples[ModelT]:
        """Samples to fit with the columns of a model."""
        return self._samples(self._fitted, model, 0.0, 1 - self.arguments.hold_out)

    def validation(self, model: ModelT) -> Samples[ModelT] | None:
        """Samples for validation with the columns of a model, None if there are none."""
        if self.arguments.hold_out:
            return self._samples(self._fitted, model, 1 - self.arguments.hold_out, 1.0)
        rest = self.recordings[len(self.arguments.recordings) :]
        return self._samples(rest, model, 0.0, 1.0) if rest else None

    @property
    def _fitted(self) -> list[Recording]:
        return self.recordings[: len(self.arguments.recordings)]

    def _samples(self, recordings: list[Recording], model: ModelT, start: float, end: float) -> Samples[ModelT]:
        from robot_dynamics.cli.progress import progress_wrapper
        from robot_dynamics.identification.samples import Samples

        return Samples(
            recordings,
            model,
            cutoff=self.arguments.cutoff,
            band=self.arguments.band,
            start_fraction=start,
            end_fraction=end,
            executor=self.executor,
            progress=lambda items, total: progress_wrapper(total, "recordings", unit=" parts")(items),
        )


def identify(
    arguments: Namespace, dynamics: Dynamics, recordings: list[Recording], executor: Executor | None
) -> Identification:
    """Fit the parameters, and the gains with --gains, to opened recordings, those for validation last."""
    from robot_dynamics.identification.drive_gains import PayloadIdentificationModel, identify_gains
    from robot_dynamics.identification.fitting import fit_parameters
    from robot_dynamics.identification.identification_model import build_identification_model

    payloads = parse_known_payloads(arguments, dynamics.robot, recordings)
    rotor_inertia = not arguments.no_rotor_inertia
    robot_model = build_identification_model(dynamics, recordings[0].drives, rotor_inertia=rotor_inertia)
    model: JointEffortModel = robot_model
    source = _SampleSource(arguments, recordings, executor)
    gains = None
    if arguments.gains:
        names = [recording.name for recording in recordings[: len(arguments.recordings)]]
        fitted = {name: payloads[name] for name in names if name in payloads}
        gains = identify_gains(source.training(PayloadIdentificationModel(robot_model, fitted)))
        source = replace(source, recordings=[replace(recording, drives=gains.drives) for recording in recordings])
        model = gains.model.with_same_payloads(payloads)
    samples = source.training(model)
    validation = source.validation(model)
    fit = fit_parameters(samples, method=arguments.method, validation=validation)
    if gains is not None:
        return Identification(gains.include_gain_uncertainty(fit), samples, validation, source, gains)
    return _identify_friction(Identification(fit, samples, validation, source))


def _identify_friction(identification: Identification) -> Identification:
    """Return the identification with the friction models of --friction."""
    from robot_dynamics.cli.friction_report import FrictionResults
    from robot_dynamics.identification.fitting import fit_parameters
    from robot_dynamics.identification.friction_fit import choose_friction_model

    source = identification.source
    request = parse_friction(source.arguments)
    plain = identification.fit
    if not request.models:
        return identification
    model, choice = choose_friction_model(plain, source.training, request.models, required=request.required)
    friction = FrictionResults(request.models, request.required, choice, plain)
    if not choice.terms:
        return identification._replace(friction=friction)
    samples = source.training(model)
    validation = source.validation(model)
    fit = fit_parameters(samples, method=plain.method, validation=validation)
    return Identification(fit, samples, validation, source, friction=friction)
