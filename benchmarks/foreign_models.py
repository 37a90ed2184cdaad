"""Count which MJCF files of a folder load, and compare their inverse dynamics with that of MuJoCo.

    python benchmarks/foreign_models.py FOLDER

A model counts if MuJoCo compiles it and it has joints. Contacts, joint limits and dry friction are off in MuJoCo, and
all joints have motors here, but for those of closed loops: these have the motors of the file.
"""

import re
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from tabulate import tabulate

from robot_dynamics import Base, Dynamics, load_robot
from robot_dynamics.errors import RobotDynamicsError

DIGITS = 1e-9
"""Largest difference that counts as equal, relative to the largest effort (at least 1 N m or N)."""


def comparable(robot):
    """Return a robot without dry friction, with motors at all joints outside loops."""
    joints = [
        replace(joint, coulomb_friction=0.0, actuated=joint.actuated or number not in robot.joints_in_loops)
        for number, joint in enumerate(robot.joints)
    ]
    return replace(robot, joints=tuple(joints))


def inverse_difference(model, robot, seed=0):
    """Return the relative difference of the inverse dynamics of an MjModel and of its Robot in a random state.

    The efforts differ by those that the equality constraints of MuJoCo take: these are projected out by the null space
    of their Jacobian.
    """
    rng = np.random.default_rng(seed)
    robot = comparable(robot)
    dynamics = Dynamics(robot, compiled=False)
    independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
    spread = 0.1 if robot.loops else 1.0
    q = dynamics.initial_joint_positions[independent] + rng.uniform(-spread, spread, len(independent))
    base = None
    if robot.moving_base:
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        pose = np.eye(4)
        pose[:3, :3] = rotation * np.sign(np.linalg.det(rotation))
        pose[:3, 3] = rng.normal(size=3)
        base = Base(pose, rng.normal(size=6), rng.normal(size=6))
    v, a = rng.normal(size=(2, len(independent)))
    a[[robot.joints[number].role == "elastic" for number in independent]] = 0.0  # no motor: it is part of the result
    result = dynamics.solve(q, v, qdd=a, base=base)
    motion = result.motion
    efforts = dynamics.embed_efforts(result.efforts)
    mujoco_efforts, constraint = mujoco_inverse(model, motion, base)
    if base is not None:
        wrench = result.reactions[0]
        efforts = np.concatenate([pose[:3, :3] @ wrench[:3], wrench[3:], efforts])
    null = null_space(constraint, len(efforts))
    difference = null.T @ (mujoco_efforts - efforts)
    return float(np.abs(difference).max(initial=0) / max(1.0, np.abs(mujoco_efforts).max(initial=0)))


def null_space(matrix, size):
    """Return an orthonormal basis (size, k) of the null space of a matrix (rows, size)."""
    if not len(matrix):
        return np.eye(size)
    _, values, rows = np.linalg.svd(matrix)
    return rows[int(np.sum(values > 1e-9 * max(values.max(), 1e-12))) :].T


def mujoco_inverse(model, motion, base):
    """Return the generalized forces of a motion without constraints, and the Jacobian of the equality constraints."""
    flags = mujoco.mjtDisableBit
    model.opt.enableflags = 0
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    original = model.opt.disableflags
    model.opt.disableflags = original | flags.mjDSBL_CONTACT | flags.mjDSBL_LIMIT | flags.mjDSBL_FRICTIONLOSS
    data = mujoco.MjData(model)
    qpos, qvel, qacc = motion
    if base is not None:
        pose, rotation = np.asarray(base.pose), np.asarray(base.pose)[:3, :3]
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, rotation.ravel())
        qpos = np.concatenate([pose[:3, 3], quaternion, qpos])
        qvel, qacc = (
            np.concatenate([rotation @ np.asarray(vector)[:3], np.asarray(vector)[3:], joints])
            for vector, joints in ((base.twist, qvel), (base.acceleration, qacc))
        )
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(model, data)
    rows = data.ne
    constraint = np.array(data.efc_J).reshape(-1, model.nv)[:rows] if rows else np.zeros((0, model.nv))
    residual = np.abs(data.efc_pos[:rows]).max(initial=0)
    if residual > 1e-8:
        raise AssertionError(f"constraints of MuJoCo differ by {residual:.1e}")
    model.opt.disableflags |= flags.mjDSBL_CONSTRAINT
    data.qacc[:] = qacc
    mujoco.mj_inverse(model, data)
    model.opt.disableflags = original
    return np.array(data.qfrc_inverse), constraint


def examine(path):
    """Return (kind, detail) of a file: kind is 'equal', 'different', 'refused', 'no solution', or None: no model."""
    try:
        if "<mujoco" not in path.read_text(errors="ignore"):
            return None
        model = mujoco.MjModel.from_xml_path(str(path))
    except Exception:
        return None
    if not model.njnt:
        return None
    try:
        robot = load_robot(path)
    except RobotDynamicsError as error:
        return "refused", str(error).removeprefix(f"{path}: ")
    try:
        difference = inverse_difference(model, robot)
    except RobotDynamicsError as error:
        return "no solution", str(error)
    except AssertionError as error:
        return "different", str(error)
    return ("equal" if difference < DIGITS else "different"), f"{difference:.1e}"


def reason(detail):
    """Return a message without names and numbers: messages of one cause become equal."""
    return re.sub(r"'[^']*'(, '[^']*')*|\b\d[\d.e-]*", "*", detail)[:110]


def main(folder):
    """Print the table, and each file that is not equal."""
    outcomes = {}
    for path in sorted(Path(folder).rglob("*.xml")):
        outcome = examine(path)
        if outcome is not None:
            outcomes[path] = outcome
    for path, (kind, detail) in outcomes.items():
        if kind != "equal":
            print(f"{path.relative_to(folder)}: {kind}: {detail[:160]}")
    counts = Counter((kind, reason(detail) if kind != "equal" else "") for kind, detail in outcomes.values())
    rows = sorted(((kind, cause, count) for (kind, cause), count in counts.items()), key=lambda row: -row[2])
    print(tabulate(rows, headers=("outcome", "reason", "models")))
    largest = max((float(detail) for kind, detail in outcomes.values() if kind == "equal"), default=0.0)
    print(f"{len(outcomes)} models; largest difference of those that are equal: {largest:.1e}")


if __name__ == "__main__":
    main(sys.argv[1])
