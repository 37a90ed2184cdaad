"""Inverse and direct dynamics of a robot in its joint coordinates, by the recursions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.array_checks import broadcast_result
from robot_dynamics.constraints.mixed_dynamics import compute_link_wrenches, solve_mixed_dynamics
from robot_dynamics.errors import InvalidInputError, SingularModelError
from robot_dynamics.joint_space.dynamics_terms import DynamicsTerms
from robot_dynamics.joint_space.frame_kinematics import FrameKinematics
from robot_dynamics.model.placement import invert_placement
from robot_dynamics.newton_euler.equilibrium import find_equilibrium
from robot_dynamics.newton_euler.friction import friction, has_load_friction, load_friction, loads_from_net_efforts
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.joint_springs import spring_force
from robot_dynamics.newton_euler.kinematics import run_forward_pass
from robot_dynamics.newton_euler.screw import wrench_to_antecedent
from robot_dynamics.results import DynamicsResult, Equilibrium, JointMotion, refuse_unbalanced

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.constraints.closure_solver import ClosureSolver
    from robot_dynamics.constraints.constrained_state import ConstrainedState
    from robot_dynamics.inputs import Base, ExternalWrenches
    from robot_dynamics.joint_space.dynamics_terms import ModelState
    from robot_dynamics.model.robot import Robot


class JointDynamics(DynamicsTerms):
    """Inverse and direct dynamics in joint coordinates, by the recursions; base class of `Dynamics`."""

    def __init__(self, robot: Robot, closure_solver: ClosureSolver) -> None:
        super().__init__(robot, closure_solver)
        # rotation and position of each frame j in the link frame of the description
        placements = [invert_placement(robot.frame(link.name).placement) for link in robot.links]
        self._in_link_frame = [(placement[:3, :3], placement[:3, 3]) for placement in placements]

    def inverse(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        *,
        base: Base | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> Array:
        """Inverse dynamic model: joint efforts of a motion.

        The efforts move bodies and rotors against gravity, friction, springs and external wrenches. Unactuated joints
        have effort zero; `solve` also gives their accelerations.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        qd : array_like, shape (..., n)
            Velocities [rad/s or m/s].
        qdd : array_like, shape (..., n)
            Accelerations [rad/s² or m/s²]; 0 or nan for unactuated joints.
        base : Base, optional
            State of the base, for a robot with a moving base only.
        external_wrenches : mapping of str to array_like, shape (..., 6), optional
            Wrenches of the environment on links [N, N m], by link name, in the link frame at its origin.

        Returns
        -------
        ndarray, shape (..., n)
            Efforts of the actuators [N m or N].

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot, or the result overflows.
        SingularModelError
            The loops do not close or are singular, or nothing with inertia resists an unactuated joint.

        Notes
        -----
        Source: Khalil, sections 3.2, 6 and 7.2.
        """
        if base is None and external_wrenches is None:
            result = self._attempt("inverse", q, qd, qdd)
            if result is not None:
                return result
        q = self._check_positions(q)
        arguments = {
            "q": q,
            "qd": self._check_joints("velocities", qd),
            "qdd": self._check_actuated("accelerations", qdd),
        }
        return self._evaluate(
            "inverse",
            arguments,
            lambda: self.solve(q, qd, qdd=qdd, base=base, external_wrenches=external_wrenches).efforts,
            {"base": base, "external_wrenches": external_wrenches},
        )

    def direct(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        efforts: ArrayLike,
        *,
        base: Base | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> Array:
        """Direct dynamic model: joint accelerations that efforts cause.

        Parameters
        ----------
        q, qd, base, external_wrenches
            As `inverse`.
        efforts : array_like, shape (..., n)
            Efforts of the actuators [N m or N]; 0 or nan for unactuated joints.

        Returns
        -------
        ndarray, shape (..., n)
            Accelerations [rad/s² or m/s²].

        Raises
        ------
        InvalidInputError
            As `inverse`.
        SingularModelError
            The loops do not close or are singular, or nothing with inertia resists some motion.

        Notes
        -----
        Source: Khalil, sections 3.3.2, 6 and 7.3.
        """
        if base is None and external_wrenches is None:
            result = self._attempt("direct", q, qd, efforts)
            if result is not None:
                return result
        q = self._check_positions(q)
        arguments = {
            "q": q,
            "qd": self._check_joints("velocities", qd),
            "efforts": self._check_actuated("efforts", efforts),
        }
        return self._evaluate(
            "direct",
            arguments,
            lambda: self.solve(q, qd, efforts=efforts, base=base, external_wrenches=external_wrenches).accelerations,
            {"base": base, "external_wrenches": external_wrenches},
        )

    def solve(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        *,
        qdd: ArrayLike | None = None,
        efforts: ArrayLike | None = None,
        base: Base | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> DynamicsResult:
        """Inverse or direct dynamics with all results: efforts, accelerations of all joints, reactions.

        Parameters
        ----------
        q, qd, base, external_wrenches
            As `inverse`.
        qdd, efforts : array_like, shape (..., n)
            Accelerations, as for `inverse`, or efforts, as for `direct`: exactly one of the two.

        Returns
        -------
        DynamicsResult

        Raises
        ------
        InvalidInputError, SingularModelError
            As `inverse` and `direct`.
        """
        if qdd is not None and efforts is None:
            return self._solve_inverse(q, qd, self._check_actuated("accelerations", qdd), base, external_wrenches)
        if qdd is None and efforts is not None:
            return self._solve_direct(q, qd, self._check_actuated("efforts", efforts), base, external_wrenches)
        raise InvalidInputError("give accelerations or efforts, one of the two: the other is computed")

    def _solve_inverse(
        self, q: ArrayLike, qd: ArrayLike, qdd: Array, base: Base | None, external_wrenches: ExternalWrenches | None
    ) -> DynamicsResult:
        state = self._state(q, qd, base, external_wrenches, qdd)
        project = state.constrained_state.projected
        with np.errstate(all="ignore"):  # values that are not finite are refused with the result
            passive_efforts = self._passive_efforts(state)
            qdd, tree_efforts, base_acceleration, wrenches = solve_mixed_dynamics(
                state, self._unactuated, qdd, -project(passive_efforts)
            )
            tree_efforts = self._add_friction(state, tree_efforts, passive_efforts)
            efforts = project(tree_efforts)
            efforts[..., self._unactuated] = 0  # the remainder is a rounding error
        return self._result(state, qdd, efforts, base_acceleration, wrenches, tree_efforts)

    def _solve_direct(
        self, q: ArrayLike, qd: ArrayLike, efforts: Array, base: Base | None, external_wrenches: ExternalWrenches | None
    ) -> DynamicsResult:
        state = self._state(q, qd, base, external_wrenches, efforts)
        count = len(self.joint_names)
        with np.errstate(all="ignore"):  # values that are not finite are refused with the result
            passive_efforts = self._passive_efforts(state)
            net_efforts = efforts - state.constrained_state.projected(passive_efforts)
            independent = self._closure_solver.independent
            joints = [self.robot.joints[number] for number in independent]
            loads = loads_from_net_efforts(joints, state.qd[..., independent], net_efforts)
            qdd, tree_efforts, base_acceleration, wrenches = solve_mixed_dynamics(
                state, range(count), np.zeros(count), loads
            )
            tree_efforts = self._add_friction(state, tree_efforts, passive_efforts)
        return self._result(state, qdd, efforts, base_acceleration, wrenches, tree_efforts)

    def _passive_efforts(self, state: ModelState) -> Array:
        """Return efforts (..., all joints) of springs, and of friction that does not depend on load."""
        return friction(self.robot, state.qd) + spring_force(self.robot, state.q, state.qd)

    def _add_friction(self, state: ModelState, tree_efforts: Array, passive_efforts: Array) -> Array:
        """Return tree_efforts (..., all joints) with `_passive_efforts` and load-dependent friction."""
        efforts = tree_efforts + passive_efforts
        if has_load_friction(self.robot):
            efforts = efforts + load_friction(self.robot.joints, state.qd, tree_efforts)
        return efforts

    def _result(
        self,
        state: ModelState,
        qdd: Array,
        efforts: Array,
        base_acceleration: Array,
        wrenches: Array,
        tree_efforts: Array,
    ) -> DynamicsResult:
        """Return the DynamicsResult of a motion.

        base_acceleration: (..., 6), gravity subtracted; wrenches: (..., 1 + all joints, 6) of the tree, in frames j;
        tree_efforts: (..., all joints), friction and springs included.
        """
        with np.errstate(all="ignore"):
            joint_accelerations = state.expand_accelerations(qdd)
            if self.robot.loops:
                wrenches = compute_link_wrenches(state, joint_accelerations, base_acceleration, tree_efforts)
            reactions = self._in_link_frames(wrenches)
            base_acceleration = state.base.true_acceleration(base_acceleration)
        return DynamicsResult(
            broadcast_result(qdd, state.batch),
            broadcast_result(efforts, state.batch),
            JointMotion(*state.joint_motion(joint_accelerations)),
            broadcast_result(base_acceleration, state.batch) if self.robot.moving_base else None,
            broadcast_result(reactions, state.batch, axes=2),
        )

    def equilibrium(
        self,
        q: ArrayLike,
        *,
        base: Base | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> Equilibrium:
        """Static equilibrium: unactuated joints come to rest, actuated joints hold their positions.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m]. Those of unactuated joints are where the search starts: they move downhill.
        base : Base, optional
            State of the base with zero twist, for a robot with a moving base only. Without acceleration the base is
            held at rest, with one it keeps this acceleration.
        external_wrenches : mapping of str to array_like, shape (..., 6), optional
            As `inverse`.

        Returns
        -------
        Equilibrium

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot.
        SingularModelError
            No equilibrium was found, or the loops do not close or are singular.

        Notes
        -----
        Source: Khalil, section 6, at rest.
        """
        state = self._state(q, np.zeros(len(self.joint_names)), base, external_wrenches)
        if np.any(state.base.twist):
            raise InvalidInputError("an equilibrium is at rest: leave the twist out of Base")
        acceleration = state.base.rest_acceleration if state.base.acceleration is None else state.base.acceleration
        stable = np.asarray(True)
        with np.errstate(all="ignore"):
            if self._unactuated:
                balance = find_equilibrium(
                    self.robot,
                    self._state_near,
                    state.constrained_state,
                    state.q[..., self._closure_solver.independent],
                    self._unactuated,
                    acceleration,
                    state.wrenches,
                )
                refuse_unbalanced(balance, self.unactuated_joint_names)
                state = replace(state, constrained_state=balance.constrained_state)
                stable = balance.is_stable
            rest = np.zeros_like(state.q)
            sweep = run_forward_pass(state.robot, state.chart_q, rest, np.zeros(6), state.wrenches)
            forces, wrenches = inverse_dynamics(state.robot, sweep, rest, acceleration)
            forces = forces + spring_force(self.robot, state.q, rest)
            efforts = state.constrained_state.projected(forces)
            efforts[..., self._unactuated] = 0
            if self.robot.loops:
                wrenches = compute_link_wrenches(state, rest, acceleration, forces)
        return Equilibrium(
            broadcast_result(state.q[..., self._closure_solver.independent], state.batch),
            broadcast_result(state.q, state.batch),
            broadcast_result(efforts, state.batch),
            broadcast_result(self._in_link_frames(wrenches), state.batch, axes=2),
            np.array(np.broadcast_to(stable, state.batch)),
        )

    def link_pose(self, name: str, q: ArrayLike, *, base: Base | None = None) -> Array:
        """Pose of a link frame in the world, which is frame 0 where the base is fixed.

        Parameters
        ----------
        name : str
            Name of a link or of another frame of the robot.
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].
        base : Base, optional
            State of the base, for a robot with a moving base only.

        Returns
        -------
        ndarray, shape (..., 4, 4)
            Homogeneous matrices [m].

        Raises
        ------
        InvalidInputError, SingularModelError
            As `inertia_matrix`.
        """
        return self.frame(name).pose(q, base=base)

    def frame(self, name: str) -> FrameKinematics:
        """Return the kinematics of a frame: pose, Jacobian, twist and acceleration.

        Parameters
        ----------
        name : str
            Name of a link or of another frame of the robot.

        Returns
        -------
        FrameKinematics

        Raises
        ------
        InvalidInputError
            The robot has no such frame.
        """
        return FrameKinematics(self, name)

    def _state_near(self, q: Array, joint_positions: Array) -> ConstrainedState:
        """Return the constrained state at positions q (..., n), near positions (..., all joints)."""
        seed = np.array(np.broadcast_to(joint_positions, (*q.shape[:-1], joint_positions.shape[-1])))
        seed[..., self._closure_solver.independent] = q
        try:
            return self._closure_solver.state_at(seed if self.robot.loops else q, name_sample=False)
        except SingularModelError as error:
            raise SingularModelError(f"no equilibrium was found: the unactuated joints move to where {error}") from None

    def _in_link_frames(self, wrenches: Array) -> Array:
        """Return wrenches (..., 1 + all joints, 6), given in frames j, in the link frames of the description."""
        in_link_frames = [
            wrench_to_antecedent(R, P, wrenches[..., j, :]) for j, (R, P) in enumerate(self._in_link_frame)
        ]
        return np.stack(in_link_frames, axis=-2)
