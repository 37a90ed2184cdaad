"""Geometry and kinematics of parallel robots in coordinates of the platform (Khalil, 5): V_p = J_p q̇_a."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.array_checks import broadcast_result
from robot_dynamics.constraints.attitude_charts import STEEP_PITCH_COSINE
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.inputs import UNACTUATED_REASON, common_batch_shape
from robot_dynamics.parallel.compiled_platform import CompiledPlatform
from robot_dynamics.parallel.platform_arguments import PlatformArguments
from robot_dynamics.parallel.platform_closure import PlatformClosure
from robot_dynamics.parallel.platform_motion import AngleRates, ChartRates, PlatformRates, pose_from_coordinates

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray
    from robot_dynamics.constraints.closure_solver import ClosureSolver
    from robot_dynamics.constraints.constrained_state import ConstrainedState
    from robot_dynamics.joint_space.joint_dynamics import JointDynamics
    from robot_dynamics.model.platform import Platform
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.parallel.platform_arguments import (
        OtherJointInput,
        PlatformArray,
        PlatformInput,
    )
    from robot_dynamics.results import JointMotion


class PlatformKinematics:
    """Geometry and kinematics of platforms; base class of `PlatformDynamics`, which documents arguments and attributes.

    dynamics: Dynamics of the robot; platforms: of its platforms, those with prescribed poses; make_closure_solver:
    returns the ClosureSolver of a Robot.
    """

    def __init__(
        self,
        dynamics: JointDynamics,
        platforms: Sequence[Platform],
        make_closure_solver: Callable[[Robot], ClosureSolver],
    ) -> None:
        robot = dynamics.robot
        self._dynamics = dynamics
        self.link_names: tuple[str, ...] = tuple(robot.links[platform.link].name for platform in platforms)
        free = [tuple(platform.free) for platform in platforms]
        self.free: tuple[str, ...] | dict[str, tuple[str, ...]] = (
            free[0] if len(platforms) == 1 else dict(zip(self.link_names, free, strict=True))
        )
        self._closure = PlatformClosure(dynamics, platforms, make_closure_solver)
        self._coordinate_joints = self._closure.coordinate_joints
        self._independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
        others = self._closure.other_joints
        self.other_joint_names: tuple[str, ...] = tuple(robot.joints[number].name for number in others)
        undetermined = [robot.joints[number].name for number in others if number not in self._independent]
        if undetermined:
            raise InvalidInputError(
                f"the platform does not determine the positions of {', '.join(map(repr, undetermined))}, which the "
                "motors do: use the joints"
            )
        unactuated = [number for number in others if not robot.joints[number].actuated]
        # columns of the unactuated joints in vectors (..., n)
        self._unactuated = [self._independent.index(number) for number in unactuated]
        reasons = {
            others.index(number): f"joint {robot.joints[number].name!r}: {UNACTUATED_REASON}" for number in unactuated
        }
        self._arguments = PlatformArguments(self.link_names, self.other_joint_names, reasons)
        charted = {attitude.joints for attitude in self._closure.solver.attitudes}
        self._rates = PlatformRates(
            tuple(
                ChartRates if tuple(joints[3:]) in charted else AngleRates
                for joints in self._coordinate_joints.tolist()
            )
        )
        self._compiled: CompiledPlatform | None = None
        if len(platforms) == 1:
            self._compiled = CompiledPlatform(
                self._closure.solver,
                make_closure_solver(robot),
                self._coordinate_joints[0].tolist(),
                has_rates=self._rates.conversions == (ChartRates,) and not others,
            )

    def joint_positions(
        self, pose: PlatformInput, seed: ArrayLike | None = None, other_joints: OtherJointInput | None = None
    ) -> Array:
        """Inverse geometry: positions of all joints at a pose of the platform.

        Parameters
        ----------
        pose : array_like, shape (..., 4, 4), or mapping of str to array_like
            Homogeneous matrices [m]. Where the legs do not allow the pose, one with the same free coordinates counts.
        seed : array_like, shape (..., all joints), optional
            Positions near which the legs close, each in its assembly mode; nan leaves a joint out. Default: the
            assembly mode of the initial positions.
        other_joints : sequence of array_like, shape (..., k), optional
            Motion of the other joints, of which only the positions count.

        Returns
        -------
        ndarray, shape (..., all joints)
            Positions [rad or m], which Dynamics takes as `q`.

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot.
        SingularModelError
            A leg does not reach the pose, or is singular there.
        """
        if self._compiled is not None and other_joints is None:
            q = self._compiled.joint_positions(pose, seed)
            if q is not None:
                return q
        poses = self._arguments.check_poses(pose)
        return self._closure.close_legs(poses, seed, self._arguments.check_other_joints(other_joints).positions)

    def reach(self, pose: PlatformInput, other_joints: OtherJointInput | None = None) -> tuple[Array, BoolArray]:
        """Inverse geometry with a flag where the legs do not reach.

        Parameters
        ----------
        pose, other_joints
            As `joint_positions`.

        Returns
        -------
        q : ndarray, shape (..., all joints)
            Positions [rad or m]; without meaning where `reached` is false.
        reached : ndarray of bool, shape (...)
            Whether the legs reach the pose.

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot.
        """
        poses = self._arguments.check_poses(pose)
        positions = self._arguments.check_other_joints(other_joints).positions
        q, reached, _ = self._closure.try_close_legs(poses, None, positions)
        return q, reached

    def condition_number(self, q: ArrayLike) -> Array:
        """Condition number of J_p between motors and free coordinates.

        Parameters
        ----------
        q : array_like, shape (..., all joints)
            Positions as `joint_positions` returns them [rad or m].

        Returns
        -------
        ndarray, shape (...)
            Angles are scaled by the characteristic length of the robot; infinite where the motors do not hold the
            platform.
        """
        joints = self._dynamics.robot.joints
        length = self._dynamics.robot.characteristic_length
        independent = self._closure.solver.independent
        free = self._closure.free_joints
        motors = [number for number in self._independent if number not in independent]
        G = self._closure.solver.state_at_closed(np.asarray(q, dtype=float)).G
        free_units = np.array([length if joints[number].prismatic else 1.0 for number in free])
        motor_units = np.array([length if joints[number].prismatic else 1.0 for number in motors])
        columns = [independent.index(number) for number in free]
        with np.errstate(all="ignore"):
            return np.asarray(np.linalg.cond(G[..., motors, :][..., columns] * free_units / motor_units[:, None]))

    def pose(self, q: ArrayLike) -> PlatformArray:
        """Direct geometry: pose of the platform at motor positions.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m]. Of all joints: those of dependent joints are a seed and choose the assembly mode.

        Returns
        -------
        ndarray, shape (..., 4, 4), or dict of str to ndarray

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.expand_positions`.
        """
        if self._compiled is not None:
            pose = self._compiled.pose(q)
            if pose is not None:
                return pose
        x = self._dynamics.expand_positions(q)[..., self._coordinate_joints]
        return self._arguments.by_platform(pose_from_coordinates(x), 2)

    def jacobian(self, q: ArrayLike) -> PlatformArray:
        """Jacobian J_p: twist of the platform for unit rates of the independent joints.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m], as for `pose`.

        Returns
        -------
        ndarray, shape (..., 6, n), or dict of str to ndarray

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.expand_positions`.
        """
        state = self._dynamics.constrained_state(q)
        x = state.q[..., self._coordinate_joints]
        G = state.G[..., self._coordinate_joints, :]
        columns = [self._rates.twist(x, G[..., column]) for column in range(G.shape[-1])]
        return self._arguments.by_platform(np.stack(columns, axis=-1), 2)

    def joint_motion(
        self,
        pose: PlatformInput,
        twist: PlatformInput | None = None,
        acceleration: PlatformInput | None = None,
        seed: ArrayLike | None = None,
        other_joints: OtherJointInput | None = None,
    ) -> tuple[Array, Array, Array]:
        """Inverse kinematics: motion of all joints for a motion of the platform.

        Parameters
        ----------
        pose, seed
            As `joint_positions`.
        twist, acceleration : array_like, shape (..., 6), or mapping of str to array_like, optional
            [m/s, rad/s] and [m/s², rad/s²]; zero by default. Only what the legs leave free is read.
        other_joints : sequence of array_like, shape (..., k), optional
            Motion of the other joints.

        Returns
        -------
        q, qd, qdd : ndarray, shape (..., all joints)
            Positions, velocities, accelerations.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `joint_positions`.
        """
        state, rates, rate_derivatives = self._motion(pose, twist, acceleration, seed, other_joints)
        qdd = state.joint_accelerations(rates, rate_derivatives)
        return np.array(np.broadcast_to(state.q, qdd.shape)), state.joint_velocities(rates), qdd

    def acceleration(self, motion: JointMotion) -> PlatformArray:
        """Acceleration of the platform in a motion of all joints.

        Parameters
        ----------
        motion : JointMotion
            As `DynamicsResult.motion`.

        Returns
        -------
        ndarray, shape (..., 6), or dict of str to ndarray
            [m/s², rad/s²], in the frame of the platform.
        """
        return self._arguments.by_platform(self._rates.acceleration(*self._platform_rates(motion)))

    def twist(self, motion: JointMotion) -> PlatformArray:
        """Twist of the platform in a motion of all joints.

        Parameters
        ----------
        motion : JointMotion
            As `DynamicsResult.motion`.

        Returns
        -------
        ndarray, shape (..., 6), or dict of str to ndarray
            [m/s, rad/s], in the frame of the platform.
        """
        x, rates, _ = self._platform_rates(motion)
        return self._arguments.by_platform(self._rates.twist(x, rates))

    def _attempt_motor_motion(
        self,
        pose: PlatformInput,
        twist: PlatformInput | None,
        acceleration: PlatformInput | None,
        seed: ArrayLike | None,
        other_joints: OtherJointInput | None,
    ) -> tuple[Array, ...] | None:
        """Return q (all joints,), qd and qdd (n,) of one sample by CompiledPlatform, None where it has no result."""
        if self._compiled is None or other_joints is not None:
            return None
        q = self._compiled.joint_positions(pose, seed)
        if q is None:
            return None
        twists = self._arguments.check_screws("twist", twist)
        accelerations = self._arguments.check_screws("acceleration", acceleration)
        if twists.ndim > 2 or accelerations.ndim > 2:
            return None
        rates = self._compiled.motor_rates(q, twists, accelerations)
        return None if rates is None else (q, *rates)

    def _motion(
        self,
        pose: PlatformInput,
        twist: PlatformInput | None,
        acceleration: PlatformInput | None,
        seed: ArrayLike | None,
        other_joints: OtherJointInput | None,
    ) -> tuple[ConstrainedState, Array, Array]:
        """Return the constrained state of a motion, and its rates and their derivatives, (..., all joints) each."""
        poses = self._arguments.check_poses(pose)
        others = self._arguments.check_other_joints(other_joints)
        twists = self._arguments.check_screws("twist", twist)
        accelerations = self._arguments.check_screws("acceleration", acceleration)
        state = self._closure.solver.state_at_closed(self._closure.close_legs(poses, seed, others.positions))
        x = state.q[..., self._coordinate_joints]
        rates = state.complete_rates(self._embed(self._rates.rates(x, twists), others.velocities))
        derivatives = self._rates.rate_derivatives(x, rates[..., self._coordinate_joints], accelerations)
        rate_derivatives = state.complete_rates(
            self._embed(derivatives, others.accelerations), state.constraint_drift(rates)
        )
        batch = common_batch_shape(state.q, rates, rate_derivatives)
        return state, broadcast_result(rates, batch), broadcast_result(rate_derivatives, batch)

    def _embed(self, of_platforms: Array, of_other_joints: Array) -> Array:
        """Return (..., all joints): values of platforms (..., platforms, 6), of other joints (..., k), or zero."""
        batch = np.broadcast_shapes(of_platforms.shape[:-2], of_other_joints.shape[:-1])
        values = np.zeros((*batch, len(self._dynamics.all_joint_names)))
        values[..., self._coordinate_joints] = of_platforms
        values[..., self._closure.other_joints] = of_other_joints
        return values

    def _platform_rates(self, motion: JointMotion) -> tuple[Array, Array, Array]:
        """Return coordinates, rates and their derivatives (..., platforms, 6) in a JointMotion."""
        q, velocities, accelerations = motion
        joints = self._coordinate_joints
        x = q[..., joints]
        has_charts = ChartRates in self._rates.conversions
        if has_charts and np.abs(np.cos(x[..., 4])).min(initial=1) < STEEP_PITCH_COSINE:
            # rates of the angles are large there or do not exist: use those of the independent joints
            state = self._dynamics.constrained_state(q)
            rates = state.expand_rates(velocities[..., self._independent])
            rate_derivatives = state.expand_rates(accelerations[..., self._independent], state.constraint_drift(rates))
            return x, rates[..., joints], rate_derivatives[..., joints]
        twist = AngleRates.twist(x, velocities[..., joints])
        acceleration = AngleRates.acceleration(x, velocities[..., joints], accelerations[..., joints])
        rates = self._rates.rates(x, twist)
        return x, rates, self._rates.rate_derivatives(x, rates, acceleration)
