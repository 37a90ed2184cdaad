"""Evidence of faults: the residuals of a recording, collected in bounded memory while it is read."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.checking.block_averages import BlockAverages
from robot_dynamics.checking.contacts import find_contact_at_rest
from robot_dynamics.checking.fault_search import FaultSearch, name_contact
from robot_dynamics.checking.fault_signals import FIXED_ROWS, FaultSignals
from robot_dynamics.checking.load_hint import last_link_name, unit_payload_models
from robot_dynamics.checking.recording_faults import Gap, fault_of_jump, find_missing_rows
from robot_dynamics.checking.swapped_joints import SwapSearch
from robot_dynamics.recordings.joint_motions import EDGE_PERIODS

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.check import Predictor
    from robot_dynamics.checking.fault_search import Fault
    from robot_dynamics.recordings.joint_motions import Motion
    from robot_dynamics.recordings.position_jumps import PositionJump

MAX_SAMPLES = 40_000  # kept in memory; longer recordings are averaged over blocks
MAX_VALUES = 20_000_000  # kept in memory, of all signals
SAMPLES_PER_PERIOD = 6  # of the cut-off
MIN_SAMPLES = 100
OFFSET_STEP = 0.01  # [rad or m] by which positions are shifted to find the effect of an encoder offset


class Evidence:
    """Collects the residuals of a recording, in bounded memory, and finds the fault that explains them.

    Parameters
    ----------
    predictor : of the robot without fault.
    link : name of the link that may carry a payload; None: the last link.
    """

    def __init__(self, predictor: Predictor, link: str | None = None) -> None:
        self._predictor = predictor
        robot = predictor.dynamics.robot
        self.link = link or last_link_name(robot)
        self.names = predictor.dynamics.joint_names
        self._joints = tuple(robot.joints[robot.joint_numbers[name]] for name in self.names)
        self._loaded = unit_payload_models(robot, self.link)
        moving_mass = sum(link.inertia.mass for link in robot.links[1:])
        self._masses = robot.links[robot.frame(self.link).link].inertia.mass, moving_mass
        self._averages: BlockAverages | None = None  # of rows for FaultSignals
        self._cutoff = 0.0
        self._jumps: list[PositionJump] = []
        self._begin: tuple[float, float] | None = None  # time of the first motion, and edge of the filter [s]
        self._swaps = SwapSearch(predictor)
        self._end: float | None = None  # of the last motion
        self._longest_gap: Gap | None = None
        self._has_efforts = np.ones(len(self.names), dtype=bool)

    def add(self, motion: Motion, predicted: Array, origin: int = 0) -> None:
        """Add a motion and its predicted efforts (N, n); origin is not used (the interface of `PieceCallback`)."""
        n = len(self.names)
        self._note_gap(motion)
        self._swaps.add(motion)
        if motion.jump is not None:
            self._jumps.append(motion.jump)
        if self._averages is None:
            stride = max(1, int(motion.rate / (SAMPLES_PER_PERIOD * motion.cutoff)))
            max_rows = min(MAX_SAMPLES, MAX_VALUES // (n * (FIXED_ROWS + n)) // 2 * 2)
            self._averages = BlockAverages(stride, max_rows)
            self._cutoff = motion.cutoff
        self._has_efforts &= motion.has_efforts
        payload_efforts = [self._predictor.efforts(loaded, motion) - predicted for loaded in self._loaded]
        offset_efforts = [self._offset_effect(motion, predicted, joint) for joint in range(n)]
        times = np.broadcast_to(motion.times[:, None], predicted.shape)
        signs = np.sign(motion.qd)
        recorded = np.ones(len(motion)) if motion.recorded is None else motion.recorded
        counts = np.broadcast_to(recorded[:, None], predicted.shape)
        rows = [times, motion.moving, counts, motion.unfiltered_efforts, predicted, signs, motion.qd]
        self._averages.add(np.stack([*rows, *payload_efforts, *offset_efforts]))

    def _note_gap(self, motion: Motion) -> None:
        """Keep the gap before a motion if it is the longest; the filter leaves out an edge at each side."""
        edge = EDGE_PERIODS / motion.cutoff
        if self._begin is None:
            self._begin = motion.time, edge
        self._keep_gap(motion.time, edge)
        self._end = motion.end

    def _keep_gap(self, begin: float, edge: float) -> None:
        """Keep the gap between the last motion and a time [s]."""
        if self._end is not None:
            self._keep_longest(Gap(self._end + edge, begin - self._end - 2 * edge))

    def _keep_longest(self, gap: Gap) -> None:
        if self._longest_gap is None or gap.duration > self._longest_gap.duration:
            self._longest_gap = gap

    def append(self, later: Evidence) -> None:
        """Add the evidence of a later part of the same recording."""
        if later._averages is None or later._begin is None:
            return
        self._jumps += later._jumps
        self._swaps.append(later._swaps)
        self._keep_gap(*later._begin)
        if later._longest_gap is not None:
            self._keep_longest(later._longest_gap)
        if self._averages is None:
            self._begin, self._averages = later._begin, later._averages
        else:
            self._averages.append(later._averages)
        self._end, self._cutoff = later._end, later._cutoff
        self._has_efforts &= later._has_efforts

    def _offset_effect(self, motion: Motion, predicted: Array, joint: int) -> Array:
        """Change of residuals (N, n) for each rad or m by which positions of a joint are recorded too large.

        The prediction for recorded positions is `predicted`; the measured efforts are those of smaller positions.
        """
        q = motion.q.copy()
        q[:, joint] -= OFFSET_STEP
        return (self._predictor(replace(motion, q=q)) - predicted) / OFFSET_STEP

    def find_fault(self) -> Fault | None:
        """Find the fault that explains the residuals.

        Returns
        -------
        Fault or None
            None where no fault explains enough, or the samples are too few.
        """
        signals = self._signals()
        if signals is None:
            return None
        faults = (fault_of_jump(jump, self.names, signals.step) for jump in self._jumps)
        fault = next((each for each in faults if each is not None), None)
        fault = fault or find_missing_rows(signals, self._longest_gap) or self._swaps.find_swapped_columns(self.names)
        if fault is not None:
            return fault
        if signals.valid.any(axis=1).sum() >= MIN_SAMPLES:
            fault = FaultSearch(signals, self.names, self._joints, self.link, self._masses).fault()
        if fault is not None:
            return fault
        contact = find_contact_at_rest(signals, self._joints)
        return self._swaps.find_swapped_efforts(self.names) if contact is None else name_contact(contact, self.names)

    def _signals(self) -> FaultSignals | None:
        """The signals of the recording; None where the samples are too few."""
        if self._averages is None:
            return None
        rows = self._averages.rows
        if rows.shape[1] < MIN_SAMPLES:
            return None
        rows[1:, :, ~self._has_efforts] = 0
        return FaultSignals.from_rows(rows, self._cutoff)
