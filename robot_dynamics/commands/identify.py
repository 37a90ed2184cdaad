"""Identify a robot from recordings: base parameters, frictions and offsets that fit measured efforts.

Prints how well they fit, and how certain they are. With --output the description is written back with inertias that
bodies can have, nearest to the fit; with --output-drives what a description has no place for: offsets of joints, and
losses that joints feel of each other. Both are what replay-check takes. With --gains, gains of drives are found too.
"""

import json
import textwrap
from dataclasses import replace

import numpy as np

from robot_dynamics.commands.known_payloads import add_gain_arguments, carried
from robot_dynamics.commands.recording_arguments import add_recording_arguments, opened
from robot_dynamics.commands.text_table import print_table
from robot_dynamics.commands.workers import add_worker_arguments, workers
from robot_dynamics.commands.written import check_table_ending, write_text
from robot_dynamics.errors import RecordingError
from robot_dynamics.model.formats.mdh_yaml_writer import write_mdh_yaml

NAME = "identify"


def add_arguments(parser):
    add_recording_arguments(parser, ("recordings", "+"))
    add_worker_arguments(parser)
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
        check_table_ending(option, path)
    dynamics, recordings = opened(told, [*told.recordings, *told.validate])
    if not 0 <= told.hold_out < 0.95:
        raise RecordingError(f"--hold-out {told.hold_out:g}: a part of the recording, 0 to 0.95, is needed")
    if told.hold_out and told.validate:
        raise RecordingError("--hold-out and --validate: one of the two says what to validate with")
    from robot_dynamics.identification.consistent import consistent, convex_solver
    from robot_dynamics.identification.fitting import essential
    from robot_dynamics.replay.drives import write_drives

    if told.output or told.output_drives:
        convex_solver()  # missing, it stops the verb before the work
    with workers(told) as executor:
        fit, samples, gains = _fitted(told, dynamics, recordings, executor)
        nearest = consistent(fit) if told.output or told.output_drives else None
        checked = None if nearest is None else samples.quality(nearest.values)
    needed = essential(fit)
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
    from robot_dynamics.commands.progress import watched
    from robot_dynamics.identification.effort_columns import effort_columns
    from robot_dynamics.identification.fitting import fitted
    from robot_dynamics.identification.gains import LoadedColumns, found_gains
    from robot_dynamics.identification.samples import Samples

    loads = carried(told, dynamics.robot, recordings)
    columns = effort_columns(dynamics, recordings[0].drives, rotor_inertia=not told.no_rotor_inertia)

    def samples_of(recordings, columns, **part):
        watch = watched(len(recordings), "recordings", unit=" recordings")
        return Samples(recordings, columns, cutoff=told.cutoff, band=told.band, executor=executor, watch=watch, **part)

    many, gains, validation = len(told.recordings), None, None
    if told.gains:
        loaded = LoadedColumns(columns, tuple(dict.fromkeys(loads.values())), loads)
        gains = found_gains(samples_of(recordings[:many], loaded, until=1 - told.hold_out))
        recordings, columns = [replace(recording, drives=gains.drives) for recording in recordings], gains.columns
    samples = samples_of(recordings[:many], columns, until=1 - told.hold_out)
    if told.hold_out:
        validation = samples_of(recordings[:many], columns, after=1 - told.hold_out)
    elif told.validate:
        validation = samples_of(recordings[many:], columns)
    fit = fitted(samples, method=told.method, validation=validation)
    return (fit if gains is None else gains.counted_in(fit)), samples, gains


def print_fit(fit, needed, consistent):
    """Print a Fit; needed: (P,) which parameters are essential; consistent: the Quality of the robot that is written,
    None where none is."""
    columns = fit.columns
    print(f"{columns.inertial} base parameters with {len(columns.kept) - columns.inertial} of friction and "
          f"{len(columns.names) - len(columns.kept)} of drives, {fit.method} least squares over {fit.trained.samples} "
          f"samples, condition number {fit.condition:.3g}")  # fmt: skip
    for sentence in fit.notes:
        print(f"note: {sentence}")
    for sentence in fit.warnings:
        print(f"warning: {sentence}")
    parts = [("RMS", fit.trained, "rms"), ("RMS/spread", fit.trained, None),
             ("unfiltered", fit.trained, "rms_unfiltered"), ("validated", fit.validated, "rms"),
             ("validated, unfiltered", fit.validated, "rms_unfiltered"), ("consistent", consistent, "rms")]  # fmt: skip
    rows = []
    for number, name in enumerate(columns.dynamics.joint_names):
        cells = [None if quality is None else (getattr(quality, key) if key else quality.rms / quality.spread)[number]
                 for _, quality, key in parts]  # fmt: skip
        rows.append([name, *(None if cell is None else float(f"{cell:.3g}") for cell in cells)])
    print_table(["joint", *(title for title, _, _ in parts)], rows, "Measured less fitted effort [N m or N]")
    rows = [[textwrap.shorten(expression, 60, placeholder=" ..."), float(f"{value:.4g}"), float(f"{deviation:.2g}"),
             "" if essential else "no"] for expression, value, deviation, essential in
            zip(columns.expressions, fit.values, fit.deviations, needed, strict=True)]  # fmt: skip
    print_table(["parameter", "value", "deviation", "essential"], rows, "Parameters, SI")


def print_gains(gains):
    """Print Gains of drives."""
    rows = [[name, float(f"{gain:.5g}"), float(f"{deviation:.2g}")] for name, gain, deviation in
            zip(gains.drives.names, gains.drives.effort_gains, gains.deviations, strict=True)]  # fmt: skip
    print_table(["motor", "gain", "deviation"], rows, "Efforts of motors by what was measured")


def as_dict(fit, needed, consistent, gains=None):
    """Plain data, for JSON."""

    def quality(told):
        return None if told is None else {key: np.asarray(value).tolist() for key, value in vars(told).items()}

    parameters = [{"name": name, "sum": expression, "value": float(value), "deviation": float(deviation),
                   "essential": bool(essential)} for name, expression, value, deviation, essential in
                  zip(fit.columns.names, fit.columns.expressions, fit.values, fit.deviations, needed,
                      strict=True)]  # fmt: skip
    drives = None if gains is None else [
        {"name": name, "gain": float(gain), "deviation": float(deviation)} for name, gain, deviation in
        zip(gains.drives.names, gains.drives.effort_gains, gains.deviations, strict=True)]  # fmt: skip
    return {
        "format": 1, "robot": fit.columns.dynamics.robot.name, "joints": list(fit.columns.dynamics.joint_names),
        "method": fit.method, "condition": fit.condition, "inertial": fit.columns.inertial, "parameters": parameters,
        "trained": quality(fit.trained), "validated": quality(fit.validated), "consistent": quality(consistent),
        "warnings": list(fit.warnings), "notes": list(fit.notes), "gains": drives,
    }  # fmt: skip
