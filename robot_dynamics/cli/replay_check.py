"""Check recordings against the model of a robot: compare measured with predicted efforts.

The table has one row for each joint: its verdict, the RMS of the residual (measured minus predicted effort), and the
largest RMS that is tolerated. Reports (HTML), figures (PNG) and JSON are written on request, before the table is
printed. Several recordings are checked one by one and summarised.

The exit status is 0 if all joints of all recordings pass; 3 if a tolerance is exceeded, predictions differ from a
golden bag, or --faults identifies a fault; 1 if no check failed but a recording or another file could not be read.
"""

from __future__ import annotations

import json
import os
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from robot_dynamics.cli.check_tables import format_check, print_outcomes
from robot_dynamics.cli.executors import add_executor_arguments, open_executor
from robot_dynamics.cli.output_files import allow_closed_stdout, check_writable, check_writable_folder, write_text
from robot_dynamics.cli.recording_arguments import add_recording_arguments, open_recordings
from robot_dynamics.errors import InvalidInputError, RecordingError, RobotDynamicsError
from robot_dynamics.optional_packages import import_optional

if TYPE_CHECKING:
    from robot_dynamics.checking.batch_check import CheckOptions, JointSummary, Outcome
    from robot_dynamics.checking.check import CheckResult
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.recordings.drives import Drives

NAME = "replay-check"
EXIT_CHECK_FAILED = 3
REPORT_ENDING = ".html"


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
    parser.add_argument("--json", metavar="FILE", help="write all results as JSON, one entry for each recording")


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
    files = _OutputFiles.plan(arguments, paths)
    with open_executor(arguments) as executor:
        if len(paths) == 1 and executor is None:
            return _check_one(arguments, paths[0], files)
        return _check_many(arguments, paths, files, executor)


@dataclass(frozen=True)
class _OutputFiles:
    """The files that the verb writes.

    Attributes
    ----------
    json : path of the JSON file; None: it is not written.
    reports : path of the report of each recording; empty: none is written.
    pictures : folder of the pictures of each recording; empty: none are written.
    """

    json: str | None
    reports: dict[str, Path]
    pictures: dict[str, Path]

    @classmethod
    def plan(cls, arguments: Namespace, paths: Sequence[str]) -> _OutputFiles:
        """Name the files, and check before the computation that they can be written. Raises RobotDynamicsError."""
        names = _output_names(paths)
        reports: dict[str, Path] = {}
        pictures: dict[str, Path] = {}
        if arguments.report:
            target = Path(arguments.report)
            is_file = target.suffix.lower() == REPORT_ENDING and not target.is_dir()
            if is_file and len(paths) > 1:
                raise InvalidInputError(
                    f"--report {target}: each of {len(paths)} recordings has a report: name a folder, without "
                    f"{REPORT_ENDING}"
                )
            (check_writable if is_file else check_writable_folder)(target)
            reports = {path: target if is_file else target / f"{name}{REPORT_ENDING}" for path, name in names.items()}
        if arguments.pictures:
            folder = Path(arguments.pictures)
            check_writable_folder(folder)
            pictures = {path: folder if len(paths) == 1 else folder / name for path, name in names.items()}
        if arguments.json:
            check_writable(arguments.json)
        return cls(arguments.json, reports, pictures)

    def write_figures(self, path: str, result: CheckResult) -> None:
        """Write the report and the pictures of the recording at a path, those that are wanted."""
        if path in self.reports:
            from robot_dynamics.checking.report import html_report

            write_text(self.reports[path], html_report(result))
        if path in self.pictures:
            from robot_dynamics.checking.figures import write_figures

            write_figures(result, self.pictures[path])

    def write_json(self, recordings: Sequence[dict[str, object]], joints: Sequence[JointSummary]) -> None:
        """Write the results of recordings, one or more, and the summaries of their joints as JSON."""
        if self.json:
            figures = {
                "format": 2,
                "passed": all(recording["passed"] for recording in recordings),
                "recordings": recordings,
                "joints": [asdict(joint) for joint in joints],
            }
            write_text(self.json, json.dumps(figures, indent=1) + "\n")


def _check_one(arguments: Namespace, path: str, files: _OutputFiles) -> int:
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
        files.write_json([Outcome(path, error=str(error)).as_dict()], [])
        raise
    differences = list(golden.failures) if golden else []
    outcome = Outcome(path, replace(result, recording=path), fault)
    passed = outcome.passed and not differences
    sentences = differences or ([golden.agreement] if golden else [])
    if arguments.faults:
        sentences = [*sentences, f"fault: {fault.sentence}" if fault else "no fault found"]
    try:  # files first: the reader of stdout may be gone. Where a file cannot be written, the result is printed
        files.write_json([{**outcome.as_dict(), "passed": passed, "golden": differences}], summarize_joints([outcome]))
        files.write_figures(path, result)
    finally:
        with allow_closed_stdout():
            print(format_check(result, passed, sentences))
    return 0 if passed else EXIT_CHECK_FAILED


def _check_many(arguments: Namespace, paths: Sequence[str], files: _OutputFiles, executor: Executor | None) -> int:
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
    try:  # as for one recording
        files.write_json([{**outcome.as_dict(), "golden": []} for outcome in outcomes], joints)
    finally:
        with allow_closed_stdout():
            print_outcomes(outcomes, joints)
    if any(outcome.check is not None and not outcome.passed for outcome in outcomes):
        return EXIT_CHECK_FAILED
    return 0 if all(outcome.passed for outcome in outcomes) else 1


def _check_options(arguments: Namespace, dynamics: Dynamics, drives: Drives) -> CheckOptions:
    from robot_dynamics.checking.batch_check import CheckOptions
    from robot_dynamics.checking.tolerances import load_tolerances

    tolerances = load_tolerances(arguments.tolerances, dynamics.joint_names)
    return CheckOptions(
        dynamics, drives, tuple(arguments.topic), tolerances, arguments.cutoff, arguments.rate, arguments.faults
    )


def _output_names(paths: Sequence[str]) -> dict[str, str]:
    """Return a name for the output files of each path: the path relative to the common folder."""
    absolute = [os.path.abspath(path) for path in paths]
    folder = os.path.commonpath([os.path.dirname(path) for path in absolute])
    return {
        path: os.path.relpath(full, folder).replace(os.sep, "-") for path, full in zip(paths, absolute, strict=True)
    }
