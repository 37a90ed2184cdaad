"""What runs in the process that compiles an MJCF: the package mujoco, whose model becomes lists of numbers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from lxml import etree

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.mjcf.document import find_file, read_document
from robot_dynamics.model.formats.mjcf.refusals import refuse_what_has_no_equal
from robot_dynamics.optional_packages import import_optional

ARRAYS = (
    *("body_parentid", "body_pos", "body_quat", "body_mass", "body_ipos", "body_iquat", "body_inertia"),
    *("body_jntadr", "body_jntnum", "body_mocapid"),
    *("jnt_type", "jnt_qposadr", "jnt_dofadr", "jnt_axis", "jnt_pos", "jnt_limited", "jnt_range", "jnt_stiffness"),
    *("jnt_actfrclimited", "jnt_actfrcrange"),
    *("dof_armature", "dof_damping", "dof_frictionloss", "qpos0", "qpos_spring"),
    *("actuator_trntype", "actuator_trnid", "actuator_gear", "actuator_forcelimited", "actuator_forcerange"),
    *("actuator_gaintype", "actuator_biastype", "actuator_dyntype", "actuator_gainprm"),
    *("actuator_ctrllimited", "actuator_ctrlrange", "actuator_armature", "actuator_damping"),
    *("eq_type", "eq_objtype", "eq_obj1id", "eq_obj2id", "eq_data", "eq_active0"),
    *("geom_type", "geom_bodyid", "geom_group", "geom_pos", "geom_quat", "geom_size", "geom_rgba"),
    *("site_bodyid", "site_pos", "site_quat", "tendon_adr", "tendon_num", "wrap_type", "wrap_objid"),
)
"""Arrays of an MjModel that describe the robot. Older versions of MuJoCo lack some: they have no such property."""

ENUMERATIONS = {
    "geom_type": "mjtGeom",
    "jnt_type": "mjtJoint",
    "eq_type": "mjtEq",
    "eq_objtype": "mjtObj",
    "actuator_trntype": "mjtTrn",
    "actuator_gaintype": "mjtGain",
    "actuator_biastype": "mjtBias",
    "actuator_dyntype": "mjtDyn",
    "wrap_type": "mjtWrap",
}
"""Arrays whose numbers are members of an enumeration: their names are passed on, versions differ in the numbers."""


def run(request: dict[str, Any]) -> dict[str, Any]:
    """Return the model of request["text"], which a file in request["folder"] (or null) has, as lists by name."""
    mujoco = import_optional("mujoco", "reading an MJCF")
    folder = None if request["folder"] is None else Path(request["folder"])
    root = read_document(request["text"], folder, request["source"])
    try:
        spec = mujoco.MjSpec.from_string(etree.tostring(root, encoding="unicode"))
        assets = _prepare(mujoco, spec, folder)
        spec.assets = assets
        model = spec.compile()
    except (DescriptionError, MemoryError):
        raise
    except Exception as error:  # mujoco raises ValueError, FatalError and others
        reason = re.sub(r", line \d+", "", " ".join(str(error).split()))  # the lines are those of the changed text
        raise DescriptionError(f"MuJoCo cannot compile it: {reason[:500]}") from error
    refuse_what_has_no_equal(mujoco, model)
    return _to_lists(mujoco, model, spec.modelname)


def _prepare(mujoco: Any, spec: Any, folder: Path | None) -> dict[str, bytes]:
    """Delete shapes that no inertia is computed from, and return the files that the others need, by name."""
    kinds = mujoco.mjtGeom
    from_shapes = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    spec.compiler.fusestatic = False  # all bodies remain as frames
    for geom in list(spec.geoms):
        is_mesh = geom.type in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF)
        is_unused = geom.parent.name == "world" or (geom.parent.explicitinertial and not from_shapes)
        if geom.type == kinds.mjGEOM_HFIELD or (is_mesh and is_unused):  # a height field has no inertia
            spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms}
    assets = {}
    for mesh in list(spec.meshes):
        if mesh.name not in used and Path(mesh.file).stem not in used:
            spec.delete(mesh)
        elif mesh.file:
            folders = (folder / spec.meshdir, folder) if folder is not None else (None,)
            assets[mesh.file] = find_file(mesh.file, folders, folder).read_bytes()
    for hfield in list(spec.hfields):
        spec.delete(hfield)
    if assets:
        spec.meshdir = ""
    return assets


def _to_lists(mujoco: Any, model: Any, name: str) -> dict[str, Any]:
    """Return the numbers and names of a model that describe the robot."""
    flags = mujoco.mjtDisableBit
    disabled = {flag.name for flag in (getattr(flags, key) for key in flags.__members__) if _is_set(model, flag)}
    kinds = {"body": model.nbody, "joint": model.njnt, "actuator": model.nu, "equality": model.neq}
    names = {
        kind: [mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), number) for number in range(n)]
        for kind, n in kinds.items()
    }
    members = {
        array: [getattr(mujoco, kind)(value).name for value in getattr(model, array)]
        for array, kind in ENUMERATIONS.items()
    }
    return {
        "name": name,
        "names": names,
        "gravity": model.opt.gravity.tolist(),
        "disabled": sorted(disabled),
        **{array: getattr(model, array).tolist() for array in ARRAYS if hasattr(model, array)},
        **members,
    }


def _is_set(model: Any, flag: Any) -> bool:
    """Return whether a flag that disables something is set."""
    return flag.name.startswith("mjDSBL") and bool(model.opt.disableflags & flag.value)
