"""The controller: a control law, a reference and a watchdog. Its efforts never jump and never exceed their limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.control.bumpless_transfer import BumplessTransfer
from robot_dynamics.control.modes import ADAPTIVE, COMPUTED_TORQUE, FEEDFORWARD, GRAVITY, PD_GRAVITY
from robot_dynamics.control.path_history import PathHistory
from robot_dynamics.control.reference import ReferencePoint, ScheduledTrajectory, Trajectory, check_points
from robot_dynamics.control.watchdog import Watchdog
from robot_dynamics.errors import InvalidInputError, RobotDynamicsError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray
    from robot_dynamics.control.control_law import ControlLaw
    from robot_dynamics.control.controller_settings import Settings
    from robot_dynamics.control.modes import CollisionAction

RETRACT_TIME = 0.5
"""Part of the path on which the robot goes back after a collision [s]."""
SHORTEST_LEAD = 0.01
"""Least time in which the robot turns back [s]."""


class Controller:
    """Computes efforts for states that arrive at times [s], and the reason of a fault where they do not.

    Write the state into the arrays of `law`, then call `step`, or `reject_state` where it cannot be used. Call `tick`
    in between. Each returns the efforts to send (joints,), in a buffer that the next call overwrites.

    Parameters
    ----------
    law : ControlLaw
    settings : Settings

    Attributes
    ----------
    law : ControlLaw
    settings : Settings
    watchdog : Watchdog
    reference : ndarray, shape (3, joints)
        Positions, velocities and accelerations of the controlled joints at the last step with a reference.
    fault : str
        Reason of the present fault; empty without a fault.
    activity : str
        The control mode in use, "fault", or "no reference: " and the action.
    collision : {"none", "hold", "retract", "gravity_compensation"}
        How the controller reacts to the present collision; "none" without one.
    adaptation : str
        "active", or why nothing is adapted; empty in other modes.

    Notes
    -----
    Without a usable state the efforts decay to zero in `ramp_time`. With a state but without a reference they are those
    of `without_reference`. After a fault longer than `ramp_time` the reference is dropped: the robot has moved in the
    meantime, and the controller does not decide where it should be then. A fault begins when the state becomes stale,
    also where the process stalls and detects it later.
    """

    def __init__(self, law: ControlLaw, settings: Settings) -> None:
        joint_count = len(law.joints)
        self.law = law
        self.settings = settings
        self.watchdog = Watchdog(settings.state_timeout, settings.deadline, settings.deadline_misses)
        self.reference = np.zeros((3, joint_count))
        self.fault = ""
        self.activity = ""
        self.adaptation = ""
        self._adapted_at = -math.inf  # [s]
        self.collision: CollisionAction = "none"
        self._path = PathHistory(RETRACT_TIME)
        self._transfer = BumplessTransfer(joint_count, settings.ramp_time, settings.limits)
        self._desired_efforts = np.zeros(joint_count)
        self._zero_efforts = np.zeros(joint_count)
        self._source: ScheduledTrajectory | ReferencePoint | None = None
        self._source_time = -math.inf  # [s] at which the reference came
        self._missing_reason = "no reference yet"
        self._last_fault = (-math.inf, -math.inf)  # [s] beginning, and last efforts that went to zero
        self._active_regime: str | None = None  # what the efforts follow, without a transition

    def apply(self, settings: Settings) -> None:
        """Use other settings; the efforts change without a jump. The same settings change nothing.

        Parameters
        ----------
        settings : Settings
        """
        if settings.equals(self.settings):
            return
        if settings.mode != self.settings.mode:
            self.watchdog.clear_latch()
        self.settings = settings
        self.watchdog.timeout = settings.state_timeout
        self.watchdog.deadline = settings.deadline
        self.watchdog.max_misses = settings.deadline_misses
        self._transfer.duration = settings.ramp_time
        self._transfer.limits = np.array(settings.limits, dtype=np.float64)
        self._active_regime = None

    def replace_law(self, law: ControlLaw) -> None:
        """Use another law, as for another payload or description; the efforts change without a jump.

        Parameters
        ----------
        law : ControlLaw
            A law of the same joints.
        """
        law.continue_from(self.law)
        self.law = law
        self._active_regime = None

    def restart(self) -> None:
        """Return to the initial condition: no states, no reference, no efforts."""
        self.watchdog.clear_latch()
        self.watchdog.restart()
        self._transfer.stop()
        self._last_fault = (-math.inf, -math.inf)
        self._source = None
        self._missing_reason = "no reference yet"
        self._active_regime = None
        self._path.clear()
        self.end_collision()
        self.fault = ""
        self.activity = ""

    @property
    def last_efforts(self) -> Array:
        """The last efforts (joints,)."""
        return self._transfer.last_efforts

    @property
    def saturated(self) -> BoolArray:
        """Which of the last efforts are at their limits (joints,)."""
        return self._transfer.saturated

    @property
    def no_reference_reason(self) -> str:
        """Why there is no reference; empty where there is one."""
        return "" if self._source is not None else self._missing_reason

    @property
    def source(self) -> ScheduledTrajectory | ReferencePoint | None:
        """What the present reference is sampled from; None where there is no reference."""
        return self._source

    def follow_trajectory(self, now: float, start: float, times: ArrayLike, points: Array) -> None:
        """Follow a trajectory from now on.

        Parameters
        ----------
        now : float
            [s]
        start : float
            Time at which the trajectory starts [s].
        times : array_like, shape (N,)
            Times of the points after the start [s]. Without points the present reference ends.
        points : ndarray, shape (3, N, joints)
            Positions, velocities and accelerations of the links; nan where they are not specified.

        Raises
        ------
        InvalidInputError
            The trajectory cannot be followed: it is over, a position exceeds a limit, or the present position is
            unknown. The reference before it remains.

        Notes
        -----
        Where the trajectory starts later than now, it is reached from the present reference, or from the position of
        the robot.
        """
        self.follow(now, start, self.prepare_trajectory(times, points))

    def prepare_trajectory(
        self, times: ArrayLike, points: Array, yield_thread: Callable[[], None] = lambda: None
    ) -> Trajectory | None:
        """Return a trajectory for `follow`, None without points. Another thread may call it.

        Parameters
        ----------
        times, points : array_like, ndarray
            As in `follow_trajectory`.
        yield_thread : callable
            As in `Trajectory`.

        Raises
        ------
        InvalidInputError
            The trajectory cannot be followed at any time.
        """
        times = np.asarray(times, dtype=np.float64)
        if len(times) == 0:
            return None
        check_points(times, *points[:2])
        self.law.check_within_limits(points[0])
        positions, velocities, accelerations = points
        return Trajectory(times, positions, velocities, accelerations, yield_thread)

    def follow(self, now: float, start: float, trajectory: Trajectory | None, received: float | None = None) -> None:
        """Follow a prepared trajectory from now on, as `follow_trajectory`.

        Parameters
        ----------
        now, start : float
            The present time, and that at which the trajectory starts [s].
        trajectory : Trajectory or None
            From `prepare_trajectory` for the same joints.
        received : float, optional
            Time at which it was received, before it was prepared [s]; by default now.

        Raises
        ------
        InvalidInputError
            The trajectory is over, the present position is unknown, or a fault since it was received was longer than
            `ramp_time`. The reference before it remains.
        """
        self._require_no_collision()
        if trajectory is None:
            self._source = None
            self._missing_reason = "the reference was ended"
            return
        end = start + trajectory.end
        if end < now:
            raise InvalidInputError(
                f"the trajectory ended {now - end:.3f} s ago: header.stamp is when it starts, zero for now"
            )
        began, ended = self._last_fault
        if received is not None and ended - max(began, received) > self.settings.ramp_time:
            raise InvalidInputError("efforts went to zero while the trajectory was read: send it again")
        if received is not None and received > now:
            raise InvalidInputError("the clock jumped back while the trajectory was read: send it again")
        first, lead = start + trajectory.start, None
        if first > now:
            present = self._present_point(now, trajectory.first_point)
            lead = Trajectory.between(np.array([now, first]), np.stack([present, trajectory.first_point], axis=1))
        self._set_source(now, ScheduledTrajectory(trajectory, start, lead))

    def react_to_collision(self, now: float, action: CollisionAction) -> None:
        """Leave the reference, and refuse others until `end_collision`.

        Parameters
        ----------
        now : float
            [s]
        action : {"none", "hold", "retract", "gravity_compensation"}
            Stop and stay; go back on the last half second of the path at half the speed, and stay; or yield to forces.
            In mode gravity_compensation, which follows no reference, the robot yields in any case.
        """
        self.end_collision()
        if action == "none":
            return
        path = self._path.way_back(max(self.settings.ramp_time, SHORTEST_LEAD)) if action == "retract" else None
        if action == "gravity_compensation":
            self.follow(now, now, None)
        elif path is None or self.watchdog.fault(now):
            self.hold(now, measured=True)
        else:
            times, points = path
            self._source = None  # begin at the robot, not at its reference
            self._active_regime = None
            positions, velocities, accelerations = points
            self.follow(now, now, Trajectory(times, self.law.clip_to_limits(positions), velocities, accelerations))
        self._missing_reason = "it ended with a collision"
        self.collision = action

    def end_collision(self) -> None:
        """Accept references again. The reference of the reaction stays until another one comes."""
        self.collision = "none"

    def _require_no_collision(self) -> None:
        if self.collision != "none":
            raise InvalidInputError(
                f"a collision was reported, and the reaction is {self.collision}: references are refused until it ends"
            )

    def hold(self, now: float, measured: bool = False, efforts: Array | None = None) -> None:
        """Stop the reference within `ramp_time` with a constant deceleration, and hold it there.

        During a fault the reference ends instead.

        Parameters
        ----------
        now : float
            [s]
        measured : bool
            Stop from the position and velocity of the robot, without a jump of the efforts, not from those of the
            reference.
        efforts : ndarray, shape (joints,), optional
            With `measured`: efforts from which those of the stop depart; by default the last ones.
        """
        if self.watchdog.fault(now) or self.watchdog.last_state_time is None:
            self.follow(now, now, None)
            return
        if measured:
            self._source = None
            self._active_regime = None
            if efforts is not None:
                self._transfer.depart_from(efforts)
        duration = self.settings.ramp_time
        present = self._present_point(now, np.zeros((3, len(self.law.joints))))
        stop = self.law.clip_to_limits(present[0] + 0.5 * duration * present[1])
        rest = np.zeros((1, len(stop)))
        unspecified = np.full_like(rest, np.nan)
        self.follow(now, now, Trajectory([duration], stop[None], rest, unspecified))

    def _present_point(self, now: float, first_point: Array) -> Array:
        """Point (3, joints) of the present reference, or of the robot, with the derivatives of the first point."""
        point = np.zeros((3, len(self.law.joints)))
        if self._source is not None and self.watchdog.faulted_since is None:
            self._source.sample(now, point)
        elif self.watchdog.last_state_time is None:
            raise InvalidInputError(
                "there is no state yet, from which to move to the first point. A trajectory whose first point has "
                "time_from_start 0 needs none"
            )
        else:
            point[:2] = self.law.link_motion()
        return np.where(np.isnan(first_point), np.nan, point)

    def track_point(self, now: float, time: float, values: ArrayLike) -> None:
        """Track one point of a stream from now on.

        Parameters
        ----------
        now : float
            [s]
        time : float
            Time of the point [s].
        values : array_like, shape (3, joints)
            Positions, velocities and accelerations of the links.

        Raises
        ------
        InvalidInputError
            The point is too old, or ahead of the clock by more than `reference_timeout`, or a position exceeds a limit.
            The reference before it remains.
        """
        self._require_no_collision()
        lifetime = self.settings.reference_timeout
        if now - time > lifetime:
            raise InvalidInputError(f"the point is {now - time:.3f} s old, a point is valid for {lifetime:g} s")
        if not time - now <= lifetime:
            raise InvalidInputError(
                f"the point is {time - now:.3f} s ahead of the clock, but a point is valid for {lifetime:g} s: "
                "stamp it with the present time"
            )
        self.law.check_within_limits(np.asarray(values)[:1])
        self._set_source(now, ReferencePoint(time, values, min(time, now) + lifetime))

    def _set_source(self, now: float, source: ScheduledTrajectory | ReferencePoint) -> None:
        self._source = source
        self._source_time = now
        self.watchdog.clear_latch()

    @np.errstate(all="ignore")  # numbers that are not finite are a fault
    def step(self, now: float, time: float | None = None, published: float | None = None) -> Array:
        """Efforts for a state in the arrays of the law.

        Parameters
        ----------
        now : float
            [s]
        time, published : float, optional
            Times of the state and of its publication [s]; by default now.

        Returns
        -------
        ndarray, shape (joints,)
            Efforts to send [N m or N], a buffer.
        """
        law = self.law
        # a sum is finite where all its terms are, and one number is checked faster than many
        if not math.isfinite(law.q.dot(law.q) + law.qd.dot(law.qd)):
            return self.reject_state(now, _describe_not_finite(law))
        self.watchdog.check_clock(now)
        self.watchdog.accept_state(now if published is None else published)
        return self._compute_efforts(now, now if time is None else time)

    def reject_state(self, now: float, reason: str) -> Array:
        """Efforts that decay to zero, for a state that cannot be used.

        Parameters
        ----------
        now : float
            [s]
        reason : str

        Returns
        -------
        ndarray, shape (joints,)
            Efforts to send [N m or N], a buffer.
        """
        self.watchdog.check_clock(now)
        self.watchdog.reject_state(reason)
        return self._compute_efforts(now, now)

    def handle_overdue_efforts(self, now: float) -> Array:
        """Efforts that decay to zero, in the place of efforts that could not be sent in time.

        Parameters
        ----------
        now : float
            [s]

        Returns
        -------
        ndarray, shape (joints,)
            Efforts to send [N m or N], a buffer.
        """
        self.watchdog.check_clock(now)
        if not self.watchdog.fault(now):
            self.watchdog.reject_state("efforts were ready later than state_timeout after their state")
        return self._compute_efforts(now, now)

    def halt(self, reason: str) -> Array:
        """Zero efforts at once, and until a good state comes.

        They are for a clock that stands still, so that no ramp would end, and for a sender that is too slow for a ramp.

        Parameters
        ----------
        reason : str

        Returns
        -------
        ndarray, shape (joints,)
            Efforts to send [N m or N], a buffer.
        """
        self.watchdog.reject_state(reason)
        self.fault = reason
        self._enter_regime("fault")
        self._transfer.stop()
        return self.last_efforts

    def tick(self, now: float) -> Array | None:
        """Efforts that decay to zero during a fault.

        Parameters
        ----------
        now : float
            [s]

        Returns
        -------
        ndarray, shape (joints,), or None
            Efforts to send [N m or N], a buffer; None without a fault.
        """
        self.watchdog.check_clock(now)
        self.fault = self.watchdog.fault(now)
        return self._decay_to_zero(now) if self.fault else None

    def _compute_efforts(self, now: float, time: float) -> Array:
        """Efforts at a time [s] for the state of another time [s]."""
        self.fault = self.watchdog.fault(now)
        if self.fault:
            return self._decay_to_zero(now)
        try:
            activity = self._apply_law(time)
        except RobotDynamicsError as error:  # loops that do not close
            return self._fail(now, str(error))
        if not math.isfinite(self._desired_efforts.dot(self._desired_efforts)):
            return self._fail(now, "the model gives efforts that are not finite in this state")
        self._enter_regime(activity)
        efforts = self._transfer.update(now, self._desired_efforts)
        if self.collision == "none" and self._path.is_due(now):
            self._path.record(now, self.law.link_motion())
        self.adaptation = self._adapt(now) if activity == ADAPTIVE else ""
        return efforts

    def _adapt(self, now: float) -> str:
        """Adapt the parameters of the law to the present efforts, unless others were sent; returns what was done."""
        step = now - self._adapted_at
        self._adapted_at = now
        if self.collision != "none":
            return "frozen: collision"
        if self.saturated.any():
            return "frozen: an effort is at its limit"
        if self._transfer.is_in_transition:
            return "frozen: efforts are in a transition"
        if not 0 < step <= self.settings.state_timeout:
            return "frozen: there was no state for too long"
        adaptive = self.law.adaptive
        assert adaptive is not None, "the mode is refused without it"
        return "active" if adaptive.adapt(step, self.settings.adaptation) else "frozen: the error is in the dead zone"

    def _fail(self, now: float, reason: str) -> Array:
        self.watchdog.reject_state(reason)
        self.fault = self.watchdog.fault(now)
        return self._decay_to_zero(now)

    def _decay_to_zero(self, now: float) -> Array:
        since = self.watchdog.faulted_since
        assert since is not None  # there is a fault
        self._enter_regime("fault", since)
        self.adaptation = "frozen: fault" if self.settings.mode == ADAPTIVE else ""
        self._last_fault = since, now
        if since < self._source_time <= now:  # the reference came during the fault
            since = self._source_time
        if self._source is not None and now - since > self.settings.ramp_time:
            self._source = None
            self._missing_reason = f"it was dropped when efforts went to zero: {self.fault}"
        return self._transfer.update(now, self._zero_efforts)

    def _enter_regime(self, activity: str, since: float | None = None) -> None:
        """Start a transition where the efforts follow something else than before."""
        if activity != self._active_regime:
            self._transfer.start_transition(since)
            self._active_regime = activity
            self.activity = activity

    def _apply_law(self, time: float) -> str:
        """Compute the desired efforts at a time [s] of the state; the activity."""
        law, settings, out = self.law, self.settings, self._desired_efforts
        mode = settings.mode
        if mode == GRAVITY:
            law.gravity_compensation(out)
            return mode
        source = self._source
        if isinstance(source, ReferencePoint) and time > source.end:
            self._source = source = None
            timeout = settings.reference_timeout
            self._missing_reason = f"no point of the stream for more than {timeout * 1e3:g} ms"
        if source is None:
            return self._apply_without_reference(out)
        law.sample_reference(source, time, self.reference)
        if mode == COMPUTED_TORQUE:
            law.computed_torque(self.reference, settings.kp, settings.kd, out, settings.friction_velocity)
        elif mode == FEEDFORWARD:
            law.feedforward(self.reference, out)
        elif mode == PD_GRAVITY:
            law.pd_gravity(self.reference, settings.kp, settings.kd, out)
        elif mode == ADAPTIVE:
            law.adaptive_computed_torque(self.reference, settings.kp, settings.kd, out)
        return mode

    def _apply_without_reference(self, out: Array) -> str:
        action = "gravity" if self.collision == "gravity_compensation" else self.settings.without_reference
        if action == "gravity":
            self.law.gravity_compensation(out)
        elif action == "damp":
            self.law.damping(self.settings.kd, out)
        else:
            out[:] = 0.0
        return f"no reference: {action}"


def _describe_not_finite(law: ControlLaw) -> str:
    """The first number of the state that is not finite."""
    for values, quantity in ((law.q, "position"), (law.qd, "velocity")):
        not_finite = np.flatnonzero(~np.isfinite(values))
        if len(not_finite):
            joint = not_finite[0]
            return f"{quantity} of joint {law.dynamics.joint_names[joint]!r} is {values[joint]}"
    return "positions and velocities are too large"
