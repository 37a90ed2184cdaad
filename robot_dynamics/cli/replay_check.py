"""Check recordings against a robot: do the efforts that it measured fit its model?

Prints a table, and writes a report (HTML, one file), pictures (PNG) and JSON where it is told to. Of several recordings
each is checked by itself, and all are summed up. The exit status is 0 where all joints pass, 3 where a tolerance is
exceeded, a golden bag has other efforts or a fault is named, 1 where a recording could not be checked.
"""

import json
import os
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

from robot_dynamics.cli.executors import add_executor_arguments, open_executor
from robot_dynamics.cli.output_files import write_text
from robot_dynamics.cli.recording_arguments import add_recording_arguments, open_recordings
from robot_dynamics.cli.text_table import format_table, print_table
from robot_dynamics.errors import RecordingError

NAME = "replay-check"
EXIT_CHECK_FAILED = 3
TABLE_HEADER = ["joint", "verdict", "RMS", "tolerated", "RMS/spread", "largest", "at [s]", "bias", "correlation", "scale",
        "unfiltered"]  # fmt: skip


def add_arguments(parser):
    add_recording_arguments(parser, ("recordings", "+"))
    add_executor_arguments(parser)
    parser.add_argument("--tolerances", metavar="FILE", help="YAML; default: config/tolerances/default.yaml")
    parser.add_argument("--report", metavar="FILE.html",
                        help="write the report; of several recordings a folder of reports")  # fmt: skip
    parser.add_argument("--pictures", metavar="FOLDER", help="write the figures of the report as PNG files")
    parser.add_argument("--write-golden", metavar="FOLDER", help="write predicted efforts as a bag, /predicted_effort")
    parser.add_argument("--golden", metavar="BAG", help="a bag that was written so: predictions must be the same")
    parser.add_argument("--faults", action="store_true",
                        help="name the fault that explains residuals, and since when: it is a failure")  # fmt: skip
    parser.add_argument("--json", metavar="FILE", help="write all figures for machines")


def run(arguments):
    paths = list(dict.fromkeys(arguments.recordings))
    if len(paths) > 1 and (arguments.golden or arguments.write_golden):
        raise RecordingError("--golden and --write-golden go with one recording, and here are several")
    if arguments.report:
        from robot_dynamics.checking.report import import_plotly

        import_plotly("graph_objects")  # missing, it stops the verb before the work
    with open_executor(arguments) as executor:
        return _run_one(arguments) if len(paths) == 1 and executor is None else _run_many(arguments, paths, executor)


def _run_one(arguments):
    dynamics, (recording,) = open_recordings(arguments, arguments.recordings[:1])
    from robot_dynamics.checking.batch_check import Outcome, check_recording
    from robot_dynamics.checking.golden_bags import GoldenComparison, GoldenWriter
    from robot_dynamics.cli.progress import progress_wrapper

    options = _questions(arguments, dynamics, recording.drives)
    golden = GoldenComparison(arguments.golden, dynamics.joint_names) if arguments.golden else None
    with ExitStack() as stack:
        callbacks = [golden.add] if golden else []
        if arguments.write_golden:
            writer = stack.enter_context(GoldenWriter(arguments.write_golden, dynamics.joint_names))
            callbacks.append(writer.add)
        found, fault = check_recording(
            recording, options, progress=progress_wrapper(recording.message_count, recording.name), callbacks=callbacks
        )
    changed = golden.failures if golden else ()
    passed = Outcome(recording.name, found, fault).passed and not changed
    sentences = list(changed or ([golden.agreement] if golden else []))
    if arguments.faults:
        sentences.append(f"fault: {fault.sentence}" if fault else "no fault found")
    print(format_check(found, passed, sentences))
    if arguments.json:
        figures = {**found.as_dict(), "passed": passed, "fault": fault and asdict(fault), "golden": list(changed)}
        write_text(arguments.json, json.dumps(figures, indent=1) + "\n")
    _write_figures(found, arguments.report, arguments.pictures)
    return 0 if passed else EXIT_CHECK_FAILED


def _run_many(arguments, paths, executor):
    if arguments.golden or arguments.write_golden:
        raise RecordingError("--golden and --write-golden: without --jobs and --scheduler")
    dynamics, _ = open_recordings(arguments, [])
    from robot_dynamics.checking.batch_check import check_recordings, summarize_joints
    from robot_dynamics.cli.progress import progress_wrapper
    from robot_dynamics.recordings.drives import load_drives

    options = _questions(arguments, dynamics, load_drives(arguments.drives, dynamics.joint_names))
    names, found = _names(paths), []
    for outcome in progress_wrapper(len(paths), "recordings", unit=" recordings")(
        check_recordings(paths, options, executor)
    ):
        name = names[outcome.recording]
        if outcome.check is not None:
            _write_figures(outcome.check, arguments.report and Path(arguments.report) / f"{name}.html",
                           arguments.pictures and Path(arguments.pictures) / name)  # fmt: skip
        found.append(outcome)
    joints = summarize_joints(found) if any(outcome.check for outcome in found) else []
    print_outcomes(found, joints)
    if arguments.json:
        figures = {"format": 1, "passed": all(outcome.passed for outcome in found),
                   "recordings": [outcome.as_dict() for outcome in found],
                   "joints": [asdict(joint) for joint in joints]}  # fmt: skip
        write_text(arguments.json, json.dumps(figures, indent=1) + "\n")
    if any(outcome.check is not None and not outcome.passed for outcome in found):
        return EXIT_CHECK_FAILED
    return 0 if all(outcome.passed for outcome in found) else 1


def _questions(arguments, dynamics, drives):
    from robot_dynamics.checking.batch_check import CheckOptions
    from robot_dynamics.checking.tolerances import load_tolerances

    tolerances = load_tolerances(arguments.tolerances, dynamics.joint_names)
    return CheckOptions(
        dynamics, drives, tuple(arguments.topic), tolerances, arguments.cutoff, arguments.rate, arguments.faults
    )


def _names(paths):
    """{path: a name for what is written of it}: the path from the folder that all are in."""
    whole = [os.path.abspath(path) for path in paths]
    common = os.path.commonpath([os.path.dirname(path) for path in whole])
    return {path: os.path.relpath(each, common).replace(os.sep, "-") for path, each in zip(paths, whole, strict=True)}


def _write_figures(found, report_path, pictures_path):
    if report_path:
        from robot_dynamics.checking.report import html_report

        write_text(report_path, html_report(found))
    if pictures_path:
        from robot_dynamics.checking.figures import write_figures

        write_figures(found, Path(pictures_path))


def print_outcomes(found, joints):
    """Print Outcomes, and the JointSummaries of all."""
    rows = []
    for outcome in found:
        failed = (
            [] if outcome.check is None else [each.joint.joint for each in outcome.check.verdicts if not each.passed]
        )
        said = outcome.error or "; ".join([", ".join(failed), *([outcome.fault.sentence] if outcome.fault else [])])
        verdict = "passed" if outcome.passed else "FAILED" if outcome.check else "not checked"
        samples = outcome.check and outcome.check.comparison.samples
        rows.append(
            [outcome.recording, verdict, samples, outcome.check and outcome.check.first_failure_time, said.strip("; ")]
        )
    print_table(["recording", "verdict", "samples", "since [s]", "what is wrong"], rows)
    if joints:
        rows = [[joint.joint, float(f"{joint.rms:.3g}"), float(f"{joint.bias:.3g}"), len(joint.failed), joint.worst]
                for joint in joints]  # fmt: skip
        print_table(["joint", "RMS", "bias", "failed", "largest in"], rows,
                    "Measured less predicted effort of all recordings [N m or N]")  # fmt: skip
    for outcome in found:
        if outcome.check is not None:
            for note in outcome.check.notes:
                print(f"note: {outcome.recording}: {note}")
    counts = [
        sum(1 for each in found if kind(each))
        for kind in (lambda each: each.passed, lambda each: each.check and not each.passed, lambda each: not each.check)
    ]
    print("\n{} passed, {} FAILED, {} not checked".format(*counts))


def format_check(found, passed=None, sentences=()):
    """What is printed of a Check; passed: whether all is well, what sentences tell of included; None: as the Check."""
    passed = found.passed if passed is None else passed
    lines = [f"{found.recording} against {found.robot!r}: {found.comparison.samples} samples at {found.rate:.5g} Hz, "
             f"{found.duration:.5g} s, filtered at {found.cutoff:.3g} Hz"]  # fmt: skip
    lines += [f"note: {note}" for note in found.notes]
    rows = []
    for verdict in found.verdicts:
        joint = verdict.joint
        numbers = (joint.rms, verdict.tolerance, joint.normalised, joint.largest, joint.at, joint.bias,
                   joint.correlation, joint.scale, joint.rms_unfiltered)  # fmt: skip
        rows.append([joint.joint, "passed" if verdict.passed else "FAILED", *(float(f"{x:.3g}") for x in numbers)])
    lines.append(format_table(TABLE_HEADER, rows, "Measured less predicted effort [N m or N]"))
    lines += [f"{verdict.joint.joint}: {objection}" for verdict in found.verdicts for objection in verdict.failures]
    since = "" if found.first_failure_time is None else f", out of tolerance since {found.first_failure_time:.4g} s"
    return "\n".join([*lines, *sentences, "", f"{'passed' if passed else 'FAILED'}{since}"])
