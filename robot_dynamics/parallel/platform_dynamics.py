"""Parallel robots in coordinates of the platform: geometry, rates, inverse and direct dynamic models (Khalil, 5).

    V_p = J_p q̇_a,   Γ = J_pᵀ [F_p + Σ J_viᵀ J_i⁻ᵀ Γ_i]

Legs and platform are branches of one tree. With prescribed coordinates of the platform, each leg is closed by itself,
which is J_i⁻¹ J_vi; with prescribed motor positions all legs are closed together, which is also J_p.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from robot_dynamics.errors import InvalidInputError, describe_unknown_name
from robot_dynamics.parallel.leg_springs import solve_unactuated_accelerations, solve_unactuated_equilibrium
from robot_dynamics.parallel.platform_kinematics import PlatformKinematics
from robot_dynamics.parallel.platform_motion import (
    check_coordinate,
    coordinates_from_pose,
    pose_from_coordinates,
    twist_drift,
    twist_matrix,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.constraints.closure_solver import ClosureSolver
    from robot_dynamics.inputs import ExternalWrenches
    from robot_dynamics.joint_space.joint_dynamics import JointDynamics
    from robot_dynamics.model.platform import Platform
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.parallel.platform_arguments import OtherJointInput, PlatformArray, PlatformInput
    from robot_dynamics.results import DynamicsResult, Equilibrium

__all__ = [
    "PlatformDynamics",
    "Platforms",
    "check_coordinate",
    "coordinates_from_pose",
    "pose_from_coordinates",
    "twist_drift",
    "twist_matrix",
]


class Platforms(dict[str, "PlatformDynamics"]):
    """{link name: PlatformDynamics}; an unknown link name raises InvalidInputError."""

    def __missing__(self, link: str) -> PlatformDynamics:
        raise InvalidInputError(describe_unknown_name("platform", link, self))


class PlatformDynamics(PlatformKinematics):
    """Dynamics of a robot in coordinates of one platform, or of all its platforms together.

    `Dynamics.platform` and `Dynamics.platforms` construct it.

    Parameters
    ----------
    dynamics : Dynamics
    platforms : sequence of Platform
    make_closure_solver : callable
        Returns the ClosureSolver of a Robot.
    make_dynamics : callable
        Returns the Dynamics of a Robot, by recursions; called where legs have unactuated joints.

    Attributes
    ----------
    link_names : tuple of str
        Links of the platforms.
    free : tuple of str, or dict of str to tuple of str
        Free coordinates of the platform, or of each platform by link name. The legs determine the other coordinates,
        and these are not read from a pose.
    other_joint_names : tuple of str
        The k joints among `Dynamics.joint_names` that the platforms do not determine: elastic joints of the legs,
        joints outside the legs, motors of platforms that are not in `link_names`.

    Raises
    ------
    InvalidInputError
        The platforms do not determine all actuated joints.
    DescriptionError
        The free coordinates of the description do not determine the platforms.

    Notes
    -----
    **Platforms.** Values of one platform are arrays; values of several are ``{link name: array}``. The pose of a
    platform is that of its frame in the frame on which it stands: frame 0, unless parallel modules stand on each other.
    Twist and acceleration are those of its origin there, linear then angular, classical, in the frame of the platform.

    **Joints.** Motors and elastic joints are vectors (..., n) in the order of `Dynamics.joint_names`. The motion of the
    other joints is ``other_joints=(positions, velocities, accelerations)``, (..., k) each, or the first of these.
    By default, positions are those of the seed or the initial ones, velocities and accelerations are zero.
    Accelerations of unactuated joints are results: 0 or nan stands there in arguments.

    **Attitude.** All methods work at every attitude. Joint positions have the yaw, pitch and roll nearest to the seed
    or to the initial positions. Only a body or friction at a joint of these angles keeps pitch within ±90°.
    """

    def __init__(
        self,
        dynamics: JointDynamics,
        platforms: Sequence[Platform],
        make_closure_solver: Callable[[Robot], ClosureSolver],
        make_dynamics: Callable[[Robot], JointDynamics],
    ) -> None:
        super().__init__(dynamics, platforms, make_closure_solver)
        self._make_dynamics = make_dynamics

    def __repr__(self) -> str:
        return f"PlatformDynamics({self._dynamics.robot!r}, {', '.join(map(repr, self.link_names))})"

    def inverse(
        self,
        pose: PlatformInput,
        twist: PlatformInput | None = None,
        acceleration: PlatformInput | None = None,
        *,
        seed: ArrayLike | None = None,
        other_joints: OtherJointInput | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> Array:
        """Inverse dynamic model: efforts for a motion of the platform.

        Parameters
        ----------
        pose, twist, acceleration, seed, other_joints
            As `joint_motion`.
        external_wrenches : mapping of str to array_like, shape (..., 6), optional
            As `Dynamics.inverse`.

        Returns
        -------
        ndarray, shape (..., n)
            Efforts [N m or N].

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot.
        SingularModelError
            The legs do not close or are singular, or springs stand between the motors and the platform: at prescribed
            deflections they determine its acceleration, whatever the motors do.
        """
        motion = self._attempt_motor_motion(pose, twist, acceleration, seed, other_joints)
        if motion is None:
            motion = self._actuated_motion(pose, twist, acceleration, seed, other_joints, external_wrenches)
        return self._dynamics.inverse(*motion, external_wrenches=external_wrenches)

    def direct(
        self,
        pose: PlatformInput,
        twist: PlatformInput | None,
        efforts: ArrayLike,
        *,
        seed: ArrayLike | None = None,
        other_joints: OtherJointInput | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> PlatformArray:
        """Direct dynamic model: acceleration of the platform that efforts cause.

        Parameters
        ----------
        pose, twist, seed, other_joints, external_wrenches
            As `inverse`.
        efforts : array_like, shape (..., n)
            Efforts of the actuators [N m or N]; 0 or nan for unactuated joints.

        Returns
        -------
        ndarray, shape (..., 6), or dict of str to ndarray
            Acceleration [m/s², rad/s²], in the frame of the platform.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `Dynamics.direct`.
        """
        motion = self._attempt_motor_motion(pose, twist, None, seed, other_joints)
        if motion is not None and self._compiled is not None:
            q, qd, _ = motion
            accelerations = self._dynamics.direct(q, qd, efforts, external_wrenches=external_wrenches)
            if accelerations.ndim == 1:
                acceleration = self._compiled.acceleration(q, qd, accelerations)
                if acceleration is not None:
                    return acceleration
        result = self.solve(
            pose,
            twist,
            efforts=efforts,
            seed=seed,
            other_joints=other_joints,
            external_wrenches=external_wrenches,
        )
        return self.acceleration(result.motion)

    def solve(
        self,
        pose: PlatformInput,
        twist: PlatformInput | None = None,
        *,
        acceleration: PlatformInput | None = None,
        efforts: ArrayLike | None = None,
        seed: ArrayLike | None = None,
        other_joints: OtherJointInput | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> DynamicsResult:
        """Inverse or direct dynamics with all results; see `inverse` and `direct`.

        Parameters
        ----------
        pose, twist, seed, other_joints, external_wrenches
            As `inverse`.
        acceleration, efforts
            Acceleration of the platform, or efforts as for `direct`: exactly one of the two.

        Returns
        -------
        DynamicsResult

        Raises
        ------
        InvalidInputError, SingularModelError
            As `inverse` and `direct`.
        """
        if (acceleration is None) == (efforts is None):
            raise InvalidInputError("give acceleration or efforts, one of the two: the other is computed")
        if efforts is None:
            q, qd, qdd = self._actuated_motion(pose, twist, acceleration, seed, other_joints, external_wrenches)
            return self._dynamics.solve(q, qd, qdd=qdd, external_wrenches=external_wrenches)
        state, rates, _ = self._motion(pose, twist, None, seed, other_joints)
        qd = rates[..., self._independent]
        return self._dynamics.solve(state.q, qd, efforts=efforts, external_wrenches=external_wrenches)

    def equilibrium(
        self,
        pose: PlatformInput,
        *,
        seed: ArrayLike | None = None,
        other_joints: OtherJointInput | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> Equilibrium:
        """Static equilibrium in which motors and springs hold the platform at a pose.

        Parameters
        ----------
        pose, seed, other_joints, external_wrenches
            As `inverse`. Seed and other joints are where the search for the deflections of the springs starts.

        Returns
        -------
        Equilibrium

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot.
        SingularModelError
            No equilibrium was found.
        """
        q = self.joint_positions(pose, seed, other_joints)
        if self._unactuated:
            q = solve_unactuated_equilibrium(
                self._closure.solver, self._actuated_dynamics, q, self._unactuated, external_wrenches
            )
        return self._dynamics.equilibrium(q, external_wrenches=external_wrenches)

    def _actuated_motion(
        self,
        pose: PlatformInput,
        twist: PlatformInput | None,
        acceleration: PlatformInput | None,
        seed: ArrayLike | None,
        other_joints: OtherJointInput | None,
        external_wrenches: ExternalWrenches | None,
    ) -> tuple[Array, Array, Array]:
        """Return q (..., all joints), qd and qdd (..., n) of a motion with zero effort at the unactuated joints."""
        state, qd, qdd = self._motion(pose, twist, acceleration, seed, other_joints)
        if self._unactuated:
            qdd = solve_unactuated_accelerations(
                self._closure.solver,
                self._actuated_dynamics,
                (state.q, qd, qdd),
                self._unactuated,
                external_wrenches,
            )
            qdd[..., [self._independent[column] for column in self._unactuated]] = 0  # Dynamics computes these
        return state.q, qd[..., self._independent], qdd[..., self._independent]

    @cached_property
    def _actuated_dynamics(self) -> JointDynamics:
        """The Dynamics of the same robot with a motor at each unactuated joint too."""
        robot = self._dynamics.robot
        numbers = {self._independent[column] for column in self._unactuated}
        joints = [replace(joint, actuated=joint.actuated or k in numbers) for k, joint in enumerate(robot.joints)]
        return self._make_dynamics(replace(robot, joints=tuple(joints)))
