"""The files that replay-check writes: reports, pictures, JSON and JUnit XML."""

from __future__ import annotations

import json
import os
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from robot_dynamics.cli.output_files import check_writable, check_writable_folder, write_text
from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.checking.batch_check import JointSummary
    from robot_dynamics.checking.check import CheckResult

REPORT_ENDING = ".html"


@dataclass(frozen=True)
class CheckFiles:
    """The files that the verb writes.

    Attributes
    ----------
    json : path of the JSON file; None: it is not written.
    junit : path of the JUnit XML file; None: it is not written.
    reports : path of the report of each recording; empty: none is written.
    pictures : folder of the pictures of each recording; empty: none are written.
    """

    json: str | None
    junit: str | None
    reports: dict[str, Path]
    pictures: dict[str, Path]

    @classmethod
    def plan(cls, arguments: Namespace, paths: Sequence[str]) -> CheckFiles:
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
        for file in filter(None, (arguments.json, arguments.junit)):
            check_writable(file)
        return cls(arguments.json, arguments.junit, reports, pictures)

    def write_figures(self, path: str, result: CheckResult) -> None:
        """Write the report and the pictures of the recording at a path, those that are wanted."""
        if path in self.reports:
            from robot_dynamics.checking.report import html_report

            write_text(self.reports[path], html_report(result))
        if path in self.pictures:
            from robot_dynamics.checking.figures import write_figures

            write_figures(result, self.pictures[path])

    def write_results(self, recordings: Sequence[dict[str, object]], joints: Sequence[JointSummary]) -> None:
        """Write the results of recordings, one or more, and the summaries of their joints as JSON and JUnit XML."""
        if self.json:
            figures = {
                "format": 2,
                "passed": all(recording["passed"] for recording in recordings),
                "recordings": recordings,
                "joints": [asdict(joint) for joint in joints],
            }
            write_text(self.json, json.dumps(figures, indent=1) + "\n")
        if self.junit:
            from robot_dynamics.checking.junit import junit_xml

            write_text(self.junit, junit_xml(recordings))


def _output_names(paths: Sequence[str]) -> dict[str, str]:
    """Return a name for the output files of each path: the path relative to the common folder."""
    absolute = [os.path.abspath(path) for path in paths]
    folder = os.path.commonpath([os.path.dirname(path) for path in absolute])
    return {
        path: os.path.relpath(full, folder).replace(os.sep, "-") for path, full in zip(paths, absolute, strict=True)
    }
