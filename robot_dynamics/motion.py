"""Motion from forces and forces from motion: which recursion a question takes."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_dynamics.answer import BASE_ROWS, filled, refuse_singular
from robot_dynamics.newton_euler import recursion
from robot_dynamics.newton_euler.coupling import coupled_accelerations
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import sweep_forward
from robot_dynamics.newton_euler.walker_orin import bias


@dataclass(frozen=True, eq=False)
class State:
    """A question as the recursions take it.

    configuration: the Configuration; qd: (..., all joints); base: BaseState; wrenches: by link number; batch: the shape
    of the batch axes; names: of the independent joints.
    """

    configuration: object
    qd: np.ndarray
    base: object
    wrenches: dict
    batch: tuple
    names: tuple

    @property
    def q(self):
        """(..., all joints)."""
        return self.configuration.q

    @property
    def robot(self):
        """The Robot as the recursions take it, with positions `local`."""
        return self.configuration.robot

    @property
    def local(self):
        """Positions (..., all joints) that go with `robot`, `qd` and what `everyone` gives."""
        return self.configuration.local

    def motion(self, everyone):
        """(positions, velocities, accelerations) (..., all joints) of the joints, from accelerations that `everyone`
        gives."""
        q, rates, accelerations = (filled(values, self.batch) for values in (self.q, self.qd, everyone))
        accelerations = self.configuration.joint_accelerations(rates, accelerations)
        return q, self.configuration.joint_velocities(rates), accelerations

    @cached_property
    def drift(self):
        """Accelerations (..., all joints) where the independent ones are not accelerated."""
        return self.configuration.drift(self.qd)

    @property
    def depends(self):
        """Whether some joints depend on others."""
        return len(self.names) < self.q.shape[-1]

    def everyone(self, qdd):
        """Accelerations (..., all joints) from those (..., n) of the independent ones."""
        return self.configuration.rates(qdd) + self.drift


def moved(state, unknown, accelerations, forces):
    """(accelerations (..., n), forces (..., all joints), base acceleration, link wrenches).

    unknown: numbers of the independent joints whose acceleration is unknown; accelerations: (..., n), those that are
    known; forces: (..., n) where accelerations are unknown, less friction and springs.
    """
    robot, base = state.robot, state.base
    if state.depends and len(unknown):
        accelerations, unknown = _moved_together(state, unknown, accelerations, forces), ()
    sweep = sweep_forward(robot, state.local, state.qd, base.twist, state.wrenches)
    everyone = state.everyone(accelerations)
    if not len(unknown) and base.acceleration is not None:
        forces, wrenches = inverse_dynamics(robot, sweep, everyone, base.acceleration)
        return accelerations, forces, base.acceleration, wrenches
    known, pushed = ([array[..., number : number + 1] if (number in unknown) is asked else None
                      for number in range(len(robot.joints))]
                     for array, asked in ((everyone, False), (forces, True)))  # fmt: skip
    found = recursion.solve(robot, sweep, known, pushed, base.acceleration)
    _refuse_singular(robot, found)
    found_accelerations = accelerations if state.depends else found.accelerations
    return found_accelerations, found.forces, found.base_acceleration, found.wrenches


def _moved_together(state, unknown, accelerations, forces):
    """Accelerations of the independent joints of a robot in which some depend on others, as for `moved`."""
    robot, base, G = state.robot, state.base, state.configuration.G
    known = np.zeros(6) if base.acceleration is None else base.acceleration
    H = bias(robot, state.local, state.qd, base.twist, known, state.wrenches, state.drift)
    if base.acceleration is not None:
        H = H[..., -len(robot.joints) :]
    found, pivots, diagonal = coupled_accelerations(robot, G, state.local, unknown, accelerations, forces, H)
    names = tuple(state.names[number] for number in reversed(unknown)) + BASE_ROWS
    for pivot, k, name in zip(pivots, range(len(pivots)), names, strict=False):
        refuse_singular(pivot, diagonal[..., k], name)
    return found[..., -G.shape[-1] :]


def with_loops_closed(state, everyone, base_acceleration, demands):
    """Link wrenches (..., 1 + joints, 6) of a motion with what the ends of the loops exert on each other.

    everyone: accelerations (..., all joints); base_acceleration: (..., 6), gravity taken off; demands: (..., all
    joints), what the tree asks of its joints for this motion, friction and springs counted: what it asks of those that
    the loops place, the loops exert.
    """
    wrenches = dict(state.wrenches)
    for link, wrench in state.configuration.loop_wrenches(demands):
        wrenches[link] = wrenches.get(link, 0) - wrench
    sweep = sweep_forward(state.robot, state.local, state.qd, state.base.twist, wrenches)
    return inverse_dynamics(state.robot, sweep, everyone, base_acceleration)[1]


def _refuse_singular(robot, found):
    """Raise SingularModelError where an acceleration of a recursion.Solution owes its value to rounding.

    From the leaves to the base, as the recursion went: the first that fails is the cause of those after it.
    """
    folded = found.folded
    for j in range(len(robot.joints), 0, -1):
        if folded.resistances[j] is not None:
            joint = robot.joints[j - 1]
            # kg beside kg where the joint moves along its axis, kg m² beside kg m² where it turns about it
            alike = slice(0, 3) if joint.prismatic else slice(3, 6)
            diagonal = np.diagonal(folded.inertias[j][..., alike, alike], axis1=-2, axis2=-1)
            refuse_singular(folded.resistances[j], diagonal.max(axis=-1, keepdims=True), f"joint {joint.name!r}")
    for k, pivot in enumerate(found.base_pivots):
        refuse_singular(pivot, folded.inertias[0][..., k, k], BASE_ROWS[k])
