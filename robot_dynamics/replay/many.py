"""Many recordings against one robot: each is checked by itself, wherever that is, and all are summed up."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.replay.checking import Check, Predictor, check
from robot_dynamics.replay.faults import Evidence, Fault
from robot_dynamics.replay.recordings import moving_base, open_recording


@dataclass(frozen=True, eq=False)
class Questions:
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
    check: Check | None = None
    fault: Fault | None = None
    refusal: str | None = None

    @property
    def passed(self):
        return self.check is not None and self.check.passed and self.fault is None

    def as_dict(self):
        """Plain data, for JSON."""
        if self.check is None:
            return {"recording": self.recording, "passed": None, "refused": self.refusal}
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


def outcomes(paths, questions, executor=None):
    """Yield the Outcome of the recording at each path, in their order; those that cannot be checked stop nothing.

    executor: a concurrent.futures.Executor whose processes read and check; None: this one.
    """
    run = map if executor is None else executor.map
    found = run(partial(_outcome, questions), [Path(path).absolute() for path in paths])
    for path, outcome in zip(paths, found, strict=True):
        name = str(path)
        yield replace(outcome, recording=name, check=outcome.check and replace(outcome.check, recording=name))


def examined(recording, questions, *, watch=None, takers=()):
    """(Check, Fault or None) of a Recording; takers: called with each piece, as `each` of `check`."""
    evidence = Evidence(Predictor(questions.dynamics, recording.drives)) if questions.faults else None
    takers = [*takers, evidence.add] if evidence else takers
    found = check(recording, questions.dynamics, questions.tolerances, cutoff=questions.cutoff, rate=questions.rate,
                  watch=watch, each=lambda *piece: [take(*piece) for take in takers])  # fmt: skip
    return found, evidence.fault() if evidence else None


def _outcome(questions, path):
    try:
        recording = open_recording(path, questions.drives, questions.topics, moving_base(questions.dynamics))
        return Outcome(str(path), *examined(recording, questions))
    except RobotDynamicsError as error:
        return Outcome(str(path), refusal=str(error))


def summary(outcomes):
    """The JointSummary of each joint, of Outcomes of which at least one has a Check."""
    checks = [outcome.check for outcome in outcomes if outcome.check is not None]
    samples = sum(found.comparison.samples for found in checks)
    sums, squares = sum(found.comparison.residuals for found in checks) / samples
    told = []
    for column, name in enumerate(checks[0].comparison.joint_names):
        failed = tuple(found.recording for found in checks if not found.verdicts[column].passed)
        worst = max(checks, key=lambda found: found.verdicts[column].joint.rms)
        told.append(JointSummary(name, float(np.sqrt(squares[column])), float(sums[column]), failed, worst.recording))
    return told
