"""External efforts, collisions and contact wrench of a robot, sample by sample: stamps checked, restarts explained."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.monitoring.collision_detector import CollisionDetector
from robot_dynamics.monitoring.momentum_observer import MomentumObserver

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.monitoring.collision_thresholds import CollisionThresholds
    from robot_dynamics.monitoring.momentum_balance import MomentumBalance

SETTLING_TIMES = 3.0
"""Time constants of the observer after a restart until its residual counts as settled: 95 % of a constant effort."""


@dataclass(frozen=True, eq=False)
class Observation:
    """What the observer knows at one sample.

    Attributes
    ----------
    stamp : int
        [ns]
    efforts : ndarray, shape (n,)
        External efforts of the joints [N m or N].
    base_wrench : ndarray, shape (6,) or (0,)
        External wrench on a moving base, in frame 0 at its origin: of all contacts together, the ground too.
    is_settled : bool
        Whether the observer runs long enough.
    is_collision, begins : bool
        Whether there is a collision, and whether it begins with this sample.
    """

    stamp: int
    efforts: Array
    base_wrench: Array
    is_settled: bool
    is_collision: bool
    begins: bool


class ContactObserver:
    """Observes a robot from sample to sample.

    Write the state into the arrays of `balance`, then call `update`.

    Parameters
    ----------
    balance : MomentumBalance
    thresholds : CollisionThresholds
        Their bandwidth is that of the observer.
    max_gap : float
        Time between two samples [s] beyond which the observer restarts.

    Attributes
    ----------
    balance : MomentumBalance
    detector : CollisionDetector
    restarts : int
        Number of restarts.
    restart_reason : str
        Why the observer restarted last; empty before the first restart.
    repeated : int
        Number of samples with the stamp of the sample before, which are left out.
    """

    def __init__(self, balance: MomentumBalance, thresholds: CollisionThresholds, max_gap: float = 0.1) -> None:
        self.balance = balance
        self.detector = CollisionDetector(thresholds)
        self.max_gap = max_gap
        self.restarts = 0
        self.restart_reason = ""
        self.repeated = 0
        self._observer = MomentumObserver(thresholds.bandwidth, balance.size)
        self._settling_time = SETTLING_TIMES / thresholds.bandwidth
        self._base_rows = balance.size - len(thresholds.joint_names)
        self._stamp: int | None = None

    def restart(self, reason: str) -> None:
        """Forget all samples, for a reason."""
        if self._stamp is not None:
            self.restarts += 1
            self.restart_reason = reason
        self._stamp = None
        self._observer.restart()
        self.detector.restart()

    def update(self, stamp: int) -> Observation | None:
        """Observe the state in `balance` at a time [ns].

        Returns
        -------
        Observation or None
            None for a sample that is left out, since its stamp is that of the sample before.

        Raises
        ------
        RobotDynamicsError
            The state cannot be used. The observer has restarted.
        """
        step = 0.0
        if self._stamp is not None:
            step = (stamp - self._stamp) * 1e-9
            if step == 0:
                self.repeated += 1
                return None
            if step < 0:
                self.restart(f"stamps went back by {-step:.3g} s")
            elif step > self.max_gap:
                self.restart(f"no samples for {step:.3g} s")
        try:
            momentum, rate = self.balance.evaluate()
        except RobotDynamicsError as error:
            self.restart(str(error))
            raise
        residual = self._observer.update(step, momentum, rate)
        self._stamp = stamp
        efforts = residual[self._base_rows :]
        decay = self._observer.decay[self._base_rows :]
        begins = self.detector.update(stamp, step, efforts, self.balance.joint_velocities, decay)
        return Observation(
            stamp=stamp,
            efforts=efforts,
            base_wrench=residual[: self._base_rows],
            is_settled=self._observer.age >= self._settling_time,
            is_collision=self.detector.is_collision,
            begins=begins,
        )
