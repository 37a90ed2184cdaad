"""Kinematics of one named frame: pose, twist, Jacobian and acceleration."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from robot_dynamics.array_checks import broadcast_result
from robot_dynamics.codegen.jit.program_key import attempt_name
from robot_dynamics.constraints.attitude_charts import virtual_links
from robot_dynamics.constraints.frame_motion import (
    frame_bias_acceleration,
    frame_jacobian,
    frame_placement,
    rotate_to,
)
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.inputs import base_state, common_batch_shape
from robot_dynamics.newton_euler.screw import apply, concatenate_vectors

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.inputs import Base
    from robot_dynamics.joint_space.dynamics_terms import DynamicsTerms

Axes: TypeAlias = Literal["frame", "world"]
"""Axes of twists and accelerations: those of the frame, or those of the world. The reference point is the origin of the
frame in both."""


class FrameKinematics:
    """Pose, twist, Jacobian and acceleration of one frame of a robot. `Dynamics.frame` makes it.

    Twists are [linear; angular] velocity of the origin of the frame, accelerations are true and classical, of the
    origin of the frame. ``axes="frame"`` expresses them in the axes of the frame, as external wrenches are, and
    ``axes="world"`` in those of the world, which is frame 0 where the base is fixed.

    Columns of Jacobians belong to the independent joints, `Dynamics.joint_names`. With a moving base the six columns of
    its twist, which is expressed in frame 0, come first:

        twist = J [base twist; q̇],   acceleration = J [base acceleration; q̈] + bias acceleration

    In loops and platforms the joints between the base and the frame move with the independent ones. Links are rigid.

    Methods take one sample or a batch, and raise the errors of `Dynamics`: InvalidInputError for an argument that does
    not fit the robot, SingularModelError where the loops do not close or are singular. They change to compiled programs
    after some time of use, as those of `Dynamics` do; ``Dynamics.compile("jacobian", frame=...)`` compiles at once.

    Attributes
    ----------
    name : str
        Name of the frame.
    """

    def __init__(self, dynamics: DynamicsTerms, name: str) -> None:
        self._frame = dynamics.robot.frame(name)
        self._dynamics = dynamics
        self._uses_charts = self._frame.link not in virtual_links(dynamics.robot)
        self.name = name

    def __repr__(self) -> str:
        return f"FrameKinematics({self._dynamics!r}, {self.name!r})"

    def pose(self, q: ArrayLike, *, base: Base | None = None, relative_to: str | None = None) -> Array:
        """Pose of the frame in the world, which is frame 0 where the base is fixed, or in another frame.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        base : Base, optional
            State of the base, for a robot with a moving base only. Poses in other frames do not depend on it.
        relative_to : str, optional
            Name of another frame, in which the pose is expressed, such as the base link. Default: the world.

        Returns
        -------
        ndarray, shape (..., 4, 4)
            Homogeneous matrices [m].

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.inertia_matrix`.
        """
        robot = self._dynamics.robot
        pose = self._pose_in_base(q)
        if relative_to is not None:
            if base is not None:
                base_state(robot, base)  # refuses what does not fit
            reference = FrameKinematics(self._dynamics, relative_to)._pose_in_base(q)
            R = np.swapaxes(reference[..., :3, :3], -1, -2)
            relative = np.array(pose)
            with np.errstate(all="ignore"):
                relative[..., :3, :3] = R @ pose[..., :3, :3]
                relative[..., :3, 3] = apply(R, pose[..., :3, 3] - reference[..., :3, 3])
            return broadcast_result(relative, relative.shape, axes=0)
        if base is None and not robot.moving_base:
            return pose
        base_pose = base_state(robot, base).pose
        batch = common_batch_shape(pose[..., 0, :], base_pose[..., 0, :])
        with np.errstate(all="ignore"):
            return broadcast_result(base_pose @ pose, batch, axes=2)

    def jacobian(self, q: ArrayLike, *, axes: Axes = "frame", base: Base | None = None) -> Array:
        """Jacobian of the twist of the frame.

        Its transpose gives the efforts at the joints that a wrench on the frame, in the same axes, adds up to.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        axes : {"frame", "world"}
            Axes of the twist. The reference point is the origin of the frame.
        base : Base, optional
            State of the base, for a robot with a moving base only; needed for axes="world".

        Returns
        -------
        ndarray, shape (..., 6, n)
            Rows: linear [m/s], then angular velocity [rad/s]. With a moving base (..., 6, 6 + n), the base first.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.inertia_matrix`.

        Notes
        -----
        Source: Khalil, section 2.2, for the joints of a loop; G of section 4 for the independent joints.
        """
        model = "jacobian" if _is_frame(axes) else "jacobian_in_base_axes"
        J = self._attempt(model, q)
        if J is None:
            q = self._dynamics._check_positions(q)

            def recursion() -> Array:
                state = self._dynamics._closure_solver.state_at(q, use_charts=self._uses_charts)
                with np.errstate(all="ignore"):
                    J = frame_jacobian(state, self._frame, axes == "frame")
                    return broadcast_result(J, np.shape(q)[:-1], axes=2)

            J = self._evaluate(model, {"q": q}, recursion)
        return self._in_axes(J, axes, base)

    def twist(self, q: ArrayLike, qd: ArrayLike, *, axes: Axes = "frame", base: Base | None = None) -> Array:
        """Twist of the frame: linear and angular velocity of its origin.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        qd : array_like, shape (..., n)
            Velocities [rad/s or m/s].
        axes : {"frame", "world"}
            Axes of the twist. The reference point is the origin of the frame.
        base : Base, optional
            State of the base, for a robot with a moving base only.

        Returns
        -------
        ndarray, shape (..., 6)
            Linear [m/s] and angular velocity [rad/s].

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.inertia_matrix`.
        """
        rates = concatenated_rates(self._dynamics, qd, base)
        return products(self.jacobian(q, axes=axes, base=base), rates)

    def bias_acceleration(
        self, q: ArrayLike, qd: ArrayLike, *, axes: Axes = "frame", base: Base | None = None
    ) -> Array:
        """Acceleration of the frame where neither the independent joints nor the base accelerate: J̇q̇.

        Parameters
        ----------
        q, qd, axes
            As `twist`.
        base : Base, optional
            State of the base without acceleration, for a robot with a moving base only.

        Returns
        -------
        ndarray, shape (..., 6)
            Classical acceleration of the origin [m/s²] and angular acceleration [rad/s²]. In the axes of the world it
            is the derivative of the Jacobian by time, times the velocities, where the base is fixed.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.inertia_matrix`.
        """
        dynamics = self._dynamics
        dynamics._refuse_base_acceleration(base)
        model = "bias_acceleration" if _is_frame(axes) else "bias_acceleration_in_base_axes"
        acceleration = self._attempt(model, q, qd) if base is None else None
        if acceleration is None:
            q = dynamics._check_positions(q)

            def recursion() -> Array:
                state = dynamics._state(q, qd, base, use_charts=self._uses_charts)
                with np.errstate(all="ignore"):
                    acceleration = frame_bias_acceleration(
                        state.constrained_state,
                        self._frame,
                        state.qd,
                        state.drift,
                        state.base.twist[..., 3:],
                        axes == "frame",
                    )
                return broadcast_result(acceleration, state.batch)

            arguments = {"q": q, "qd": dynamics._check_joints("velocities", qd)}
            acceleration = self._evaluate(model, arguments, recursion, base=base)
        return self._in_axes(acceleration[..., None], axes, base)[..., 0]

    def acceleration(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, axes: Axes = "frame", base: Base | None = None
    ) -> Array:
        """Acceleration of the frame: true (gravity is not subtracted) and classical, of its origin.

        Parameters
        ----------
        q, qd, axes
            As `twist`.
        qdd : array_like, shape (..., n)
            Accelerations of all independent joints [rad/s² or m/s²], those of unactuated joints too.
        base : Base, optional
            State of the base with its acceleration, for a robot with a moving base only.

        Returns
        -------
        ndarray, shape (..., 6)
            Linear [m/s²] and angular acceleration [rad/s²].

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.inertia_matrix`.
        """
        dynamics = self._dynamics
        accelerations = dynamics._check_joints("accelerations", qdd)
        without_acceleration = base
        if dynamics.robot.moving_base or base is not None:
            state = base_state(dynamics.robot, base)
            accelerations = _concatenate(state.true_acceleration(state.prescribed_acceleration), accelerations)
            assert base is not None  # base_state refuses it
            without_acceleration = type(base)(base.pose, base.twist)
        bias = self.bias_acceleration(q, qd, axes=axes, base=without_acceleration)
        of_joints = products(self.jacobian(q, axes=axes, base=base), accelerations)
        batch = common_batch_shape(of_joints, bias)
        with np.errstate(all="ignore"):
            return broadcast_result(of_joints + bias, batch)

    def _pose_in_base(self, q: ArrayLike) -> Array:
        """Pose (..., 4, 4) of the frame in frame 0."""
        pose = self._attempt("pose", q)
        if pose is not None:
            return pose
        q = self._dynamics._check_positions(q)

        def recursion() -> Array:
            closed = self._dynamics._closure_solver.close_loops(q)
            with np.errstate(all="ignore"):
                pose = frame_placement(self._dynamics.robot, closed, self._frame)
                return broadcast_result(pose, np.shape(q)[:-1], axes=2)

        return self._evaluate("pose", {"q": q}, recursion)

    def _attempt(self, model: str, *arguments: ArrayLike) -> Array | None:
        return self._dynamics._attempt(attempt_name(model, self.name), *arguments)

    def _evaluate(
        self, model: str, arguments: dict[str, Array], recursion: Callable[[], Array], **options: Base | None
    ) -> Array:
        return self._dynamics._evaluate(model, arguments, recursion, {**options, "frame": self.name})

    def _in_axes(self, screws: Array, axes: Axes, base: Base | None) -> Array:
        """Screws (..., 6, k) in `axes`, from those in the axes of the frame, or of frame 0 for those of the world."""
        if base is None and not (self._dynamics.robot.moving_base and axes == "world"):
            return screws
        state = base_state(self._dynamics.robot, base)
        if axes == "frame":
            return screws
        return screws_in_world(screws, state.pose)


def _is_frame(axes: str) -> bool:
    """Whether axes are those of the frame. Raises InvalidInputError for what is not an Axes."""
    if axes not in ("frame", "world"):
        raise InvalidInputError(f'axes are "frame" or "world", not {axes!r:.60}')
    return axes == "frame"


def screws_in_world(screws: Array, pose: Array) -> Array:
    """Screws (..., 6, k) in the axes of the world, from those of frame 0, whose pose is (..., 4, 4)."""
    batch = common_batch_shape(screws[..., 0, :], pose[..., 0, :])
    with np.errstate(all="ignore"):
        return broadcast_result(rotate_to(np.swapaxes(pose[..., :3, :3], -1, -2), screws), batch, axes=2)


def products(matrices: Array, vectors: Array) -> Array:
    """Products (..., m) of matrices (..., m, k) and vectors (..., k)."""
    batch = common_batch_shape(matrices[..., 0, :], vectors)
    with np.errstate(all="ignore"):
        return broadcast_result(apply(matrices, vectors), batch)


def concatenated_rates(dynamics: DynamicsTerms, qd: ArrayLike, base: Base | None) -> Array:
    """Checked velocities (..., n), or (..., 6 + n) with the twist of a moving base first."""
    rates = dynamics._check_joints("velocities", qd)
    if base is None and not dynamics.robot.moving_base:
        return rates
    return _concatenate(base_state(dynamics.robot, base).twist, rates)


def _concatenate(of_base: Array, of_joints: Array) -> Array:
    """[of_base (..., 6); of_joints (..., n)]."""
    common_batch_shape(of_base, of_joints)  # refuses batches that differ
    return concatenate_vectors([of_base, of_joints])
