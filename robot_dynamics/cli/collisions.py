"""Find collisions in recordings by the external efforts of the joints, or learn the thresholds that decide them.

The description of --robot, with its --drives, must predict the efforts of the robot: identify it before. --learn
observes recordings of sound motion, without contact, and writes thresholds for the node contact_monitor. They are such
that one false alarm is expected in --interval hours of motion like that of the recordings. --thresholds observes
recordings with the thresholds of a file and lists the collisions. Samples are observed one after the other, as the node
does. The exit status is 0, or 3 if there is a collision.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.cli.output_files import YAML_ENDINGS, allow_closed_stdout, check_ending, check_writable, write_text
from robot_dynamics.cli.recording_arguments import add_recording_arguments, open_recordings
from robot_dynamics.cli.recording_notes import merge_notes
from robot_dynamics.cli.text_table import print_table, round_to_digits
from robot_dynamics.errors import RecordingError

if TYPE_CHECKING:
    from robot_dynamics.cli.text_table import Cell
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.monitoring.collision_detector import CollisionEvent
    from robot_dynamics.monitoring.collision_thresholds import CollisionThresholds
    from robot_dynamics.monitoring.threshold_learning import LargestRatios, LearntThresholds, ThresholdLearner
    from robot_dynamics.recordings.recording import Recording

NAME = "collisions"
COLLISION_EXIT_STATUS = 3
SHORT_DURATION = 60.0
"""Duration of recordings [s] below which thresholds for hours are a bold extrapolation."""


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_recording_arguments(parser, ("recordings", "+"))
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--learn", metavar="FILE.yaml", help="learn thresholds from the recordings and write them")
    action.add_argument("--thresholds", metavar="FILE.yaml", help="find collisions with these thresholds")
    parser.add_argument(
        "--bandwidth",
        type=float,
        default=50.0,
        metavar="1/S",
        help="bandwidth of the observer for --learn: external efforts show after 1 / bandwidth (default: %(default)g)",
    )
    parser.add_argument(
        "--interval",
        type=float,
        default=8.0,
        metavar="HOURS",
        help="mean time between two false alarms for --learn, in hours of motion (default: %(default)g)",
    )
    parser.add_argument("--json", metavar="FILE", help="write all figures as JSON")


def run(arguments: Namespace) -> int:
    """Learn thresholds or find collisions, print the results, write the files, and return the exit status."""
    if arguments.learn is not None:
        check_ending(arguments.learn, YAML_ENDINGS, "--learn")
    for path in filter(None, (arguments.learn, arguments.json)):
        check_writable(path)
    for option, value in (("--bandwidth", arguments.bandwidth), ("--interval", arguments.interval)):
        if not 0 < value < inf:
            raise RecordingError(f"{option} {value:g}: a number above 0 is needed")
    dynamics, recordings = open_recordings(arguments, arguments.recordings)
    if arguments.learn is not None:
        _learn(arguments, dynamics, recordings)
        return 0
    return _find(arguments, dynamics, recordings)


def _learn(arguments: Namespace, dynamics: Dynamics, recordings: list[Recording]) -> None:
    """Learn thresholds, and write and print them."""
    from robot_dynamics.monitoring.collision_thresholds import CollisionThresholds, write_thresholds
    from robot_dynamics.monitoring.threshold_learning import ThresholdLearner

    n = len(dynamics.joint_names)
    undecided = CollisionThresholds(dynamics.joint_names, np.full(n, inf), np.zeros(n), arguments.bandwidth)
    learner = ThresholdLearner(dynamics, undecided)
    notes = _observe(arguments, dynamics, recordings, undecided, learner)
    learnt = learner.learn(arguments.interval * 3600)
    try:  # files first: the reader of stdout may be gone
        comments = [_basis(arguments, learnt), f"Recordings: {', '.join(arguments.recordings)}"]
        write_text(arguments.learn, write_thresholds(learnt.thresholds, comments))
        if arguments.json:
            write_text(arguments.json, json.dumps(_learnt_figures(learnt), indent=1) + "\n")
    finally:
        with allow_closed_stdout():
            _print_learnt(arguments, learnt)
            _print_notes(notes)


def _find(arguments: Namespace, dynamics: Dynamics, recordings: list[Recording]) -> int:
    """Find collisions, print them, and return the exit status."""
    from robot_dynamics.monitoring.collision_thresholds import load_thresholds
    from robot_dynamics.monitoring.threshold_learning import LargestRatios

    thresholds = load_thresholds(arguments.thresholds, dynamics.joint_names)
    events: list[tuple[str, CollisionEvent]] = []
    ratios = LargestRatios(len(dynamics.joint_names))
    notes = _observe(arguments, dynamics, recordings, thresholds, ratios, events)
    if arguments.json:
        write_text(arguments.json, json.dumps(_collision_figures(dynamics, ratios, events), indent=1) + "\n")
    with allow_closed_stdout():
        count = f"{len(events) or 'no'} collision{'' if len(events) == 1 else 's'}"
        print(f"{count} in {ratios.duration:.4g} s")
        header = ["recording", "time [s]", "joint", "external effort", "threshold"]
        rows: list[list[Cell]] = [
            [name, round(event.stamp * 1e-9, 3), event.joint, *_rounded(event.effort, event.threshold)]
            for name, event in events
        ]
        if rows:
            print_table(header, rows, "Collisions [N m or N]")
        largest: list[list[Cell]] = [
            [name, round_to_digits(float(ratio), 3)]
            for name, ratio in zip(dynamics.joint_names, ratios.largest, strict=True)
        ]
        print_table(["joint", "largest"], largest, "External efforts relative to their thresholds")
        _print_notes(notes)
    return COLLISION_EXIT_STATUS if events else 0


def _observe(
    arguments: Namespace,
    dynamics: Dynamics,
    recordings: list[Recording],
    thresholds: CollisionThresholds,
    sink: ThresholdLearner | LargestRatios,
    events: list[tuple[str, CollisionEvent]] | None = None,
) -> dict[str, list[str]]:
    """Observe recordings: each observation goes to a sink, each collision to `events`. Return notes by recording."""
    from robot_dynamics.cli.progress import progress_wrapper
    from robot_dynamics.monitoring.contact_observer import ContactObserver
    from robot_dynamics.monitoring.momentum_balance import MomentumBalance
    from robot_dynamics.monitoring.recorded_contacts import observe_recording
    from robot_dynamics.recordings.sample_statistics import SampleStatistics

    balance = MomentumBalance(dynamics, recordings[0].drives)
    notes = {}
    for recording in recordings:
        observer = ContactObserver(balance, thresholds)
        statistics = SampleStatistics()
        observations = observe_recording(
            recording,
            observer,
            cutoff=arguments.cutoff,
            rate=arguments.rate,
            statistics=statistics,
            progress=progress_wrapper(recording.message_count, recording.name),
        )
        for observation in observations:
            sink.add(observer, observation)
            if observation.begins and events is not None and observer.detector.event is not None:
                events.append((recording.name, observer.detector.event))
        restarts = [f"the observer restarted {observer.restarts} times"] if observer.restarts else []
        notes[recording.name] = [*recording.notes, *statistics.sentences, *restarts]
    return notes


def _basis(arguments: Namespace, learnt: LearntThresholds) -> str:
    return (
        f"One false alarm is expected in {arguments.interval:g} h of motion like that of {learnt.duration:.4g} s of "
        "recordings."
    )


def _print_learnt(arguments: Namespace, learnt: LearntThresholds) -> None:
    thresholds = learnt.thresholds
    rows: list[list[Cell]] = [
        [name, *_rounded(rms, largest, moving, slow)]
        for name, rms, largest, moving, slow in zip(
            thresholds.joint_names, learnt.rms, learnt.largest, thresholds.moving, thresholds.slow, strict=True
        )
    ]
    print(_basis(arguments, learnt))
    header = ["joint", "RMS", "largest", "threshold", "more near standstill"]
    print_table(header, rows, "External efforts of sound motion [N m or N]")
    if learnt.duration < SHORT_DURATION:
        print(
            f"note: {learnt.duration:.3g} s are few for an interval of hours: record {SHORT_DURATION:g} s or more of "
            "motion like that of the application"
        )


def _print_notes(notes: dict[str, list[str]]) -> None:
    for note in merge_notes(notes):
        print(f"note: {note}")


def _rounded(*values: float) -> list[float]:
    return [round_to_digits(float(value), 3) for value in values]


def _learnt_figures(learnt: LearntThresholds) -> dict[str, object]:
    thresholds = learnt.thresholds
    return {
        "duration": learnt.duration,
        "interval": learnt.interval,
        "bandwidth": thresholds.bandwidth,
        "joints": {
            name: {
                "rms": float(learnt.rms[k]),
                "largest": float(learnt.largest[k]),
                "moving": float(thresholds.moving[k]),
                "slow": float(thresholds.slow[k]),
                "blocks": int(learnt.blocks[k]),
            }
            for k, name in enumerate(thresholds.joint_names)
        },
    }


def _collision_figures(
    dynamics: Dynamics, ratios: LargestRatios, events: list[tuple[str, CollisionEvent]]
) -> dict[str, object]:
    return {
        "duration": ratios.duration,
        "largest": dict(zip(dynamics.joint_names, ratios.largest.tolist(), strict=True)),
        "collisions": [
            {
                "recording": name,
                "time": event.stamp * 1e-9,
                "joint": event.joint,
                "effort": event.effort,
                "threshold": event.threshold,
            }
            for name, event in events
        ],
    }
