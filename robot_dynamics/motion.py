"""Motion from forces and forces from motion: which recursion a question takes."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.answer import BASE_ROWS, refuse_singular
from robot_dynamics.newton_euler import recursion
from robot_dynamics.newton_euler.coupling import coupled_accelerations
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import sweep_forward
from robot_dynamics.newton_euler.walker_orin import bias


@dataclass(frozen=True, eq=False)
class State:
    """A question as the recursions take it: q, qd (..., all joints); base: BaseState; wrenches: by link number; batch:
    the shape of the batch axes."""

    q: np.ndarray
    qd: np.ndarray
    base: object
    wrenches: dict
    batch: tuple


def moved(robot, S, state, unknown, accelerations, forces):
    """(accelerations (..., n), forces (..., all joints), base acceleration, link wrenches).

    S: (all joints, n) from independent joints to all; state: State; unknown: numbers of the independent joints whose
    acceleration is unknown; accelerations: (..., n), those that are known; forces: (..., n) where accelerations are
    unknown, less friction and springs.
    """
    base, depends = state.base, S.shape[1] < S.shape[0]
    if depends and len(unknown):
        accelerations, unknown = _moved_together(robot, S, state, unknown, accelerations, forces), ()
    sweep = sweep_forward(robot, state.q, state.qd, base.twist, state.wrenches)
    everyone = accelerations @ S.T
    if not len(unknown) and base.acceleration is not None:
        forces, wrenches = inverse_dynamics(robot, sweep, everyone, base.acceleration)
        return accelerations, forces, base.acceleration, wrenches
    known = [None if number in unknown else column for number, column in enumerate(_columns(everyone))]
    pushed = [column if number in unknown else None for number, column in enumerate(_columns(forces @ S.T))]
    found = recursion.solve(robot, sweep, known, pushed, base.acceleration)
    _refuse_singular(robot, found)
    found_accelerations = accelerations if depends else found.accelerations
    return found_accelerations, found.forces, found.base_acceleration, found.wrenches


def _moved_together(robot, S, state, unknown, accelerations, forces):
    """Accelerations of the independent joints of a robot in which some depend on others, as for `moved`."""
    base = state.base
    known = np.zeros(6) if base.acceleration is None else base.acceleration
    H = bias(robot, state.q, state.qd, base.twist, known, state.wrenches)
    if base.acceleration is not None:
        H = H[..., -len(robot.joints) :]
    found, pivots, diagonal = coupled_accelerations(robot, S, state.q, unknown, accelerations, forces, H)
    independent = [joint.name for joint in robot.joints if joint.mimic is None]
    names = tuple(independent[number] for number in reversed(unknown)) + BASE_ROWS
    for pivot, k, name in zip(pivots, range(len(pivots)), names, strict=False):
        refuse_singular(pivot, diagonal[..., k], name)
    return found[..., -S.shape[1] :]


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


def _columns(array):
    """The columns (..., 1) of (..., n) as a list of n."""
    return np.split(array, array.shape[-1], axis=-1) if array.shape[-1] else []
