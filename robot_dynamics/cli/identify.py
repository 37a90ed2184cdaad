"""Identify a robot from recordings: base parameters, frictions and offsets that fit measured efforts.

Prints how well they fit, and how certain they are. With --output the description is written back with inertias that
bodies can have, nearest to the fit; with --output-drives what a description has no place for: offsets of joints, and
losses that joints feel of each other. Both are what replay-check takes. With --gains, gains of drives are found too.
"""

import json
import textwrap
from dataclasses import replace

import numpy as np

from robot_dynamics.cli.executors import add_executor_arguments, open_executor
from robot_dynamics.cli.output_files import check_yaml_suffix, write_text
from robot_dynamics.cli.payload_arguments import add_gain_arguments, parse_known_payloads
from robot_dynamics.cli.recording_arguments import add_recording_arguments, open_recordings
from robot_dynamics.cli.text_table import print_table
from robot_dynamics.errors import RecordingError
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml

NAME = "identify"


def add_arguments(parser):
    add_recording_arguments(parser, ("recordings", "+"))
    add_executor_arguments(parser)
    parser.add_argument("--band", type=float, metavar="HZ",
                        help="of the filter of efforts and regressor; default: the cut-off, at most 10")  # fmt: skip
    parser.add_argument("--method", choices=("weighted", "ordinary", "robust"), default="weighted",
                        help="of least squares (default: %(default)s)")  # fmt: skip
    parser.add_argument("--no-rotor-inertia", action="store_true", help="rotors have no parameters of their own")
    add_gain_arguments(parser)
    parser.add_argument("--hold-out", type=float, default=0.0, metavar="PART",
                        help="the last part of each recording, 0 to 1, to validate with")  # fmt: skip
    parser.add_argument("--validate", action="append", default=[], metavar="RECORDING",
                        help="another recording to validate with, several times for several")  # fmt: skip
    parser.add_argument("--output", metavar="FILE.yaml", help="write the robot as an MDH table")
    parser.add_argument("--output-drives", metavar="FILE.yaml", help="write the drives")
    parser.add_argument("--json", metavar="FILE", help="write all figures for machines")


def run(told):
    for option, path in (("--output", told.output), ("--output-drives", told.output_drives)):
        check_yaml_suffix(option, path)
    dynamics, recordings = open_recordings(told, [*told.recordings, *told.validate])
    if not 0 <= told.hold_out < 0.95:
        raise RecordingError(f"--hold-out {told.hold_out:g}: a part of the recording, 0 to 0.95, is needed")
    if told.hold_out and told.validate:
        raise RecordingError("--hold-out and --validate: one of the two says what to validate with")
    from robot_dynamics.identification.fitting import select_essential_parameters
    from robot_dynamics.identification.physical_consistency import fit_consistent_robot, import_convex_solver
    from robot_dynamics.recordings.drives import write_drives

    if told.output or told.output_drives:
        import_convex_solver()  # missing, it stops the verb before the work
    with open_executor(told) as executor:
        fit, samples, gains = _fitted(told, dynamics, recordings, executor)
        nearest = fit_consistent_robot(fit) if told.output or told.output_drives else None
        checked = None if nearest is None else samples.quality(nearest.values)
    needed = select_essential_parameters(fit)
    print_fit(fit, needed, checked)
    if gains is not None:
        print_gains(gains)
    if told.output:
        write_text(told.output, write_mdh_yaml(nearest.robot))
    if told.output_drives:
        write_text(told.output_drives, write_drives(nearest.drives))
    if told.json:
        write_text(told.json, json.dumps(as_dict(fit, needed, checked, gains), indent=1) + "\n")


def _fitted(told, dynamics, recordings, executor):
    """(Fit, Samples that were fitted, Gains or None) of opened recordings."""
    from robot_dynamics.cli.progress import progress_wrapper
    from robot_dynamics.identification.drive_gains import PayloadIdentificationModel, identify_gains
    from robot_dynamics.identification.fitting import fit_parameters
    from robot_dynamics.identification.identification_model import build_identification_model
    from robot_dynamics.identification.samples import Samples

    loads = parse_known_payloads(told, dynamics.robot, recordings)
    columns = build_identification_model(dynamics, recordings[0].drives, rotor_inertia=not told.no_rotor_inertia)

    def samples_of(recordings, columns, **part):
        progress = progress_wrapper(len(recordings), "recordings", unit=" recordings")
        return Samples(
            recordings, columns, cutoff=told.cutoff, band=told.band, executor=executor, progress=progress, **part
        )

    many, gains, validation = len(told.recordings), None, None
    if told.gains:
        loaded = PayloadIdentificationModel(columns, tuple(dict.fromkeys(loads.values())), loads)
        gains = identify_gains(samples_of(recordings[:many], loaded, end_fraction=1 - told.hold_out))
        recordings, columns = [replace(recording, drives=gains.drives) for recording in recordings], gains.model
    samples = samples_of(recordings[:many], columns, end_fraction=1 - told.hold_out)
    if told.hold_out:
        validation = samples_of(recordings[:many], columns, start_fraction=1 - told.hold_out)
    elif told.validate:
        validation = samples_of(recordings[many:], columns)
    fit = fit_parameters(samples, method=told.method, validation=validation)
    return (fit if gains is None else gains.include_gain_uncertainty(fit)), samples, gains


def print_fit(fit, needed, consistent):
    """Print a Fit; needed: (P,) which parameters are essential; consistent: the Quality of the robot that is written,
    None where none is."""
    columns = fit.model
    print(f"{columns.inertial_count} base parameters with {len(columns.parameter_indices) - columns.inertial_count} of friction and "
          f"{len(columns.names) - len(columns.parameter_indices)} of drives, {fit.method} least squares over {fit.training_quality.samples} "
          f"samples, condition number {fit.condition:.3g}")  # fmt: skip
    for sentence in fit.notes:
        print(f"note: {sentence}")
    for sentence in fit.warnings:
        print(f"warning: {sentence}")
    parts = [("RMS", fit.training_quality, "rms"), ("RMS/spread", fit.training_quality, None),
             ("unfiltered", fit.training_quality, "rms_unfiltered"), ("validated", fit.validation_quality, "rms"),
             ("validated, unfiltered", fit.validation_quality, "rms_unfiltered"), ("consistent", consistent, "rms")]  # fmt: skip
    rows = []
    for number, name in enumerate(columns.dynamics.joint_names):
        cells = [None if quality is None else (getattr(quality, key) if key else quality.rms / quality.spread)[number]
                 for _, quality, key in parts]  # fmt: skip
        rows.append([name, *(None if cell is None else float(f"{cell:.3g}") for cell in cells)])
    print_table(["joint", *(title for title, _, _ in parts)], rows, "Measured less fitted effort [N m or N]")
    rows = [[textwrap.shorten(expression, 60, placeholder=" ..."), float(f"{value:.4g}"), float(f"{deviation:.2g}"),
             "" if essential else "no"] for expression, value, deviation, essential in
            zip(columns.expressions, fit.values, fit.standard_deviations, needed, strict=True)]  # fmt: skip
    print_table(["parameter", "value", "deviation", "essential"], rows, "Parameters, SI")


def print_gains(gains):
    """Print Gains of drives."""
    rows = [[name, float(f"{gain:.5g}"), float(f"{deviation:.2g}")] for name, gain, deviation in
            zip(gains.drives.names, gains.drives.effort_gains, gains.standard_deviations, strict=True)]  # fmt: skip
    print_table(["motor", "gain", "deviation"], rows, "Efforts of motors by what was measured")


def as_dict(fit, needed, consistent, gains=None):
    """Plain data, for JSON."""

    def quality(told):
        return None if told is None else {key: np.asarray(value).tolist() for key, value in vars(told).items()}

    parameters = [{"name": name, "sum": expression, "value": float(value), "deviation": float(deviation),
                   "essential": bool(essential)} for name, expression, value, deviation, essential in
                  zip(fit.model.names, fit.model.expressions, fit.values, fit.standard_deviations, needed,
                      strict=True)]  # fmt: skip
    drives = None if gains is None else [
        {"name": name, "gain": float(gain), "deviation": float(deviation)} for name, gain, deviation in
        zip(gains.drives.names, gains.drives.effort_gains, gains.standard_deviations, strict=True)]  # fmt: skip
    return {
        "format": 1, "robot": fit.model.dynamics.robot.name, "joints": list(fit.model.dynamics.joint_names),
        "method": fit.method, "condition": fit.condition, "inertial": fit.model.inertial_count, "parameters": parameters,
        "trained": quality(fit.training_quality), "validated": quality(fit.validation_quality), "consistent": quality(consistent),
        "warnings": list(fit.warnings), "notes": list(fit.notes), "gains": drives,
    }  # fmt: skip
