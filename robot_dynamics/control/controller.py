"""The controller: a law, a reference and a watchdog, whose efforts never jump and never exceed their limits."""

import math
from dataclasses import dataclass

import numpy as np

from robot_dynamics.control.bumpless_transfer import BumplessTransfer
from robot_dynamics.control.control_law import COMPUTED_TORQUE, FEEDFORWARD, GRAVITY, PD_GRAVITY, REFERENCE
from robot_dynamics.control.reference import ReferencePoint, Trajectory, check_points
from robot_dynamics.control.watchdog import Watchdog
from robot_dynamics.errors import InvalidInputError, RobotDynamicsError


@dataclass(frozen=True)
class Settings:
    """What the parameters say of the controller of some joints.

    kp: (joints,) [1/s²]; kd: (joints,) [1/s]; limits: (joints,) efforts [N m or N]; times in s. friction_velocity:
    of which computed_torque compensates the friction, `reference` or `measured`.
    """

    mode: str
    kp: np.ndarray
    kd: np.ndarray
    limits: np.ndarray
    without_reference: str = "damp"
    state_timeout: float = 0.02
    reference_timeout: float = 0.1
    ramp_time: float = 0.1
    deadline: float = 0.005
    deadline_misses: int = 10
    friction_velocity: str = REFERENCE


class Controller:
    """Efforts for a Law from states that come at times `now` [s], and what is wrong when there are none.

    The state is written into the arrays of `law`; then `step` is called, or `refuse` where it cannot be used; `tick`
    in between. Each gives the efforts to send, (joints,), in a buffer that the next call writes into.

    Where the state is not known, efforts go to zero in ramp_time; where it is, but no reference, as without_reference
    says. After a fault that lasted longer than ramp_time the reference is dropped: the robot has moved meanwhile, and
    where it should be then is not for the controller to say. A fault lasts from when the state became stale, also where
    this process stood still and noticed it later.
    """

    def __init__(self, law, settings):
        self.law = law
        self.watchdog = Watchdog(settings.state_timeout, settings.deadline, settings.deadline_misses)
        self._blend = BumplessTransfer(len(law.joints), settings.ramp_time, settings.limits)
        self.reference = np.zeros((3, len(law.joints)))
        self._target, self._zero = np.zeros((2, len(law.joints)))
        self._followed, self._dropped, self._taken_at = None, "no reference yet", -math.inf
        self._regime = None
        self.fault, self.activity, self.settings = "", "", settings

    def apply(self, settings):
        """Take other settings; efforts go over to what they want without a jump."""
        if settings.mode != self.settings.mode:
            self.watchdog.clear_latch()
        self.settings = settings
        self.watchdog.timeout, self.watchdog.deadline = settings.state_timeout, settings.deadline
        self.watchdog.max_misses = settings.deadline_misses
        self._blend.duration, self._blend.limits = settings.ramp_time, np.array(settings.limits, dtype=float)
        self._regime = None

    def replace_law(self, law):
        """Go on with a Law of the same joints: another payload, or another description."""
        law.continue_from(self.law)
        self.law, self._regime = law, None

    def restart(self):
        """As if it had just been made: nothing heard, no reference, no efforts."""
        self.watchdog.clear_latch()
        self.watchdog.restart()
        self._blend.last_efforts[:] = 0.0
        self._followed, self._dropped, self._regime = None, "no reference yet", None
        self.fault, self.activity = "", ""

    @property
    def last_efforts(self):
        """The efforts that were sent last (joints,)."""
        return self._blend.last_efforts

    @property
    def saturated(self):
        """Which of them are at their limits (joints,)."""
        return self._blend.saturated

    @property
    def no_reference_reason(self):
        """Why there is no reference, empty where there is one."""
        return "" if self._followed is not None else self._dropped

    def follow_trajectory(self, now, start, times, points):
        """Take a trajectory: times (N,) [s] of its points after `start`, points: (3, N, joints), nan where not told.

        Where it begins later than now, it is reached from the reference that there is, else from where the robot is. No
        points end what is followed. Raises QuestionError where it cannot be followed, as beyond the limits of joints;
        the one before stays then.
        """
        if len(times) == 0:
            self._followed, self._dropped = None, "the reference was ended"
            return
        check_points(np.asarray(times, dtype=float), *points[:2])  # before a point comes in front of them
        self.law.check_within_limits(points[0])
        times = np.asarray(times, dtype=float) + start
        if times[-1] < now:
            raise InvalidInputError(
                f"the trajectory ended {now - times[-1]:.3f} s ago: header.stamp is when it starts, zero for now"
            )
        if times[0] > now:
            times = np.concatenate([[now], times])
            points = np.concatenate([self._from_here(now, points[:, 0])[:, None], points], axis=1)
        self._take(now, Trajectory(times, *points))

    def _from_here(self, now, first):
        """(3, joints): where the reference is, or else the robot, with as many derivatives as the first point tells."""
        here, law = np.zeros((3, len(self.law.joints))), self.law
        if self._followed is not None and self.watchdog.faulted_since is None:
            self._followed.sample(now, here)
        elif self.watchdog.last_state_time is None:
            raise InvalidInputError(
                "there is no state yet, from which to go to the first point. A trajectory whose first point has "
                "time_from_start 0 needs none"
            )
        else:
            here[:2] = law.link_motion()
        return np.where(np.isnan(first), np.nan, here)

    def track_point(self, now, time, told):
        """Take one point of a stream: told (3, joints) at a time. Raises QuestionError where it is too old, or beyond
        the limits of joints."""
        lasts = self.settings.reference_timeout
        if now - time > lasts:
            raise InvalidInputError(f"the point is {now - time:.3f} s old, and a point counts for {lasts:g} s")
        self.law.check_within_limits(told[:1])
        self._take(now, ReferencePoint(time, told, lasts))

    def _take(self, now, reference):
        self._followed, self._taken_at = reference, now
        self.watchdog.clear_latch()

    @np.errstate(all="ignore")  # what is not finite is a fault
    def step(self, now, time=None, published=None):
        """The state is that of `time` [s] and was published at `published` [s], both now if None: efforts (joints,)."""
        law, time = self.law, now if time is None else time
        # a sum is finite where all its numbers are, and one number is quicker to look at than many
        if not math.isfinite(law.q.dot(law.q) + law.qd.dot(law.qd)):
            return self.reject_state(now, _not_finite(law))
        self.watchdog.check_clock(now)
        self.watchdog.accept_state(now if published is None else published)
        return self._efforts(now, time)

    def reject_state(self, now, reason):
        """A state came that cannot be used: efforts on the way to zero."""
        self.watchdog.check_clock(now)
        self.watchdog.reject_state(reason)
        return self._efforts(now, now)

    def handle_overdue_efforts(self, now):
        """The efforts of the last call could not be sent in time: efforts on the way to zero in their place."""
        self.watchdog.check_clock(now)
        if not self.watchdog.fault(now):
            self.watchdog.reject_state("efforts were ready later than state_timeout after their state")
        return self._efforts(now, now)

    def halt(self, reason):
        """Efforts of zero at once, and from then on until a good state: time stands still, and no ramp would end, or
        what is sent on a ramp comes too late."""
        self.watchdog.reject_state(reason)
        self.fault = reason
        self._enter("fault")
        self._blend.stop()
        return self.last_efforts

    def tick(self, now):
        """Efforts to send where no good state did it lately, else None."""
        self.watchdog.check_clock(now)
        self.fault = self.watchdog.fault(now)
        return self._to_zero(now) if self.fault else None

    def _efforts(self, now, time):
        self.fault = self.watchdog.fault(now)
        if self.fault:
            return self._to_zero(now)
        try:
            activity = self._wanted(time)
        except RobotDynamicsError as error:  # loops that do not close
            return self._failed(now, str(error))
        if not math.isfinite(self._target.dot(self._target)):
            return self._failed(now, "the model gives efforts that are not finite in this state")
        self._enter(activity)
        return self._blend.update(now, self._target)

    def _failed(self, now, reason):
        self.watchdog.reject_state(reason)
        self.fault = self.watchdog.fault(now)
        return self._to_zero(now)

    def _to_zero(self, now):
        since = self.watchdog.faulted_since
        self._enter("fault", since)
        if since < self._taken_at <= now:  # a reference that came during the fault
            since = self._taken_at
        if self._followed is not None and now - since > self.settings.ramp_time:
            self._followed, self._dropped = None, f"it was dropped as efforts went to zero: {self.fault}"
        return self._blend.update(now, self._zero)

    def _enter(self, activity, since=None):
        if activity != self._regime:
            self._blend.start_transition(since)
            self._regime = self.activity = activity

    def _wanted(self, time):
        """Write the efforts that the law wants into _target; returns what is being done."""
        law, settings, out = self.law, self.settings, self._target
        mode = settings.mode
        if mode == GRAVITY:
            law.gravity_compensation(out)
            return mode
        followed = self._followed
        if isinstance(followed, ReferencePoint) and time > followed.end:
            lasts = settings.reference_timeout
            self._followed, self._dropped = None, f"no point of the stream for more than {lasts * 1e3:g} ms"
        if self._followed is None:
            return self._unled(out)
        law.sample_reference(followed, time, self.reference)
        if mode == COMPUTED_TORQUE:
            law.computed_torque(self.reference, settings.kp, settings.kd, out, settings.friction_velocity)
        elif mode == FEEDFORWARD:
            law.feedforward(self.reference, out)
        elif mode == PD_GRAVITY:
            law.pd_gravity(self.reference, settings.kp, settings.kd, out)
        return mode

    def _unled(self, out):
        what = self.settings.without_reference
        if what == "gravity":
            self.law.gravity_compensation(out)
        elif what == "damp":
            self.law.damping(self.settings.kd, out)
        else:
            out[:] = 0.0
        return f"no reference: {what}"


def _not_finite(law):
    for values, what in ((law.q, "position"), (law.qd, "velocity")):
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong):
            return f"{what} of joint {law.dynamics.joint_names[wrong[0]]!r} is {values[wrong[0]]}"
    return "positions and velocities are beyond all measure"
