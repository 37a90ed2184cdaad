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

from robot_dynamics.commands.recording_arguments import add_recording_arguments, opened
from robot_dynamics.commands.text_table import print_table, table_text
from robot_dynamics.commands.workers import add_worker_arguments, workers
from robot_dynamics.commands.written import write_text
from robot_dynamics.errors import RecordingError

NAME = "replay-check"
EXCEEDED = 3
HEAD = ["joint", "verdict", "RMS", "tolerated", "RMS/spread", "largest", "at [s]", "bias", "correlation", "scale",
        "unfiltered"]  # fmt: skip


def add_arguments(parser):
    add_recording_arguments(parser, ("recordings", "+"))
    add_worker_arguments(parser)
    parser.add_argument("--tolerances", metavar="FILE", help="YAML; default: config/tolerances/default.yaml")
    parser.add_argument("--report", metavar="FILE.html",
                        help="write the report; of several recordings a folder of reports")  # fmt: skip
    parser.add_argument("--pictures", metavar="FOLDER", help="write the figures of the report as PNG files")
    parser.add_argument("--write-golden", metavar="FOLDER", help="write predicted efforts as a bag, /predicted_effort")
    parser.add_argument("--golden", metavar="BAG", help="a bag that was written so: predictions must be the same")
    parser.add_argument("--faults", action="store_true",
                        help="name the fault that explains residuals, and since when: it is a failure")  # fmt: skip
    parser.add_argument("--json", metavar="FILE", help="write all figures for machines")


def run(told):
    paths = list(dict.fromkeys(told.recordings))
    if len(paths) > 1 and (told.golden or told.write_golden):
        raise RecordingError("--golden and --write-golden go with one recording, and here are several")
    if told.report:
        from robot_dynamics.replay.report import plotly

        plotly("graph_objects")  # missing, it stops the verb before the work
    with workers(told) as executor:
        return _run_one(told) if len(paths) == 1 and executor is None else _run_many(told, paths, executor)


def _run_one(told):
    dynamics, (recording,) = opened(told, told.recordings[:1])
    from robot_dynamics.commands.progress import watched
    from robot_dynamics.replay.golden import GoldenComparison, GoldenWriter
    from robot_dynamics.replay.many import Outcome, examined

    questions = _questions(told, dynamics, recording.drives)
    golden = GoldenComparison(told.golden, dynamics.joint_names) if told.golden else None
    with ExitStack() as stack:
        takers = [golden.add] if golden else []
        if told.write_golden:
            writer = stack.enter_context(GoldenWriter(told.write_golden, dynamics.joint_names))
            takers.append(writer.add)
        found, fault = examined(recording, questions, watch=watched(recording.expected, recording.name), takers=takers)
    changed = golden.objections if golden else ()
    passed = Outcome(recording.name, found, fault).passed and not changed
    sentences = list(changed or ([golden.agreement] if golden else []))
    if told.faults:
        sentences.append(f"fault: {fault.sentence}" if fault else "no fault found")
    print(check_text(found, passed, sentences))
    if told.json:
        figures = {**found.as_dict(), "passed": passed, "fault": fault and asdict(fault), "golden": list(changed)}
        write_text(told.json, json.dumps(figures, indent=1) + "\n")
    _write_figures(found, told.report, told.pictures)
    return 0 if passed else EXCEEDED


def _run_many(told, paths, executor):
    if told.golden or told.write_golden:
        raise RecordingError("--golden and --write-golden: without --jobs and --scheduler")
    dynamics, _ = opened(told, [])
    from robot_dynamics.commands.progress import watched
    from robot_dynamics.replay.drives import load_drives
    from robot_dynamics.replay.many import outcomes, summary

    questions = _questions(told, dynamics, load_drives(told.drives, dynamics.joint_names))
    names, found = _names(paths), []
    for outcome in watched(len(paths), "recordings", unit=" recordings")(outcomes(paths, questions, executor)):
        name = names[outcome.recording]
        if outcome.check is not None:
            _write_figures(outcome.check, told.report and Path(told.report) / f"{name}.html",
                           told.pictures and Path(told.pictures) / name)  # fmt: skip
        found.append(outcome)
    joints = summary(found) if any(outcome.check for outcome in found) else []
    print_outcomes(found, joints)
    if told.json:
        figures = {"format": 1, "passed": all(outcome.passed for outcome in found),
                   "recordings": [outcome.as_dict() for outcome in found],
                   "joints": [asdict(joint) for joint in joints]}  # fmt: skip
        write_text(told.json, json.dumps(figures, indent=1) + "\n")
    if any(outcome.check is not None and not outcome.passed for outcome in found):
        return EXCEEDED
    return 0 if all(outcome.passed for outcome in found) else 1


def _questions(told, dynamics, drives):
    from robot_dynamics.replay.many import Questions
    from robot_dynamics.replay.tolerances import load_tolerances

    tolerances = load_tolerances(told.tolerances, dynamics.joint_names)
    return Questions(dynamics, drives, tuple(told.topic), tolerances, told.cutoff, told.rate, told.faults)


def _names(paths):
    """{path: a name for what is written of it}: the path from the folder that all are in."""
    whole = [os.path.abspath(path) for path in paths]
    common = os.path.commonpath([os.path.dirname(path) for path in whole])
    return {path: os.path.relpath(each, common).replace(os.sep, "-") for path, each in zip(paths, whole, strict=True)}


def _write_figures(found, report_path, pictures_path):
    if report_path:
        from robot_dynamics.replay.report import report

        write_text(report_path, report(found))
    if pictures_path:
        from robot_dynamics.replay.pictures import write_pictures

        write_pictures(found, Path(pictures_path))


def print_outcomes(found, joints):
    """Print Outcomes, and the JointSummaries of all."""
    rows = []
    for outcome in found:
        failed = (
            [] if outcome.check is None else [each.joint.joint for each in outcome.check.verdicts if not each.passed]
        )
        said = outcome.refusal or "; ".join([", ".join(failed), *([outcome.fault.sentence] if outcome.fault else [])])
        verdict = "passed" if outcome.passed else "FAILED" if outcome.check else "not checked"
        samples = outcome.check and outcome.check.comparison.samples
        rows.append([outcome.recording, verdict, samples, outcome.check and outcome.check.since, said.strip("; ")])
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


def check_text(found, passed=None, sentences=()):
    """What is printed of a Check; passed: whether all is well, what sentences tell of included; None: as the Check."""
    passed = found.passed if passed is None else passed
    lines = [f"{found.recording} against {found.robot!r}: {found.comparison.samples} samples at {found.rate:.5g} Hz, "
             f"{found.duration:.5g} s, filtered at {found.cutoff:.3g} Hz"]  # fmt: skip
    lines += [f"note: {note}" for note in found.notes]
    rows = []
    for verdict in found.verdicts:
        joint = verdict.joint
        numbers = (joint.rms, verdict.tolerated, joint.normalised, joint.largest, joint.at, joint.bias,
                   joint.correlation, joint.scale, joint.rms_unfiltered)  # fmt: skip
        rows.append([joint.joint, "passed" if verdict.passed else "FAILED", *(float(f"{x:.3g}") for x in numbers)])
    lines.append(table_text(HEAD, rows, "Measured less predicted effort [N m or N]"))
    lines += [f"{verdict.joint.joint}: {objection}" for verdict in found.verdicts for objection in verdict.objections]
    since = "" if found.since is None else f", out of tolerance since {found.since:.4g} s"
    return "\n".join([*lines, *sentences, "", f"{'passed' if passed else 'FAILED'}{since}"])
