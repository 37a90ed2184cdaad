"""MJCF to Robot: bodies with joints become links of the tree, others are lumped into them and remain as frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.isolated_call import call_isolated
from robot_dynamics.model.formats.mjcf.actuators import actuated_joints, added_to_joint, effort_limit
from robot_dynamics.model.formats.mjcf.equalities import active_equalities, read_loops, read_mimics
from robot_dynamics.model.formats.mjcf.geoms import read_geoms
from robot_dynamics.model.formats.urdf.document import decode_urdf
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint, Limits, Spring
from robot_dynamics.model.mdh import joint_displacement
from robot_dynamics.model.placement import (
    invert_placement,
    placement,
    rotation_from_quaternion,
    rotation_with_z_along,
)
from robot_dynamics.model.robot import Frame, Link, Robot, to_gravity_vector

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike

PROCESS = "robot_dynamics.model.formats.mjcf.mjcf_process"


def read_mjcf(
    text: str | bytes,
    *,
    source: str | Path = "MJCF",
    moving_base: bool | None = None,
    gravity: ArrayLike | None = None,
) -> Robot:
    """Read a robot from the text of an MJCF.

    MuJoCo compiles the model in a process of its own. Joint variables keep MuJoCo's sign and zero. Meshes, contacts
    and sensors are left out.

    Parameters
    ----------
    text : str or bytes
        The MJCF.
    source : str or Path
        Name of the description in error messages; the Path of its file, if it has one: included files, and meshes of
        bodies without <inertial>, are read if they are inside its folder.
    moving_base : bool, optional
        Whether the base can move freely. Default: True where a body has a free joint. That body is then the base.
    gravity : (3,) array_like, optional
        Acceleration of gravity in the world frame [m/s²]. Default: from the description.

    Raises
    ------
    DescriptionError
        If MuJoCo cannot compile the text, or it has a part that changes the dynamics and that no Robot can have.
    MissingPackageError
        If mujoco is not installed.
    """
    folder = str(source.absolute().parent) if isinstance(source, Path) else None
    decoded = decode_urdf(text, source)
    request = {"text": decoded, "folder": folder, "source": str(source)}
    model = call_isolated(PROCESS, request, source, "MuJoCo", writes_files=True)
    if gravity is None:
        gravity = np.zeros(3) if "mjDSBL_GRAVITY" in model["disabled"] else model["gravity"]
    try:
        return _Builder(model).build(moving_base, gravity)
    except DescriptionError as error:
        raise DescriptionError(f"{source}: {error}") from None


class _Body(NamedTuple):
    """Where a body is: the number of its link, and its placement (4, 4) there."""

    link: int
    placement: Array


class _Builder:
    """Walks the bodies of a compiled model, whose parents come before their children."""

    def __init__(self, model: dict[str, Any]) -> None:
        self._model = model
        self._equalities, self._inactive = active_equalities(model)
        self._body_names = _complete_names(model["names"]["body"], "body", {0: "world"})
        self._joint_names = _complete_names(model["names"]["joint"], "joint", {})
        self._mimics = read_mimics(model, self._equalities, self._joint_names)
        self._actuated = actuated_joints(model)
        self._links: list[Link] = []
        self._joints: list[Joint] = []
        self._frames: list[Frame] = []
        self._bodies: dict[int, _Body] = {}

    def build(self, moving_base: bool | None, gravity: ArrayLike) -> Robot:
        """Return the Robot."""
        base = self._find_base()
        is_free = base > 0
        self._links.append(Link(self._body_names[base], Inertia()))
        self._add_body(base, _Body(0, np.eye(4)))
        for body, parent in enumerate(self._model["body_parentid"]):
            if body != base and parent in self._bodies and body > 0:
                self._walk(body, self._bodies[parent])
        loops = read_loops(self._model, self._equalities, self._bodies)
        robot = Robot(
            name=self._model["name"],
            links=tuple(self._links),
            joints=tuple(self._joints),
            frames=tuple(self._frames),
            moving_base=is_free if moving_base is None else moving_base,
            gravity=to_gravity_vector(gravity),
            loops=loops,
            visuals=tuple(
                visual
                for visual in read_geoms(self._model, self._body_names)
                if visual.frame in {frame.name for frame in self._frames}
            ),
        )
        warnings = [f"equality {name!r} is ignored: it is not active" for name in self._inactive]
        return replace(robot, reader_warnings=tuple(warnings))

    def _find_base(self) -> int:
        """Return the number of the body that is the base: the world, or the only body with a free joint."""
        model = self._model
        if "mjJNT_FREE" not in model["jnt_type"]:
            return 0
        bodies = [body for body, count in enumerate(model["body_jntnum"]) if count]
        roots = {self._root(body) for body in bodies}
        if len(roots) > 1:
            names = ", ".join(repr(self._body_names[root]) for root in sorted(roots)[:5])
            self._fail(f"bodies {names} move independently, one of them freely: one robot is needed. Remove the others")
        return roots.pop()

    def _root(self, body: int) -> int:
        """Return the first body with joints on the path from the world to a body."""
        path = []
        while body:
            path.append(body)
            body = self._model["body_parentid"][body]
        return next(body for body in reversed(path) if self._model["body_jntnum"][body])

    def _fail(self, message: str) -> NoReturn:
        raise DescriptionError(message)

    def _walk(self, body: int, parent: _Body) -> None:
        """Add a body, and a link for each of its joints, the first of which moves all others."""
        model = self._model
        link, pose = parent
        pose = pose @ placement(rotation_from_quaternion(model["body_quat"][body]), model["body_pos"][body])
        first, count = model["body_jntadr"][body], model["body_jntnum"][body]
        for number in range(first, first + count):
            anchor = placement(rotation_with_z_along(model["jnt_axis"][number]), model["jnt_pos"][number])
            self._joints.append(self._joint(number, link, pose @ anchor))
            is_last = number == first + count - 1
            name = self._body_names[body] if is_last else f"{self._body_names[body]}:{self._joint_names[number]}"
            self._links.append(Link(name, Inertia()))
            link, pose = len(self._joints), invert_placement(anchor)
            if not is_last:
                self._frames.append(Frame(name, link, pose))
        self._add_body(body, _Body(link, pose))

    def _add_body(self, number: int, body: _Body) -> None:
        """Add the frame and the inertia of a body to its link."""
        model = self._model
        self._bodies[number] = body
        self._frames.append(Frame(self._body_names[number], body.link, body.placement))
        if number == 0:
            return  # the world has no inertia
        frame = placement(rotation_from_quaternion(model["body_iquat"][number]), model["body_ipos"][number])
        inertia = Inertia.about_centre_of_mass(
            model["body_mass"][number], np.diag(model["body_inertia"][number]), body.placement @ frame
        )
        link = self._links[body.link]
        self._links[body.link] = replace(link, inertia=link.inertia + inertia)

    def _joint(self, number: int, antecedent: int, pose: Array) -> Joint:
        """Return a joint whose frame stands at `pose` (4, 4) in its antecedent in MuJoCo's reference position."""
        model, name = self._model, self._joint_names[number]
        dof, address = model["jnt_dofadr"][number], model["jnt_qposadr"][number]
        prismatic = model["jnt_type"][number] == "mjJNT_SLIDE"
        reference = model["qpos0"][address]
        mimic = self._mimics.get(number)
        stiffness = 0.0 if "mjDSBL_SPRING" in model["disabled"] else model["jnt_stiffness"][number]
        damping = model["dof_damping"][dof] + added_to_joint(model, "actuator_damping", number)
        has_friction = not {"mjDSBL_FRICTIONLOSS", "mjDSBL_CONSTRAINT"} & set(model["disabled"])
        if mimic is not None and stiffness:
            self._fail(f"joint {name!r} has a spring and follows joint {mimic.joint!r}: move the spring to that joint")
        return Joint(
            name=name,
            antecedent=antecedent,
            prismatic=prismatic,
            placement=pose @ joint_displacement(prismatic, -reference),
            rotor_inertia=model["dof_armature"][dof] + added_to_joint(model, "actuator_armature", number),
            viscous_friction=0.0 if "mjDSBL_DAMPER" in model["disabled"] else damping,
            coulomb_friction=model["dof_frictionloss"][dof] if has_friction else 0.0,
            limits=self._limits(number),
            mimic=mimic,
            actuated=mimic is not None or self._actuated is None or number in self._actuated,
            spring=Spring(stiffness, model["qpos_spring"][address]) if stiffness else None,
            initial_position=reference,
        )

    def _limits(self, number: int) -> Limits:
        """Return the limits of a joint."""
        model = self._model
        lower, upper = model["jnt_range"][number] if model["jnt_limited"][number] else (-np.inf, np.inf)
        return Limits(lower, upper, effort=effort_limit(model, number))


def _complete_names(names: list[str | None], kind: str, known: dict[int, str]) -> list[str]:
    """Return names without gaps: bodies and joints of MJCF need none."""
    used = set(names)
    complete = []
    for number, name in enumerate(names):
        name = name or known.get(number) or f"{kind}_{number}"
        while not names[number] and name in used:
            name += "_"
        used.add(name)
        complete.append(name)
    return complete
