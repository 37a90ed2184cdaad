"""Models of one platform for one sample in machine code, where they are compiled.

Each method returns None where its program is not ready, where arguments do not fit, or where the program does not have
the result. The caller then takes the functions for many samples, which also say what is wrong. Nothing is imported
before it is needed: programs come from the cache in most processes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.constraints.closure_procedures import SampleProcedure, StepFunction
    from robot_dynamics.constraints.closure_solver import ClosureSolver
    from robot_dynamics.constraints.topology import ConstraintTopology


class CompiledPlatform:
    """Compiled models of one platform.

    Parameters
    ----------
    platform_solver : ClosureSolver
        With coordinates of the platform as independent joints.
    motor_solver : ClosureSolver
        With the n motors as independent joints.
    coordinate_joints : sequence of int
        Numbers of the joints of x, y, z, yaw, pitch and roll.
    has_rates : bool
        Whether the platform has an attitude chart, and no joints beside it.
    """

    def __init__(
        self,
        platform_solver: ClosureSolver,
        motor_solver: ClosureSolver,
        coordinate_joints: Sequence[int],
        has_rates: bool,
    ) -> None:
        self._by_platform = platform_solver.procedures
        self._by_motors = motor_solver.procedures
        self._has_rates = has_rates
        joints = tuple(coordinate_joints)
        motors = tuple(motor_solver.independent)
        driven = platform_solver.topology
        motor_topology = motor_solver.topology
        self._inverse_geometry = {
            has_seed: (f"inverse_geometry {joints} {has_seed}", partial(_make_inverse, driven, joints, has_seed))
            for has_seed in (False, True)
        }
        self._direct_geometry = [
            (f"direct_geometry {joints} {of_all}", partial(_make_direct, motor_topology, joints, of_all))
            for of_all in (True, False)
        ]
        self._motor_rates = f"motor_rates {joints} {motors}", partial(_trace_motor_rates, driven, joints, motors)
        self._acceleration = f"platform_acceleration {joints}", partial(_trace_acceleration, motor_topology, joints)

    def joint_positions(self, pose: object, seed: ArrayLike | None) -> Array | None:
        """Positions (all joints,) at a pose (4, 4) of float64, near a seed (all joints,) if there is one."""
        if not isinstance(pose, np.ndarray) or pose.shape != (4, 4):
            return None
        arguments = (pose.ravel(),) if seed is None else (pose.ravel(), seed)
        return self._by_platform.attempt_other(*self._inverse_geometry[seed is not None], *arguments)

    def pose(self, q: ArrayLike) -> Array | None:
        """Pose (4, 4) at positions (n,) or (all joints,) of float64."""
        for name, make_procedure in self._direct_geometry:
            pose = self._by_motors.attempt_other(name, make_procedure, q)
            if pose is not None:
                return pose
        return None

    def motor_rates(self, q: Array, twist: Array, acceleration: Array) -> tuple[Array, ...] | None:
        """Velocities and accelerations (n,) of the motors at q (all joints,), from those of the platform (6,)."""
        if not self._has_rates:
            return None
        return self._by_platform.evaluate_program(*self._motor_rates, q, twist, acceleration)

    def acceleration(self, q: Array, qd: Array, qdd: Array) -> Array | None:
        """Acceleration (6,) of the platform at q (all joints,), from rates qd and qdd (n,) of the motors."""
        results = self._by_motors.evaluate_program(*self._acceleration, q, qd, qdd)
        return None if results is None else results[0]


def _make_inverse(
    topology: ConstraintTopology, joints: Sequence[int], has_seed: bool, newton_step: StepFunction
) -> SampleProcedure:
    from robot_dynamics.parallel.sample_geometry import inverse_geometry

    return inverse_geometry(topology, joints, has_seed, newton_step)


def _make_direct(
    topology: ConstraintTopology, joints: Sequence[int], of_all_joints: bool, newton_step: StepFunction
) -> SampleProcedure:
    from robot_dynamics.parallel.sample_geometry import direct_geometry

    return direct_geometry(topology, joints, of_all_joints, newton_step)


def _trace_motor_rates(topology: ConstraintTopology, joints: Sequence[int], motors: Sequence[int]) -> Program:
    from robot_dynamics.parallel.platform_programs import motor_rates_program

    return motor_rates_program(topology, joints, motors)


def _trace_acceleration(topology: ConstraintTopology, joints: Sequence[int]) -> Program:
    from robot_dynamics.parallel.platform_programs import platform_acceleration_program

    return platform_acceleration_program(topology, joints)
