"""What changes the dynamics of a model of MuJoCo and has no equal here: it is refused by name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.errors import DescriptionError

if TYPE_CHECKING:
    from collections.abc import Sequence

BODY_FORCES = {"body_gravcomp": "gravcomp, a force against gravity"}
JOINT_FORCES = {"jnt_stiffnesspoly": "a spring that is not linear", "jnt_springyield": "a spring that yields"}
DOF_FORCES = {"dof_dampingpoly": "damping that is not linear"}
TENDON_FORCES = {
    "tendon_stiffness": "stiffness",
    "tendon_stiffnesspoly": "stiffness",
    "tendon_damping": "damping",
    "tendon_dampingpoly": "damping",
    "tendon_frictionloss": "frictionloss",
    "tendon_armature": "armature",
}


def refuse_what_has_no_equal(mujoco: Any, model: Any) -> None:
    """Raise DescriptionError where an MjModel has a part that changes the dynamics, but no Robot can have it."""
    objects = mujoco.mjtObj

    def refuse(kind: str, number: int, message: str) -> None:
        name = mujoco.mj_id2name(model, getattr(objects, f"mjOBJ_{kind.upper()}"), number)
        raise DescriptionError(f"{kind} {name or number!r} {message}")

    if model.nflex:
        refuse("flex", 0, "is a soft body: only rigid bodies are read")
    if model.nplugin:
        raise DescriptionError("it has plugins, whose forces are not known: remove them")
    if model.opt.density or model.opt.viscosity or np.any(model.opt.wind):
        raise DescriptionError("option has a fluid (density, viscosity or wind): set them to 0, no model here has drag")
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_BALL):
        refuse("joint", int(joint), "is a ball joint: write three hinges with their axes through its centre")
    for kind, fields in (("body", BODY_FORCES), ("joint", JOINT_FORCES), ("tendon", TENDON_FORCES)):
        for field, force in fields.items():
            for number in _nonzero(model, field):
                refuse(kind, number, f"has {force}: no model here has it. Remove it")
    for field, force in DOF_FORCES.items():
        for number in _nonzero(model, field):
            refuse("joint", int(model.dof_jntid[number]), f"has {force}: no model here has it. Remove it")
    _refuse_free_joint_forces(mujoco, model, refuse)
    _refuse_actuators(mujoco, model, refuse)


def _nonzero(model: Any, field: str) -> Sequence[int]:
    """Return the numbers of the rows of an array that are not zero; none where MuJoCo is too old to have it."""
    values = np.asarray(getattr(model, field, np.zeros(0)))
    return [int(row) for row in np.flatnonzero(values.reshape(len(values), -1).any(axis=1))] if len(values) else []


def _refuse_free_joint_forces(mujoco: Any, model: Any, refuse: Any) -> None:
    """Refuse springs, friction and armature of a free joint."""
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        first = model.jnt_dofadr[joint]
        for field in ("dof_damping", "dof_frictionloss", "dof_armature"):
            if np.any(getattr(model, field)[first : first + 6]):
                refuse("joint", int(joint), f"is free and has {field.removeprefix('dof_')}: a base has none. Remove it")
        if model.jnt_stiffness[joint]:
            refuse("joint", int(joint), "is free and has stiffness: a base has none. Remove it")


def _refuse_actuators(mujoco: Any, model: Any, refuse: Any) -> None:
    """Refuse inertia and damping of actuators that do not act on a joint alone."""
    for number in range(model.nu):
        if model.actuator_trntype[number] not in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            for field in ("actuator_armature", "actuator_damping"):
                if number in _nonzero(model, field):
                    refuse("actuator", number, f"has {field[9:]} and acts on no joint: no model here has it. Remove it")
    for number in _nonzero(model, "actuator_dampingpoly"):
        refuse("actuator", number, "has damping that is not linear: no model here has it. Remove it")
