"""The models of a robot as straight-line programs, traced from the recursions of newton_euler.

Arguments and results are those of Dynamics without its checks:

- q, qd, qdd, efforts (n,) of the independent joints; q has all joints where the robot has loops, at positions that
  close them, as Dynamics.expand_positions returns them;
- of a moving base also `twist` (6,) and `gravity` (3,), both in the base frame, and `base_acceleration` (6,) where its
  motion is prescribed;
- external wrenches (6,), one argument for each link, in the frame of that name;
- payloads (10,), one argument for each frame that carries one: M, MX, MY, MZ, XX, XY, XZ, YY, YZ, ZZ of the payload in
  that frame.

The shapes below have n independent joints, and m = n, or n + 6 with a moving base.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.codegen.trace.derivative_models import direct_derivatives_model, inverse_derivatives_model
from robot_dynamics.codegen.trace.kinematic_models import (
    bias_acceleration_in_base_axes_model,
    bias_acceleration_model,
    centre_of_mass_model,
    centroidal_momentum_bias_model,
    centroidal_momentum_matrix_model,
    jacobian_in_base_axes_model,
    jacobian_model,
    kinetic_energy_model,
    pose_model,
)
from robot_dynamics.codegen.trace.model_trace import ZERO_SCREW, ModelTrace, topology_of
from robot_dynamics.codegen.trace.momentum_models import momentum_model
from robot_dynamics.codegen.trace.preparation import prepare_robot
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.constraints.charted_regressor import independent_regressor
from robot_dynamics.constraints.closure_step import newton_step
from robot_dynamics.newton_euler import composite
from robot_dynamics.newton_euler.friction import friction, has_load_friction, load_friction
from robot_dynamics.newton_euler.kinematics import link_placements, run_forward_pass
from robot_dynamics.newton_euler.screw import cross

if TYPE_CHECKING:
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.model.robot import Robot

__all__ = [
    "bias_acceleration_in_base_axes_model",
    "bias_acceleration_model",
    "bias_model",
    "centre_of_mass_model",
    "centroidal_momentum_bias_model",
    "centroidal_momentum_matrix_model",
    "closure_model",
    "coriolis_model",
    "direct_derivatives_model",
    "direct_model",
    "frames_model",
    "friction_model",
    "gravity_model",
    "inertia_matrix_model",
    "inverse_derivatives_model",
    "inverse_model",
    "jacobian_in_base_axes_model",
    "jacobian_model",
    "kinetic_energy_model",
    "momentum_model",
    "pose_model",
    "prepare_robot",
    "regressor_model",
    "state_derivative_model",
]


def inverse_model(
    robot: Robot,
    *,
    wrenches: Sequence[str] = (),
    prescribed_base: bool = False,
    with_pivots: bool = False,
    group_parameters: bool = True,
    payloads: Sequence[str] = (),
) -> Program:
    """The inverse dynamic model: q, qd, qdd -> efforts.

    Parameters
    ----------
    robot : Robot
    wrenches : sequence of str
        Links on which external wrenches act.
    prescribed_base : bool
        Whether the acceleration of a moving base is an argument.
    with_pivots : bool
        Whether `pivots` and `diagonal` (k,) are outputs too, where accelerations are solved for. The results are
        meaningless where a pivot is not positive, or is rounding beside its entry of the diagonal.
    group_parameters : bool
        Whether inertial parameters are grouped into base parameters.
    payloads : sequence of str
        Frames that carry payloads, whose inertias are arguments.

    Returns
    -------
    Program
        With the output `efforts` (n,). If there are unactuated joints, their qdd is not read and `accelerations` (n,)
        follows; if the base is free, `base_acceleration` (6,) follows.
    """
    model = ModelTrace(
        "inverse", robot, ("q", "qd", "qdd"), wrenches, prescribed_base, group_parameters, payloads=payloads
    )
    qdd = model.inputs["qdd"]
    unknown = model.unactuated
    is_known = np.array([0 if k in unknown else 1 for k in range(model.size)], dtype=int)
    qdd = qdd * is_known
    base_acceleration = model.base_acceleration
    if unknown or model.base_is_free:
        base_acceleration, qdd = model.accelerations(unknown, qdd, -model.passive_efforts)
    forces, _ = model.forces(qdd, base_acceleration)
    efforts = model.projected(model.add_friction(forces))
    results = {"efforts": efforts * is_known}
    if unknown:
        results["accelerations"] = qdd
    return model.program(results, base_acceleration, with_pivots)


def direct_model(
    robot: Robot,
    *,
    wrenches: Sequence[str] = (),
    prescribed_base: bool = False,
    with_pivots: bool = False,
    group_parameters: bool = True,
    varied_links: Sequence[int] = (),
    payloads: Sequence[str] = (),
) -> Program:
    """The direct dynamic model: q, qd, efforts -> accelerations.

    Parameters
    ----------
    robot, wrenches, prescribed_base, with_pivots, group_parameters, payloads
        See `inverse_model`.
    varied_links : sequence of int
        Links whose inertias are arguments, as ModelTrace has them.

    Returns
    -------
    Program
        With the output `accelerations` (n,), and `base_acceleration` (6,) if the base is free. They are not finite
        where nothing with inertia resists some motion.
    """
    model = ModelTrace(
        "direct",
        robot,
        ("q", "qd", "efforts"),
        wrenches,
        prescribed_base,
        group_parameters,
        varied_links=varied_links,
        payloads=payloads,
    )
    zeros = np.zeros(model.size, dtype=int)
    net_efforts = model.loads(model.inputs["efforts"] - model.passive_efforts, model.topology.independent)
    base_acceleration, qdd = model.accelerations(tuple(range(model.size)), zeros, net_efforts)
    return model.program({"accelerations": qdd}, base_acceleration, with_pivots)


def state_derivative_model(
    robot: Robot,
    *,
    wrenches: Sequence[str] = (),
    independent: Sequence[int] | None = None,
    group_parameters: bool = True,
    varied_links: Sequence[int] = (),
) -> Program:
    """The derivative of the state that a simulation integrates.

    q (all joints,), qd (n,), efforts (all joints,) -> velocities (all joints,), accelerations (n,) and, with a moving
    base, base_acceleration (6,).

    Parameters
    ----------
    robot, wrenches, group_parameters
        See `inverse_model`.
    independent : sequence of int or None
        Numbers of the joints to which qd and the accelerations belong; None for those of Dynamics.
    varied_links : sequence of int
        See `direct_model`.

    Returns
    -------
    Program

    Notes
    -----
    q need not close the loops to rounding: velocities and accelerations are smooth functions of it. Velocities of the
    yaw, pitch and roll of a platform are those of the chart of its attitude, as in constraints.attitude_charts.
    """
    model = ModelTrace(
        "state_derivative",
        robot,
        ("q", "qd", "efforts"),
        wrenches,
        group_parameters=group_parameters,
        independent=independent,
        varied_links=varied_links,
    )
    model.inputs["efforts"] = efforts = model.trace.input("efforts", len(robot.joints))
    net_efforts = model.projected(model.loads(efforts - model.all_passive_efforts, range(len(robot.joints))))
    zeros = np.zeros(model.size, dtype=int)
    base_acceleration, qdd = model.accelerations(tuple(range(model.size)), zeros, net_efforts)
    return model.program({"velocities": model.qd, "accelerations": qdd}, base_acceleration)


def inertia_matrix_model(
    robot: Robot,
    *,
    independent: Sequence[int] | None = None,
    group_parameters: bool = True,
    varied_links: Sequence[int] = (),
    payloads: Sequence[str] = (),
) -> Program:
    """q -> inertia_matrix (m, m), as Dynamics.inertia_matrix, of the joints `independent` (numbers) if passed.

    varied_links, payloads: see `direct_model`.
    """
    model = ModelTrace(
        "inertia_matrix",
        robot,
        ("q",),
        group_parameters=group_parameters,
        independent=independent,
        varied_links=varied_links,
        payloads=payloads,
    )
    P = model.projection_matrix
    return model.program({"inertia_matrix": P.T @ composite.inertia_matrix(model.force_robot, model.force_q) @ P})


def gravity_model(robot: Robot, *, group_parameters: bool = True, payloads: Sequence[str] = ()) -> Program:
    """q (and gravity (3,) in the frame of a moving base) -> gravity (m,), as Dynamics.gravity."""
    model = ModelTrace("gravity", robot, ("q",), group_parameters=group_parameters, payloads=payloads)
    return model.program({"gravity": model.bias_rows(-model.gravity_screw)})


def coriolis_model(robot: Robot, *, group_parameters: bool = True, payloads: Sequence[str] = ()) -> Program:
    """q, qd (and the twist (6,) of a moving base) -> coriolis (m,), as Dynamics.coriolis."""
    model = ModelTrace("coriolis", robot, ("q", "qd"), group_parameters=group_parameters, payloads=payloads)
    return model.program({"coriolis": model.bias_rows(ZERO_SCREW)})


def bias_model(robot: Robot, *, group_parameters: bool = True, payloads: Sequence[str] = ()) -> Program:
    """q, qd (twist, gravity) -> bias H (m,): the sum of gravity and Coriolis terms, without friction."""
    model = ModelTrace("bias", robot, ("q", "qd"), group_parameters=group_parameters, payloads=payloads)
    return model.program({"bias": model.bias_rows(-model.gravity_screw)})


def friction_model(robot: Robot, *, group_parameters: bool = True) -> Program:
    """q, qd -> friction (n,), as Dynamics.friction: of all joints, projected onto the independent ones.

    With load-dependent friction the twist and gravity of a moving base are arguments too.
    """
    model = ModelTrace("friction", robot, ("q", "qd"), group_parameters=group_parameters)
    efforts = friction(robot, model.qd)
    if has_load_friction(robot):
        loads, _ = model.forces(np.zeros(model.size, dtype=int), -model.gravity_screw)
        efforts = efforts + load_friction(robot.joints, model.qd, loads)
    return model.program({"friction": model.projected(efforts)})


def regressor_model(robot: Robot) -> Program:
    """q, qd, qdd (twist, gravity, base_acceleration) -> regressor (m, p), its columns as in newton_euler.regressor."""
    model = ModelTrace("regressor", robot, ("q", "qd", "qdd"), prescribed_base=robot.moving_base, prepare=False)
    qdd = model.joint_accelerations(model.inputs["qdd"])
    Y = independent_regressor(model.constrained_state, model.qd, qdd, model.twist, model.base_acceleration)
    return model.program({"regressor": Y})


def closure_model(robot: Robot, *, independent: Sequence[int] | None = None) -> Program:
    """One step of Newton's method that closes the loops, from the positions q of the joints that mimic no other.

    Parameters
    ----------
    robot : Robot
        A robot with loops.
    independent : sequence of int or None
        Numbers of the joints that stay where they are; None for those of Dynamics.

    Returns
    -------
    Program
        With the outputs `residual` (rows,) of the loops; `step` (k,) of the k dependent joints; `pivots` and
        `squared_norms` (k,), which reveal singular positions; `determinant_matrix` (k, k), of which the determinant is
        negative beyond them.
    """
    trace = Trace()
    topology = topology_of(robot, independent)
    prepared_robot, shifts = prepare_robot(robot, group_parameters=False)
    topology = topology.with_robot(prepared_robot, shifts).with_determinant_sign()
    size = len(topology.non_mimic_joints)
    names = ("residual", "step", "pivots", "squared_norms", "determinant_matrix")
    results = dict(zip(names, newton_step(topology, trace.input("q", size)), strict=True))
    return build_program(trace, "closure", {"q": size}, results)


def frames_model(robot: Robot, frames: Sequence[str], *, independent: Sequence[int] | None = None) -> Program:
    """The motion of named frames.

    q, qd (and the twist (6,) of a moving base) -> rotations (k, 3, 3), positions (k, 3) and velocities (k, 3) of the
    origins of k frames, all in frame 0.

    Parameters
    ----------
    robot : Robot
    frames : sequence of str
        Names of frames.
    independent : sequence of int or None
        Numbers of the joints to which qd belongs; None for those of Dynamics.

    Returns
    -------
    Program
    """
    model = ModelTrace("frames", robot, ("q", "qd"), group_parameters=False, frames=frames, independent=independent)
    placements = link_placements(model.robot, model.q)
    twists = run_forward_pass(model.robot, model.q, model.qd, model.twist, {}).velocities
    rotations, positions, velocities = [], [], []
    for frame in map(model.robot.frame, frames):
        R, P = placements[frame.link]
        offset = frame.placement[:3, 3]
        twist = twists[frame.link]
        rotations.append(R @ frame.placement[:3, :3])
        positions.append(P + R @ offset)
        velocities.append(R @ (twist[:3] + cross(twist[3:], offset)))
    results = {"rotations": rotations, "positions": positions, "velocities": velocities}
    return model.program({name: np.array(arrays, dtype=object) for name, arrays in results.items()})
