"""The one door to the dynamics of a robot: `Dynamics(robot)`. What numbers mean is the same here and on every topic.

Joint vectors are (..., n) in the order of `joint_names`, one sample (n,) or any batch (N, n). SI units. Efforts are
what the actuators deliver at the joints. External wrenches are what the environment does to a link, [force; torque] in
the link's own frame at its origin. Accelerations are true (gravity is not taken off) and classical, of the frame's
origin.
"""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import QuestionError, SingularModelError
from robot_dynamics.model.placement import inverse
from robot_dynamics.model.robot import Robot
from robot_dynamics.newton_euler import recursion
from robot_dynamics.newton_euler.coupling import coupled_accelerations, coupling, projection
from robot_dynamics.newton_euler.friction import friction
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import link_placements, sweep_forward
from robot_dynamics.newton_euler.screw import wrench_to_antecedent
from robot_dynamics.newton_euler.walker_orin import bias, inertia_matrix
from robot_dynamics.question import Base, base_state, common_batch, finite, link_wrenches

__all__ = ["BASE_ROWS", "Answer", "Base", "Dynamics"]

BASE_ROWS = tuple(f"base.{kind}.{axis}" for kind in ("linear", "angular") for axis in "xyz")
SINGULAR = 1e-14  # an inertia below this part of the largest one beside it is rounding


@dataclass(frozen=True, eq=False)
class Answer:
    """The dynamics of a state.

    accelerations, efforts: (..., n), one of them as given; base_acceleration: (..., 6), None where the base is fixed;
    reactions: (..., 1 + joints, 6) [N, N m], first what the ground exerts on the base, in frame 0, then what each of
    all joints exerts on the link it moves, in the link frame of that link, at its origin.
    """

    accelerations: np.ndarray
    efforts: np.ndarray
    base_acceleration: np.ndarray | None
    reactions: np.ndarray


class Dynamics:
    """Inverse and direct dynamics of a robot, for one sample or a batch.

    joint_names: the joints of the vectors, in their order: branch by branch, as the description has them. Joints that
    depend on others (mimic joints) are not among them; all_joint_names has these too. `expand`, `expand_rates`,
    `gather_efforts` and `spread_efforts` go from one set to the other.

    Arguments are q, qd, qdd, efforts: (..., n); base: a Base, for a robot with a moving base and for no other;
    external_wrenches: {link name: (..., 6)}. Every method raises QuestionError for an argument that does not fit.
    """

    def __init__(self, robot):
        if not isinstance(robot, Robot):
            raise QuestionError(f"Dynamics takes a Robot, as load_robot gives it, not {robot!r:.60}")
        self.robot = robot
        self._S, self._offset, self._independent = coupling(robot)
        self._projection = projection(self._S, 6 if robot.moving_base else 0)
        # how each frame j stands in the link frame that the description gives
        placements = [inverse(robot.frame(link.name).placement) for link in robot.links]
        self._in_link_frame = [(placed[:3, :3], placed[:3, 3]) for placed in placements]
        self.all_joint_names = tuple(joint.name for joint in robot.joints)
        self.joint_names = tuple(self.all_joint_names[number] for number in self._independent)

    def __repr__(self):
        return f"Dynamics({self.robot!r})"

    def inverse(self, q, qd, qdd, *, base=None, external_wrenches=None):
        """Efforts (..., n) [N m or N] of a motion: bodies, rotors, gravity and friction, less the external wrenches.

        Source: Khalil, sections 3.2 and 7.2.
        """
        return self.solve(q, qd, qdd=qdd, base=base, external_wrenches=external_wrenches).efforts

    def direct(self, q, qd, efforts, *, base=None, external_wrenches=None):
        """Accelerations (..., n) [rad/s² or m/s²] that efforts cause.

        Raises SingularModelError where some motion moves nothing with inertia. Source: Khalil, sections 3.3.2 and 7.3.
        """
        return self.solve(q, qd, efforts=efforts, base=base, external_wrenches=external_wrenches).accelerations

    def solve(self, q, qd, *, qdd=None, efforts=None, base=None, external_wrenches=None):
        """The whole Answer for accelerations qdd or for efforts, whichever is given; see `inverse` and `direct`."""
        if (qdd is None) == (efforts is None):
            raise QuestionError("give accelerations or efforts, one of the two: the other is the answer")
        given = self._joints("efforts", efforts) if qdd is None else self._joints("accelerations", qdd)
        state = self._state(q, qd, base, external_wrenches, given)
        with np.errstate(all="ignore"):  # what is not finite is refused below
            lost = friction(self.robot, state.qd)
            if qdd is None:
                efforts = given
                qdd, base_acceleration, wrenches = self._pushed(state, given - lost @ self._S)
            else:
                qdd = given
                forces, base_acceleration, wrenches = self._led(state, given @ self._S.T)
                efforts = (forces + lost) @ self._S
            base_acceleration = state.base.true_acceleration(base_acceleration)
            reactions = self._in_link_frames(wrenches)
        return Answer(
            _filled(qdd, state.batch),
            _filled(efforts, state.batch),
            _filled(base_acceleration, state.batch) if self.robot.moving_base else None,
            _filled(reactions, state.batch, axes=2),
        )

    def inertia_matrix(self, q):
        """A (..., n, n) [kg m², kg m or kg], rotors counted; with a moving base (..., 6 + n, 6 + n), the base first.

        Source: Khalil, sections 3.3.1 and 7.1.
        """
        q = self.expand(q)
        P = self._projection
        with np.errstate(all="ignore"):
            return _filled(P.T @ inertia_matrix(self.robot, q) @ P, q.shape[:-1], axes=2)

    def gravity(self, q, *, base=None):
        """g(q) alone (..., n): the efforts that hold the robot at rest; with a moving base (..., 6 + n)."""
        state = self._state(q, np.zeros(len(self.joint_names)), base)
        return self._bias(state, base, np.zeros(6), state.base.at_rest)

    def coriolis(self, q, qd, *, base=None):
        """C(q, q̇)q̇ alone (..., n): neither gravity nor friction; with a moving base (..., 6 + n), the base first."""
        state = self._state(q, qd, base)
        return self._bias(state, base, state.base.twist, np.zeros(6))

    def friction(self, qd):
        """Viscous and Coulomb friction alone (..., n) [N m or N]; none at rest."""
        qd = self._joints("velocities", qd)
        with np.errstate(all="ignore"):
            return _filled(friction(self.robot, qd @ self._S.T) @ self._S, qd.shape[:-1])

    def link_pose(self, name, q, *, base=None):
        """Pose (..., 4, 4) of a link frame in the world, which is frame 0 where the base is fixed."""
        frame, state = self.robot.frame(name), self._state(q, np.zeros(len(self.joint_names)), base)
        R, P = link_placements(self.robot, state.q)[frame.link]
        pose = np.zeros((*np.broadcast_shapes(R.shape[:-2], P.shape[:-1]), 4, 4))
        pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = R, P, 1
        return _filled(state.base.pose @ pose @ frame.placement, state.batch, axes=2)

    def expand(self, q):
        """Positions (..., all joints) of all joints, from those of the independent ones."""
        return self._joints("positions", q) @ self._S.T + self._offset

    def expand_rates(self, rates):
        """Velocities or accelerations (..., all joints) of all joints, from those of the independent ones."""
        return self._joints("rates", rates) @ self._S.T

    def gather_efforts(self, efforts):
        """What efforts (..., all joints) amount to on the independent joints (..., n)."""
        everyone = f"joints ({', '.join(self.all_joint_names)})"
        return finite("efforts", efforts, len(self.all_joint_names), everyone) @ self._S

    def spread_efforts(self, efforts):
        """Efforts (..., all joints) that amount to `efforts` (..., n): nothing on joints that depend on others."""
        efforts = self._joints("efforts", efforts)
        spread = np.zeros((*efforts.shape[:-1], len(self.all_joint_names)))
        spread[..., self._independent] = efforts
        return spread

    def _joints(self, what, values):
        return finite(what, values, len(self.joint_names), f"joints ({', '.join(self.joint_names)})")

    def _state(self, q, qd, base, external_wrenches=None, given=None):
        q, qd = self._joints("positions", q), self._joints("velocities", qd)
        base = base_state(self.robot, base)
        wrenches = link_wrenches(self.robot, external_wrenches)
        batch = common_batch(q, qd, given, base.gravity, base.twist, base.acceleration, *wrenches.values())
        return _State(q @ self._S.T + self._offset, qd @ self._S.T, base, wrenches, batch)

    def _led(self, state, qdd):
        """Forces of all joints, base acceleration and link wrenches, from the accelerations of all joints."""
        sweep = sweep_forward(self.robot, state.q, state.qd, state.base.twist, state.wrenches)
        if state.base.acceleration is not None:
            forces, wrenches = inverse_dynamics(self.robot, sweep, qdd, state.base.acceleration)
            return forces, state.base.acceleration, wrenches
        found = recursion.solve(self.robot, sweep, _columns(qdd), [None] * len(self.robot.joints))
        self._refuse_singular(found)
        return found.forces, found.base_acceleration, found.wrenches

    def _pushed(self, state, forces):
        """Accelerations, base acceleration and link wrenches, from forces: efforts less friction."""
        if len(self.joint_names) < len(self.robot.joints):
            qdd = self._pushed_together(state, forces)
            return qdd, *self._led(state, qdd @ self._S.T)[1:]
        sweep = sweep_forward(self.robot, state.q, state.qd, state.base.twist, state.wrenches)
        accelerations = [None] * len(self.robot.joints)
        found = recursion.solve(self.robot, sweep, accelerations, _columns(forces), state.base.acceleration)
        self._refuse_singular(found)
        return found.accelerations, found.base_acceleration, found.wrenches

    def _pushed_together(self, state, forces):
        """Accelerations of the independent joints of a robot in which some depend on others."""
        base = state.base
        known = np.zeros(6) if base.acceleration is None else base.acceleration
        H = bias(self.robot, state.q, state.qd, base.twist, known, state.wrenches)
        if base.acceleration is not None:
            H = H[..., -len(self.robot.joints) :]
        qdd, pivots, diagonal = coupled_accelerations(self.robot, self._S, state.q, forces, H)
        names = (BASE_ROWS + self.joint_names)[-len(pivots) :]
        for k, name in enumerate(names):
            _refuse_singular(pivots[k], diagonal[..., k], name)
        return qdd

    def _refuse_singular(self, found):
        """Raise SingularModelError where an acceleration of a recursion.Solution owes its value to rounding.

        From the leaves to the base, as the recursion went: the first that fails is the cause of those after it.
        """
        folded = found.folded
        for j in range(len(self.robot.joints), 0, -1):
            if folded.resistances[j] is not None:
                joint = self.robot.joints[j - 1]
                # kg beside kg where the joint moves along its axis, kg m² beside kg m² where it turns about it
                alike = slice(0, 3) if joint.prismatic else slice(3, 6)
                diagonal = np.diagonal(folded.inertias[j][..., alike, alike], axis1=-2, axis2=-1)
                _refuse_singular(folded.resistances[j], diagonal.max(axis=-1, keepdims=True), f"joint {joint.name!r}")
        for k, pivot in enumerate(found.base_pivots):
            _refuse_singular(pivot, folded.inertias[0][..., k, k], BASE_ROWS[k])

    def _bias(self, state, base, twist, acceleration):
        if base is not None and base.acceleration is not None:
            raise QuestionError("the acceleration of the base has no part in this term: leave it out of Base")
        with np.errstate(all="ignore"):
            return _filled(bias(self.robot, state.q, state.qd, twist, acceleration) @ self._projection, state.batch)

    def _in_link_frames(self, wrenches):
        """Wrenches (..., 1 + joints, 6) in frames j, expressed in the link frames that the description gives."""
        moved = [wrench_to_antecedent(R, P, wrenches[..., j, :]) for j, (R, P) in enumerate(self._in_link_frame)]
        return np.stack(moved, axis=-2)


@dataclass(frozen=True, eq=False)
class _State:
    """A question as the recursions take it: q, qd (..., all joints); base: BaseState; wrenches: by link number; batch:
    the shape of the batch axes."""

    q: np.ndarray
    qd: np.ndarray
    base: object
    wrenches: dict
    batch: tuple


def _columns(array):
    """The columns (..., 1) of (..., n) as a list of n."""
    return np.split(array, array.shape[-1], axis=-1) if array.shape[-1] else []


def _filled(array, batch, axes=1):
    """A new array with the whole batch shape in front of the last axes. Refuses what is not finite."""
    filled = np.array(np.broadcast_to(array, (*batch, *array.shape[array.ndim - axes :])))
    if not np.isfinite(filled).all():
        sample = tuple(int(index) for index in np.argwhere(~np.isfinite(filled))[0][: len(batch)])
        _overflow(f" at sample {', '.join(map(str, sample))}" if sample else "")
    return filled


def _overflow(where=""):
    raise QuestionError(f"the answer{where} is no finite number: something that is asked, or the robot, is too large")


def _refuse_singular(pivot, scale, name):
    if np.isnan(pivot).any():
        _overflow()
    if not np.all(pivot > SINGULAR * np.abs(scale)):
        raise SingularModelError(
            f"direct model: nothing with inertia resists {name} (inertia {np.min(pivot):.3g}). "
            "Give the links that it moves a mass and an inertia, or the joint a rotor inertia"
        )
