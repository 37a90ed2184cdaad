"""The regressor: joint efforts are linear in the inertial parameters, Γ = Y θ.

The parameters of a link are XX, XY, XZ, YY, YZ, ZZ, MX, MY, MZ, M, all about the origin of its frame, then Ia, Fv, Fs
of its joint; link 0 has the first ten where the base moves. Column by column, the wrench that a link with this
parameter 1 and the others 0 demands is handed down to the base.
"""

import numpy as np

from robot_dynamics.model.inertia import INERTIA_ENTRIES, symmetric_entries
from robot_dynamics.newton_euler.augmented import link_motions, rotational_moment
from robot_dynamics.newton_euler.friction import signs
from robot_dynamics.newton_euler.kinematics import axis_row
from robot_dynamics.newton_euler.screw import apply, cross, screw

LINK_PARAMETERS = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
JOINT_PARAMETERS = ("Ia", "Fv", "Fs")


def parameter_names(robot):
    """Names of the columns: `XX.link`, ... `M.link`, `Ia.joint`, `Fv.joint`, `Fs.joint`, link by link."""
    names = [f"{key}.{robot.base_link}" for key in LINK_PARAMETERS] if robot.moving_base else []
    for joint, link in zip(robot.joints, robot.links[1:], strict=True):
        names += [f"{key}.{link.name}" for key in LINK_PARAMETERS] + [f"{key}.{joint.name}" for key in JOINT_PARAMETERS]
    return tuple(names)


def parameters(robot):
    """θ (p,): what the columns of `parameter_names` are of this robot."""
    values = []
    for number, link in enumerate(robot.links):
        if number > 0 or robot.moving_base:
            inertia = link.inertia
            values += [*symmetric_entries(inertia.second_moments), *inertia.first_moments, inertia.mass]
        if number > 0:
            joint = robot.joints[number - 1]
            values += [joint.rotor_inertia, joint.viscous_friction, joint.coulomb_friction]
    return np.array(values)


def regressor(robot, q, qd, qdd, base_twist, base_acceleration, links=None):
    """Y (..., m, p): m = n joints, or 6 + n rows with a moving base, whose wrench comes first.

    q, qd, qdd: (..., n); base_twist: 0V0 and base_acceleration: 0V̇0 (..., 6), gravity taken off, in frame 0; links:
    numbers of those of which the columns are computed, with those of their joints, if not all.
    """
    motions = link_motions(robot, q, qd, qdd, base_twist, base_acceleration)
    base, joints = (6 if robot.moving_base else 0), len(robot.joints)
    zero = 0 * (q[..., 0] if joints else base_acceleration[..., 0])
    columns = []
    for number, motion in enumerate(motions):
        if links is not None and number not in links:
            continue
        if number > 0 or robot.moving_base:
            for wrench in _unit_wrenches(motion):
                columns.append(_rows(robot, motions, number, wrench, base, zero))
        if number > 0:
            row, rate = base + number - 1, qd[..., number - 1]
            for entry in (qdd[..., number - 1], rate, signs(rate)):
                column = [zero] * (base + joints)
                column[row] = entry
                columns.append(column)
    if not columns:
        return np.zeros((base + joints, 0))
    stacked = [np.stack(np.broadcast_arrays(*column), axis=-1) for column in columns]
    return np.stack(np.broadcast_arrays(*stacked), axis=-1)


def _unit_wrenches(motion):
    """What a link that moves like this demands for each of BODY (..., 6), in its frame."""
    nothing = 0 * motion.alpha
    for row, column in INERTIA_ENTRIES.values():
        K = np.zeros((3, 3), dtype=int)
        K[row, column] = K[column, row] = 1
        yield screw(nothing, rotational_moment(K, motion))
    for axis in np.eye(3, dtype=int):
        yield screw(motion.times(axis), cross(axis + nothing, motion.alpha))
    yield screw(motion.alpha, nothing)


def _rows(robot, motions, number, wrench, base, zero):
    """What a wrench on link `number` is in the rows of the base and of the joints that carry it."""
    rows = [zero] * (base + len(robot.joints))
    while number > 0:
        joint, motion = robot.joints[number - 1], motions[number]
        rows[base + number - 1] = wrench[..., axis_row(joint)]
        force = apply(motion.R, wrench[..., :3])
        wrench = screw(force, apply(motion.R, wrench[..., 3:]) + cross(motion.P, force))
        number = joint.antecedent
    rows[:base] = [wrench[..., row] for row in range(base)]
    return rows
