"""A measurement of joint states for a request, and the requests that wait for its result."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from robot_dynamics.nodes.deferred_responses import DeferredResponse
from robot_dynamics.recordings.drives import load_drives
from robot_dynamics.recordings.measured_samples import MeasuredSamples
from robot_dynamics.recordings.recording import moving_base_link, recording_of

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.parameters import ParameterValues
    from robot_dynamics.recordings.drives import Drives
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.recording import Recording
    from robot_dynamics_interfaces.srv import IdentifyPayload

MAX_MESSAGES = 500_000
"""Messages of a measurement: 0.4 kB each."""
SILENCE = 5.0
"""Time [s] without any message after which a measurement ends; publishers are discovered within three."""


@dataclass(frozen=True, eq=False)
class Baseline:
    """Samples of the robot without load.

    Attributes
    ----------
    dynamics : robot of the measurement; another robot needs another baseline.
    samples : joint samples.
    """

    dynamics: Dynamics
    samples: MeasuredSamples


@dataclass(eq=False)
class Measurement:
    """A measurement that runs, or whose fit does.

    Attributes
    ----------
    request : of the client.
    dynamics : robot without load.
    link : that carries the load.
    set_nodes : full names of the nodes that get the parameters.
    values : parameters of the node.
    drives : conversion from signals to joints.
    started : time of the node's clock [ns] at the first message; before it, at the request.
    baseline : samples without load that are fitted too; None: none.
    samples : joint samples so far.
    waiting : responses that are due at the end.
    is_stopped : whether the measurement ends before its time.
    is_fitted : whether the fit has begun.
    """

    request: IdentifyPayload.Request
    dynamics: Dynamics
    link: str
    set_nodes: tuple[str, ...]
    values: ParameterValues
    drives: Drives
    started: int
    baseline: Baseline | None
    samples: MeasuredSamples = field(init=False)
    waiting: list[DeferredResponse] = field(default_factory=list)
    is_stopped: bool = False
    is_fitted: bool = False

    def __post_init__(self) -> None:
        self.samples = MeasuredSamples("measurement without load" if self.request.without_load else "measurement")

    def add(self, sample: JointSample, now: int, is_base: bool) -> None:
        """Add a sample; now: time of the node's clock [ns]; is_base: whether it is of the odometry of the base."""
        if not len(self.samples):
            self.started = now
        self.samples.add(sample, is_base)

    def wait(self) -> DeferredResponse:
        """A response that is due at the end."""
        response = DeferredResponse()
        self.waiting.append(response)
        return response

    def elapsed(self, now: int) -> float:
        """Time since the start [s]; now: time of the node's clock [ns]."""
        return (now - self.started) / 1e9

    def is_over(self, now: int) -> bool:
        """Whether the measurement ends at a time of the node's clock [ns]."""
        elapsed = self.elapsed(now)
        limit = self.request.duration if len(self.samples) else SILENCE
        return self.is_stopped or len(self.samples) >= MAX_MESSAGES or not 0 <= elapsed < limit

    def recordings(self) -> tuple[list[Recording], list[Recording]]:
        """The recordings with load, and those without. Raises RecordingError where messages are missing."""
        loaded = [self._recording(self.samples)]
        empty = [] if self.baseline is None else [self._recording(self.baseline.samples)]
        return loaded, empty

    def _recording(self, samples: MeasuredSamples) -> Recording:
        return recording_of(samples, self.drives, base=moving_base_link(self.dynamics))


def load_drives_of(dynamics: Dynamics, path: str) -> Drives:
    """The drives in a file; of a robot without gears where the path is empty. Raises RecordingError."""
    return load_drives(path or None, dynamics.joint_names)
