"""Motion from forces and forces from motion: which recursion a question takes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_dynamics.array_checks import broadcast_result, refuse_overflow
from robot_dynamics.constraints.topology import solve_constrained_accelerations
from robot_dynamics.errors import SingularModelError
from robot_dynamics.newton_euler import articulated_body
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import run_forward_pass
from robot_dynamics.newton_euler.linear import MIN_INERTIA_RATIO
from robot_dynamics.newton_euler.screw import BASE_ROWS
from robot_dynamics.newton_euler.walker_orin import bias


@dataclass(frozen=True, eq=False)
class RobotState:
    """A question as the recursions take it.

    configuration: the Configuration; qd: (..., all joints); base: BaseState; wrenches: by link number; batch: the shape
    of the batch axes; names: of the independent joints.
    """

    constrained_state: object
    qd: np.ndarray
    base: object
    wrenches: dict
    batch: tuple
    joint_names: tuple

    @property
    def q(self):
        """(..., all joints)."""
        return self.constrained_state.q

    @property
    def robot(self):
        """The Robot as the recursions take it, with positions `local`."""
        return self.constrained_state.robot

    @property
    def chart_q(self):
        """Positions (..., all joints) that go with `robot`, `qd` and what `everyone` gives."""
        return self.constrained_state.chart_q

    def joint_motion(self, everyone):
        """(positions, velocities, accelerations) (..., all joints) of the joints, from accelerations that `everyone`
        gives."""
        q, rates, accelerations = (broadcast_result(values, self.batch) for values in (self.q, self.qd, everyone))
        accelerations = self.constrained_state.joint_accelerations(rates, accelerations)
        return q, self.constrained_state.joint_velocities(rates), accelerations

    @cached_property
    def drift(self):
        """Accelerations (..., all joints) where the independent ones are not accelerated."""
        return self.constrained_state.drift(self.qd)

    @property
    def has_dependent_joints(self):
        """Whether some joints depend on others."""
        return len(self.joint_names) < self.q.shape[-1]

    def expand_accelerations(self, qdd):
        """Accelerations (..., all joints) from those (..., n) of the independent ones."""
        return self.constrained_state.expand_rates(qdd) + self.drift


def solve_mixed_dynamics(state, unknown, accelerations, forces):
    """(accelerations (..., n), forces (..., all joints), base acceleration, link wrenches).

    unknown: numbers of the independent joints whose acceleration is unknown; accelerations: (..., n), those that are
    known; forces: (..., n) where accelerations are unknown, less friction and springs.
    """
    robot, base = state.robot, state.base
    if state.has_dependent_joints and len(unknown):
        accelerations, unknown = _moved_together(state, unknown, accelerations, forces), ()
    sweep = run_forward_pass(robot, state.chart_q, state.qd, base.twist, state.wrenches)
    everyone = state.expand_accelerations(accelerations)
    if not len(unknown) and base.acceleration is not None:
        forces, wrenches = inverse_dynamics(robot, sweep, everyone, base.acceleration)
        return accelerations, forces, base.acceleration, wrenches
    known, pushed = ([array[..., number : number + 1] if (number in unknown) is asked else None
                      for number in range(len(robot.joints))]
                     for array, asked in ((everyone, False), (forces, True)))  # fmt: skip
    found = articulated_body.solve(robot, sweep, known, pushed, base.acceleration)
    _refuse_singular(robot, found)
    found_accelerations = accelerations if state.has_dependent_joints else found.accelerations
    return found_accelerations, found.forces, found.base_acceleration, found.wrenches


def _moved_together(state, unknown, accelerations, forces):
    """Accelerations of the independent joints of a robot in which some depend on others, as for `moved`."""
    robot, base, G = state.robot, state.base, state.constrained_state.G
    known = np.zeros(6) if base.acceleration is None else base.acceleration
    H = bias(robot, state.chart_q, state.qd, base.twist, known, state.wrenches, state.drift)
    if base.acceleration is not None:
        H = H[..., -len(robot.joints) :]
    found, pivots, diagonal = solve_constrained_accelerations(
        robot, G, state.chart_q, unknown, accelerations, forces, H
    )
    names = tuple(state.joint_names[number] for number in reversed(unknown)) + BASE_ROWS
    for pivot, k, name in zip(pivots, range(len(pivots)), names, strict=False):
        refuse_singular(pivot, diagonal[..., k], name)
    return found[..., -G.shape[-1] :]


def compute_link_wrenches(state, everyone, base_acceleration, tree_efforts):
    """Link wrenches (..., 1 + joints, 6) of a motion with what the ends of the loops exert on each other.

    everyone: accelerations (..., all joints); base_acceleration: (..., 6), gravity taken off; demands: (..., all
    joints), what the tree asks of its joints for this motion, friction and springs counted: what it asks of those that
    the loops place, the loops exert.
    """
    wrenches = dict(state.wrenches)
    for link, wrench in state.constrained_state.loop_wrenches(tree_efforts):
        wrenches[link] = wrenches.get(link, 0) - wrench
    sweep = run_forward_pass(state.robot, state.chart_q, state.qd, state.base.twist, wrenches)
    return inverse_dynamics(state.robot, sweep, everyone, base_acceleration)[1]


def _refuse_singular(robot, found):
    """Raise SingularModelError where an acceleration of a recursion.Solution owes its value to rounding.

    From the leaves to the base, as the recursion went: the first that fails is the cause of those after it.
    """
    backward_pass = found.backward_pass
    for j in range(len(robot.joints), 0, -1):
        if backward_pass.apparent_inertias[j] is not None:
            joint = robot.joints[j - 1]
            # kg beside kg where the joint moves along its axis, kg m² beside kg m² where it turns about it
            alike = slice(0, 3) if joint.prismatic else slice(3, 6)
            diagonal = np.diagonal(backward_pass.articulated_inertias[j][..., alike, alike], axis1=-2, axis2=-1)
            refuse_singular(
                backward_pass.apparent_inertias[j], diagonal.max(axis=-1, keepdims=True), f"joint {joint.name!r}"
            )
    for k, pivot in enumerate(found.base_pivots):
        refuse_singular(pivot, backward_pass.articulated_inertias[0][..., k, k], BASE_ROWS[k])


def refuse_singular(pivot, scale, name):
    if np.isnan(pivot).any():
        refuse_overflow()
    if not np.all(pivot > MIN_INERTIA_RATIO * np.abs(scale)):
        raise SingularModelError(
            f"nothing with inertia resists {name} (inertia {np.min(pivot):.3g}). "
            "Give the links that it moves a mass and an inertia, or the joint a rotor inertia"
        )
