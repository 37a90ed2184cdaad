"""Inverse and direct dynamics of a serial or branched robot with flexible links: rigid and elastic motion together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.array_checks import broadcast_result, require_finite
from robot_dynamics.errors import InvalidInputError, UnavailableModelError
from robot_dynamics.flexible.block_recursion import solve, sweep_forward
from robot_dynamics.flexible.structure import nearest_node
from robot_dynamics.flexible.structure_builder import build_structure
from robot_dynamics.inputs import UNACTUATED_REASON, base_state, common_batch_shape
from robot_dynamics.newton_euler.friction import friction, has_load_friction, load_friction, loads_from_net_efforts
from robot_dynamics.newton_euler.joint_springs import spring_force
from robot_dynamics.newton_euler.screw import wrench_to_antecedent
from robot_dynamics.notebook_display import notebook_html

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray
    from robot_dynamics.inputs import ExternalWrenches
    from robot_dynamics.joint_space.joint_dynamics import JointDynamics
    from robot_dynamics.model.robot import Robot

MAX_ROTATION = 1.0  # of the end of an element [rad]: the model assumes slight bending


@dataclass(frozen=True, eq=False)
class FlexibleDynamicsResult:
    """Motion and efforts of a robot with flexible links.

    Attributes
    ----------
    accelerations : (..., n)
        Accelerations of the joints [rad/s² or m/s²].
    elastic_accelerations : (..., m)
        Second derivatives of the elastic coordinates [m/s² or rad/s²].
    efforts : (..., n)
        Efforts of the actuators [N m or N]; zero at unactuated joints.
    """

    _repr_html_ = notebook_html

    accelerations: Array
    elastic_accelerations: Array
    efforts: Array


class FlexibleArm:
    """Inverse and direct dynamics of a robot with flexible links; `Dynamics.flexible_arm` constructs it.

    Parameters
    ----------
    dynamics : Dynamics
        Of a robot without loops on a fixed base.

    Attributes
    ----------
    joint_names : tuple of str
        The n joints, in the order of `Dynamics.joint_names`.
    elastic_coordinate_names : tuple of str
        The m elastic coordinates, `link.element.component`: displacement (x, y, z [m]) and rotation (rx, ry, rz [rad])
        of the end of an element relative to its start, in the axes of the start, x along the element.
    structure : Structure
        The virtual tree of elements (internal).

    Raises
    ------
    InvalidInputError
        The robot has loops, a platform, mimic joints or a moving base.

    Notes
    -----
    q, qd, qdd and efforts are (..., n), e and ed (..., m). Unactuated joints move freely, with a brake or without.

    The only approximation is the shape of an element relative to its own start: that of a slender beam, slightly bent,
    which shortens as it bends, so that centrifugal forces stiffen it and weights soften it. For that shape the large
    motion of the frames behind it and the inertial forces of the bent beam are exact. A beam of more elements may bend
    further. Not modelled: shear, material damping, coupling of torsion and bending within an element.

    Methods raise InvalidInputError where an argument does not fit or the end of an element turns by more than 1 rad.
    """

    def __init__(self, dynamics: JointDynamics) -> None:
        self._robot = dynamics.robot
        _refuse_unsupported(self._robot)
        self.structure = build_structure(self._robot, held=())
        nodes = self.structure.nodes
        coordinates = {node.joint_number: node.coordinates[0] for node in nodes if node.joint is not None}
        # numbers of the joints, and of the coordinates of each element, among the generalized coordinates
        self._joints = [coordinates[number] for number in range(len(self._robot.joints))]
        self._elements = [(node.element, list(node.coordinates)) for node in nodes if node.element is not None]
        self._elastic = [number for _, numbers in self._elements for number in numbers]
        self.joint_names: tuple[str, ...] = dynamics.joint_names
        self.elastic_coordinate_names: tuple[str, ...] = tuple(
            self.structure.coordinates[number] for number in self._elastic
        )

    def __repr__(self) -> str:
        return f"FlexibleArm({self._robot!r})"

    @property
    def stiffness(self) -> Array:
        """(m, m) stiffness matrix K [N/m, N, N m] of the elastic coordinates: K e are the elastic forces."""
        K = np.zeros((len(self.structure.coordinates),) * 2)
        for element, numbers in self._elements:
            K[np.ix_(numbers, numbers)] = element.stiffness
        return K[np.ix_(self._elastic, self._elastic)]

    def inverse(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        e: ArrayLike,
        ed: ArrayLike,
        *,
        external_wrenches: ExternalWrenches | None = None,
    ) -> FlexibleDynamicsResult:
        """Inverse dynamic model: efforts and elastic accelerations for prescribed joint accelerations.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Positions [rad or m], velocities, accelerations of the joints; 0 or nan for the accelerations of unactuated
            joints.
        e, ed : array_like, shape (..., m)
            Elastic coordinates [m or rad] and their rates.
        external_wrenches : mapping of str to array_like, shape (..., 6), optional
            Wrenches of the environment on links or frames [N, N m], in their own axes at their origins, which move as
            the links bend.

        Returns
        -------
        FlexibleDynamicsResult

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot.
        SingularModelError
            Some motion has no inertia.

        Notes
        -----
        Source: Khalil, sections 3.2 and 6, with elastic coordinates in the place of elastic joints.
        """
        prescribed = np.array([joint.actuated for joint in self._robot.joints], dtype=bool)
        accelerations = self._check_actuated("accelerations", qdd)
        return self._solve(q, qd, e, ed, external_wrenches, prescribed, qdd=accelerations)

    def direct(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        efforts: ArrayLike,
        e: ArrayLike,
        ed: ArrayLike,
        *,
        external_wrenches: ExternalWrenches | None = None,
    ) -> FlexibleDynamicsResult:
        """Direct dynamic model: joint and elastic accelerations that efforts cause.

        Parameters
        ----------
        q, qd, e, ed, external_wrenches
            As `inverse`.
        efforts : array_like, shape (..., n)
            Efforts of the actuators [N m or N]; 0 or nan for unactuated joints.

        Returns
        -------
        FlexibleDynamicsResult

        Raises
        ------
        InvalidInputError, SingularModelError
            As `inverse`.

        Notes
        -----
        Source: Khalil, section 3.3.2.
        """
        prescribed = np.zeros(len(self._robot.joints), dtype=bool)
        return self._solve(
            q, qd, e, ed, external_wrenches, prescribed, efforts=self._check_actuated("efforts", efforts)
        )

    def inertia_matrix(self, q: ArrayLike, e: ArrayLike) -> Array:
        """Mass matrix M(q, e) of the joints and the elastic coordinates, rotors included.

        Parameters
        ----------
        q, e
            As `inverse`.

        Returns
        -------
        ndarray, shape (..., n + m, n + m)
            The joints first.

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot.
        """
        q, e = self._check_shape(q, e)
        coordinates = [*self._joints, *self._elastic]
        x, _ = self._coordinates(common_batch_shape(q, e), q, 0.0, e, 0.0)
        x = np.repeat(x[..., None, :], len(coordinates), axis=-2)  # one row for each unit acceleration
        units = np.broadcast_to(np.eye(len(coordinates))[coordinates], x.shape)
        sweep = sweep_forward(self.structure, x, np.zeros_like(x), {})
        none_unknown = np.zeros(len(coordinates), dtype=bool)
        _, forces = solve(self.structure, sweep, units, np.zeros_like(x), none_unknown, np.zeros(6))
        M = forces[..., coordinates]
        return (M + np.swapaxes(M, -1, -2)) / 2

    def link_pose(self, name: str, q: ArrayLike, e: ArrayLike) -> Array:
        """Pose of a link frame in frame 0 with bent links.

        Parameters
        ----------
        name : str
            Name of a link or of another frame.
        q, e
            As `inverse`.

        Returns
        -------
        ndarray, shape (..., 4, 4)

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot.
        """
        q, e = self._check_shape(q, e)
        node, pose = self._find_node(name)
        x, _ = self._coordinates(common_batch_shape(q, e), q, 0.0, e, 0.0)
        sweep = sweep_forward(self.structure, x, np.zeros_like(x), {})
        while node:
            attached = sweep[node].attached
            in_parent = np.zeros((*x.shape[:-1], 4, 4))
            in_parent[..., :3, :3] = attached.rotations[..., -1, :, :]
            in_parent[..., :3, 3] = attached.positions[..., -1, :]
            in_parent[..., 3, 3] = 1
            pose = in_parent @ pose
            node = self.structure.nodes[node].parent_number
        return broadcast_result(pose, x.shape[:-1], axes=2)

    def _solve(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        e: ArrayLike,
        ed: ArrayLike,
        external_wrenches: ExternalWrenches | None,
        prescribed: BoolArray,
        qdd: Array | None = None,
        efforts: Array | None = None,
    ) -> FlexibleDynamicsResult:
        """Return the motion with known accelerations of the joints `prescribed` and known efforts of the others."""
        q, e = self._check_shape(q, e)
        qd = self._check_joints("velocities", qd)
        ed = self._check_elastic("rates of bending", ed)
        wrenches = self._node_wrenches(external_wrenches)
        batch = common_batch_shape(q, qd, e, ed, qdd, efforts, *wrenches.values())
        x, rates = self._coordinates(batch, q, qd, e, ed)
        accelerations = np.zeros_like(x)
        forces = np.zeros_like(x)
        with np.errstate(all="ignore"):  # values that are not finite are refused at the end
            passive_efforts = friction(self._robot, qd) + spring_force(self._robot, q, qd)
            forces[..., self._elastic] = -e @ self.stiffness
            net_efforts = -passive_efforts if efforts is None else efforts - passive_efforts
            forces[..., self._joints] = loads_from_net_efforts(self._robot.joints, qd, net_efforts)
            if qdd is not None:
                accelerations[..., self._joints] = qdd
            unknown = np.ones(x.shape[-1], dtype=bool)
            unknown[self._joints] = ~prescribed
            sweep = sweep_forward(self.structure, x, rates, wrenches)
            base_acceleration = base_state(self._robot, None).rest_acceleration
            accelerations, forces = solve(self.structure, sweep, accelerations, forces, unknown, base_acceleration)
            if efforts is None:  # of joints that are not prescribed the remainder is a rounding error
                loads = forces[..., self._joints]
                if has_load_friction(self._robot):
                    passive_efforts = passive_efforts + load_friction(self._robot.joints, qd, loads)
                efforts = np.where(prescribed, loads + passive_efforts, 0.0)
        return FlexibleDynamicsResult(
            broadcast_result(accelerations[..., self._joints], batch),
            broadcast_result(accelerations[..., self._elastic], batch),
            broadcast_result(efforts, batch),
        )

    def _coordinates(
        self, batch: tuple[int, ...], q: Array, qd: Array | float, e: Array, ed: Array | float
    ) -> tuple[Array, Array]:
        """Return generalized coordinates and rates (..., g) in the order of the structure."""
        x = np.zeros((*batch, len(self.structure.coordinates)))
        x[..., self._joints] = q
        x[..., self._elastic] = e
        rates = np.zeros_like(x)
        rates[..., self._joints] = qd
        rates[..., self._elastic] = ed
        return x, rates

    def _check_joints(self, label: str, values: ArrayLike, ignored_columns: Mapping[int, str] | None = None) -> Array:
        """Return checked values (..., n) of the joints."""
        names = f"joints ({', '.join(self.joint_names)})"
        return require_finite(label, values, len(self.joint_names), names, ignored_columns)

    def _check_actuated(self, label: str, values: ArrayLike) -> Array:
        """Return checked accelerations or efforts (..., n), which unactuated joints do not take."""
        unactuated = [number for number, joint in enumerate(self._robot.joints) if not joint.actuated]
        return self._check_joints(label, values, dict.fromkeys(unactuated, UNACTUATED_REASON))

    def _check_elastic(self, label: str, values: ArrayLike) -> Array:
        """Return checked values (..., m) of the elastic coordinates."""
        names = "elastic coordinates, in the order of elastic_coordinate_names"
        return require_finite(label, values, len(self.elastic_coordinate_names), names)

    def _check_shape(self, q: ArrayLike, e: ArrayLike) -> tuple[Array, Array]:
        """Return checked q and e of slightly bent elements."""
        q = self._check_joints("positions", q)
        e = self._check_elastic("bending", e)
        rotations = e.reshape(*e.shape[:-1], len(self._elements), 6)[..., 3:]
        angles = np.linalg.norm(rotations, axis=-1)
        if angles.size and angles.max() > MAX_ROTATION:
            element = int(np.argmax(angles)) % angles.shape[-1]
            name = self.elastic_coordinate_names[6 * element].rsplit(".", 1)[0]
            raise InvalidInputError(
                f"the end of {name!r} is turned by {angles.max():.3g} rad relative to its start: the model of an "
                f"element holds up to {MAX_ROTATION:g} rad. Divide its beam into more elements"
            )
        return q, e

    def _find_node(self, name: str) -> tuple[int, Array]:
        """Return the node that carries a frame, and the placement (4, 4) of the frame in it."""
        frame = self._robot.frame(name)
        nodes = [number for number, node in enumerate(self.structure.nodes) if node.link == frame.link]
        return nearest_node(self.structure.nodes, nodes, frame.placement)

    def _node_wrenches(self, external_wrenches: ExternalWrenches | None) -> dict[int, Array]:
        """Return wrenches (..., 6) of the environment by node, at its origin and in its axes."""
        if not isinstance(external_wrenches, Mapping | None):
            raise InvalidInputError("external_wrenches: a mapping {link name: (..., 6)} is needed")
        wrenches: dict[int, Array] = {}
        for name, values in (external_wrenches or {}).items():
            node, placement = self._find_node(name)
            wrench = require_finite(f"external wrench on {name!r}", values, 6, "force and torque components")
            wrenches[node] = wrenches.get(node, 0) + wrench_to_antecedent(placement[:3, :3], placement[:3, 3], wrench)
        return wrenches


def _refuse_unsupported(robot: Robot) -> None:
    """Raise InvalidInputError unless a robot is a tree of independent joints on a fixed base."""
    unsupported = {
        "loops": bool(robot.loops),
        "a platform": bool(robot.platforms),
        "a moving base": robot.moving_base,
        "mimic joints": any(joint.mimic is not None for joint in robot.joints),
    }
    for feature, is_present in unsupported.items():
        if is_present:
            raise UnavailableModelError(
                f"{robot.name!r} has {feature}: flexible links are simulated only in chains and trees of independent "
                "joints on a fixed base. For natural frequencies use `Dynamics.elastodynamics`"
            )
