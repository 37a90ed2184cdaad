"""Check recordings against the model of a robot: compare measured with predicted efforts.

The table has one row for each joint: its verdict, the RMS of the residual (measured minus predicted effort), and the
largest RMS that is tolerated. Reports (HTML), figures (PNG) and JSON are written on request, before the table is
printed. Several recordings are checked one by one and summarised.

The exit status is 0 if all recordings pass; 3 if a joint is out of tolerance, too little was compared, predictions
differ from a golden bag, a joint is worse than in --baseline, or --faults identifies a fault; 1 if no check failed but
a recording or another file could not be read, or no joint of a recording can be judged.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING

from robot_dynamics.cli.check_files import CheckFiles
from robot_dynamics.cli.check_tables import describe_fault, format_changes, format_check, format_counts, print_outcomes
from robot_dynamics.cli.executors import add_executor_arguments, open_executor
from robot_dynamics.cli.output_files import allow_closed_stdout
from robot_dynamics.cli.recording_arguments import add_recording_arguments, open_recordings, parse_sample_range
from robot_dynamics.errors import RecordingError, RobotDynamicsError
from robot_dynamics.optional_packages import import_optional

if TYPE_CHECKING:
    from robot_dynamics.checking.baseline import JointChange
    from robot_dynamics.checking.batch_check import CheckOptions, Outcome
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.recordings.drives import Drives

NAME = "replay-check"
EXIT_CHECK_FAILED = 3


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_recording_arguments(parser, ("recordings", "+"))
    add_executor_arguments(parser)
    parser.add_argument(
        "--tolerances",
        metavar="NAME",
        help="tolerances: quick, normal (default) or strict, see config/tolerances, or a YAML file; keys that it lacks "
        "are those of normal",
    )
    parser.add_argument(
        "--report",
        metavar="PATH",
        help="write reports that open in a browser: the name of a folder, with a report for each recording, or for one "
        "recording a file that ends in .html",
    )
    parser.add_argument(
        "--pictures",
        metavar="FOLDER",
        help="write the figures of the report as PNG files; those of several recordings in folders of their own",
    )
    parser.add_argument(
        "--write-golden", metavar="FOLDER", help="write the predicted efforts as a bag with the topic /predicted_effort"
    )
    parser.add_argument(
        "--golden",
        metavar="BAG",
        help="bag that --write-golden wrote: the predicted efforts must be equal to those in it",
    )
    parser.add_argument(
        "--faults",
        action="store_true",
        help="identify the fault that explains the residuals, and its onset; a fault fails the check. The model "
        "must fit the recording before the fault",
    )
    parser.add_argument(
        "--baseline",
        metavar="FILE",
        help="JSON file of an earlier check: joints that are worse than there, beyond the scatter, fail the check",
    )
    parser.add_argument("--json", metavar="FILE", help="write all results as JSON, one entry for each recording")
    parser.add_argument(
        "--junit",
        metavar="FILE",
        help="write the verdicts as JUnit XML: a test suite for each recording, a test case for each joint",
    )


def run(arguments: Namespace) -> int:
    """Check the recordings and return the exit status."""
    paths = list(dict.fromkeys(arguments.recordings))
    if len(paths) > 1 and (arguments.golden or arguments.write_golden):
        raise RecordingError(f"--golden and --write-golden take one recording, not {len(paths)}")
    if arguments.report:
        from robot_dynamics.checking.report import import_plotly

        import_plotly("graph_objects")  # fails before the computation if plotly is missing
    if arguments.pictures:
        import_optional("matplotlib.figure", "--pictures")
    files = CheckFiles.plan(arguments, paths)
    if arguments.baseline:
        from robot_dynamics.checking.baseline import Baseline

        Baseline(arguments.baseline)  # fails before the computation if the file cannot be read
    with open_executor(arguments) as executor:
        if len(paths) == 1 and executor is None:
            return _check_one(arguments, paths[0], files)
        return _check_many(arguments, paths, files, executor)


def _check_one(arguments: Namespace, path: str, files: CheckFiles) -> int:
    dynamics, _ = open_recordings(arguments, [])
    from robot_dynamics.checking.batch_check import Outcome, check_recording, summarize_joints
    from robot_dynamics.checking.golden_bags import GoldenComparison, GoldenWriter
    from robot_dynamics.cli.progress import progress_wrapper
    from robot_dynamics.recordings.drives import load_drives

    options = _check_options(arguments, dynamics, load_drives(arguments.drives, dynamics.joint_names))
    try:
        _, (recording,) = open_recordings(arguments, [path])
        golden = GoldenComparison(arguments.golden, dynamics.joint_names) if arguments.golden else None
        progress = progress_wrapper(recording.message_count, recording.name)
        with ExitStack() as stack:
            callbacks = [golden.add] if golden else []
            if arguments.write_golden:
                writer = stack.enter_context(GoldenWriter(arguments.write_golden, dynamics.joint_names))
                callbacks.append(writer.add)
            result, fault = check_recording(recording, options, progress=progress, callbacks=callbacks)
    except RobotDynamicsError as error:
        files.write_results([Outcome(path, error=str(error)).as_dict()], [])
        raise
    differences = list(golden.failures) if golden else []
    outcome = Outcome(path, replace(result, recording=path), fault)
    passed = False if differences else outcome.passed_or_not_judged
    entry = {**outcome.as_dict(), "passed": passed, "golden": differences}
    changes, notes = _compare_with_baseline(arguments, [entry])
    sentences = differences or ([golden.agreement] if golden else [])
    if arguments.faults:
        sentences = [*sentences, describe_fault(fault)]
    sentences += [*(f"note: {note}" for note in notes), *format_changes(changes)]
    try:  # files first: the reader of stdout may be gone. Where a file cannot be written, the result is printed
        files.write_results([entry], summarize_joints([outcome]))
        files.write_figures(path, result)
    finally:
        with allow_closed_stdout():
            print(format_check(result, False if entry["passed"] is False else None, sentences))
    return _exit_status([entry])


def _check_many(arguments: Namespace, paths: Sequence[str], files: CheckFiles, executor: Executor | None) -> int:
    if arguments.golden or arguments.write_golden:
        raise RecordingError("--golden and --write-golden cannot be combined with --jobs or --scheduler")
    dynamics, _ = open_recordings(arguments, [])
    from robot_dynamics.checking.batch_check import check_recordings, summarize_joints
    from robot_dynamics.cli.progress import progress_wrapper
    from robot_dynamics.recordings.drives import load_drives

    options = _check_options(arguments, dynamics, load_drives(arguments.drives, dynamics.joint_names))
    progress = progress_wrapper(len(paths), "recordings", unit=" recordings")
    outcomes: list[Outcome] = []
    for outcome in progress(check_recordings(paths, options, executor)):
        if outcome.check is not None:
            files.write_figures(outcome.recording, outcome.check)
        outcomes.append(outcome)
    joints = summarize_joints(outcomes) if any(outcome.check for outcome in outcomes) else []
    entries = [{**outcome.as_dict(), "golden": []} for outcome in outcomes]
    changes, notes = _compare_with_baseline(arguments, entries)
    try:  # as for one recording
        files.write_results(entries, joints)
    finally:
        with allow_closed_stdout():
            print_outcomes(outcomes, entries, joints, faults=arguments.faults)
            print("\n".join([*(f"note: {note}" for note in notes), *format_changes(changes), ""]))
            print(format_counts(entries))
    return _exit_status(entries)


def _exit_status(entries: Sequence[dict[str, object]]) -> int:
    """3 where one fails; 1 where one could not be checked or judged; else 0."""
    if any(entry["passed"] is False for entry in entries):
        return EXIT_CHECK_FAILED
    return 0 if all(entry["passed"] for entry in entries) else 1


def _compare_with_baseline(
    arguments: Namespace, entries: Sequence[dict[str, object]]
) -> tuple[list[JointChange], list[str]]:
    """Compare results with --baseline; changes are added to the entries, which fail where a joint is worse."""
    if not arguments.baseline:
        return [], []
    from robot_dynamics.checking.baseline import Baseline

    changes, notes = Baseline(arguments.baseline).compare(entries)
    for entry in entries:
        own = [change for change in changes if change.recording == entry["recording"]]
        if entry["passed"] is not None:
            entry["baseline"] = [change.as_dict() for change in own]
            entry["passed"] = entry["passed"] and not any(change.reasons for change in own)
    return changes, notes


def _check_options(arguments: Namespace, dynamics: Dynamics, drives: Drives) -> CheckOptions:
    from robot_dynamics.checking.batch_check import CheckOptions
    from robot_dynamics.checking.tolerances import load_tolerances

    tolerances = load_tolerances(arguments.tolerances, dynamics.joint_names)
    return CheckOptions(
        dynamics,
        drives,
        tuple(arguments.topic),
        tolerances,
        arguments.cutoff,
        arguments.rate,
        arguments.faults,
        parse_sample_range(arguments),
    )
