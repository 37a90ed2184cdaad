"""Many recordings against one robot: each is checked by itself, wherever that is, and all are summed up."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from robot_dynamics.checking.check import CheckResult, Predictor, check
from robot_dynamics.checking.faults import Evidence, Fault
from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.recordings.recording import moving_base_link, open_recording


@dataclass(frozen=True, eq=False)
class CheckOptions:
    """What is asked of each recording: Dynamics, Drives and topics (none: all) to read it with, Tolerances, cutoff
    [Hz] and rate [1/s] as for `check`, and whether a fault is to be named."""

    dynamics: object
    drives: object
    topics: tuple
    tolerances: object
    cutoff: float | None = None
    rate: float | None = None
    faults: bool = False


@dataclass(frozen=True, eq=False)
class Outcome:
    """Of one recording: its Check and the Fault that was named, or the reason for which it could not be checked."""

    recording: str
    check: CheckResult | None = None
    fault: Fault | None = None
    error: str | None = None

    @property
    def passed(self):
        return self.check is not None and self.check.passed and self.fault is None

    def as_dict(self):
        """Plain data, for JSON."""
        if self.check is None:
            return {"recording": self.recording, "passed": None, "refused": self.error}
        return {**self.check.as_dict(), "passed": self.passed, "fault": self.fault and vars(self.fault)}


@dataclass(frozen=True)
class JointSummary:
    """Of a joint in many recordings: rms, bias [N m or N] over the samples of all; recordings in which it failed, and
    the one in which its RMS is largest."""

    joint: str
    rms: float
    bias: float
    failed: tuple
    worst: str


def check_recordings(paths, options, executor=None):
    """Yield the Outcome of the recording at each path, in their order; those that cannot be checked stop nothing.

    executor: a concurrent.futures.Executor whose processes read and check; None: this one.
    """
    run = map if executor is None else executor.map
    found = run(partial(_outcome, options), [Path(path).absolute() for path in paths])
    for path, outcome in zip(paths, found, strict=True):
        name = str(path)
        yield replace(outcome, recording=name, check=outcome.check and replace(outcome.check, recording=name))


def check_recording(recording, options, *, progress=None, callbacks=()):
    """(Check, Fault or None) of a Recording; takers: called with each piece, as `each` of `check`."""
    evidence = Evidence(Predictor(options.dynamics, recording.drives)) if options.faults else None
    callbacks = [*callbacks, evidence.add] if evidence else callbacks
    found = check(recording, options.dynamics, options.tolerances, cutoff=options.cutoff, rate=options.rate,
                  progress=progress, on_piece=lambda *piece: [take(*piece) for take in callbacks])  # fmt: skip
    return found, evidence.find_fault() if evidence else None


def _outcome(options, path):
    try:
        recording = open_recording(path, options.drives, options.topics, moving_base_link(options.dynamics))
        return Outcome(str(path), *check_recording(recording, options))
    except RobotDynamicsError as error:
        return Outcome(str(path), error=str(error))


def summarize_joints(outcomes):
    """The JointSummary of each joint, of Outcomes of which at least one has a Check."""
    checks = [outcome.check for outcome in outcomes if outcome.check is not None]
    samples = sum(found.comparison.samples for found in checks)
    sums, squares = sum(found.comparison.residual_sums for found in checks) / samples
    told = []
    for column, name in enumerate(checks[0].comparison.joint_names):
        failed = tuple(found.recording for found in checks if not found.verdicts[column].passed)
        worst = max(checks, key=lambda found: found.verdicts[column].joint.rms)
        told.append(JointSummary(name, float(np.sqrt(squares[column])), float(sums[column]), failed, worst.recording))
    return told
