"""The trace of one model of a robot: its arguments as symbols, and the quantities that the models combine."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.codegen.trace.model_arguments import base_argument_names
from robot_dynamics.codegen.trace.preparation import prepare_robot
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.program_frames import choose_force_frames
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.constraints.attitude_charts import virtual_links
from robot_dynamics.constraints.constrained_state import charted_state_at, projection_matrix, state_at
from robot_dynamics.constraints.mixed_dynamics import solve_constrained_accelerations
from robot_dynamics.constraints.topology import build_topology
from robot_dynamics.model.inertia import Inertia, symmetric_matrix
from robot_dynamics.newton_euler.augmented import inverse_dynamics
from robot_dynamics.newton_euler.friction import (
    friction,
    has_load_friction,
    load_friction,
    load_growth,
    loads_from_net_efforts,
)
from robot_dynamics.newton_euler.joint_springs import spring_force
from robot_dynamics.newton_euler.screw import wrench_to_antecedent

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.constraints.topology import ConstraintTopology
    from robot_dynamics.model.robot import Robot

ZERO_SCREW = np.zeros(6, dtype=int)

CHART_MODELS = (
    "inverse",
    "direct",
    "inertia_matrix",
    "gravity",
    "coriolis",
    "bias",
    "friction",
    "pose",
    "frames",
    "state_derivative",
    "regressor",
    "jacobian",
    "jacobian_in_base_axes",
    "bias_acceleration",
    "bias_acceleration_in_base_axes",
    "centre_of_mass",
    "centroidal_momentum_matrix",
    "centroidal_momentum_bias",
    "kinetic_energy",
    "momentum",
    "inverse_derivatives",
    "direct_derivatives",
)
"""Models whose platforms move in charts of their attitudes.

Their results contain no rates of yaw, pitch and roll, or only in columns of parameters that are zero.
"""

MATRIX_FREE_MODELS = ("inverse", "gravity", "coriolis", "bias")
"""Models that do not need the matrix G from the rates of the independent joints to those of all joints."""

MATRIX_FREE_THRESHOLD = 2
"""Number of independent joints up to which G is formed in these models too."""


class ModelTrace:
    """A robot and a trace with the arguments of one model.

    Parameters
    ----------
    name : str
        Name of the model.
    robot : Robot
    arguments : sequence of str
        Names of the arguments with one entry for each independent joint.
    wrenches : sequence of str
        Links on which external wrenches act.
    prescribed_base : bool
        Whether the acceleration of a moving base is an argument.
    group_parameters : bool
        Whether inertial parameters are grouped into base parameters.
    prepare : bool
        Whether the robot is prepared by `prepare_robot`.
    frames : sequence of str
        Frames that the results name.
    independent : sequence of int or None
        Numbers of the independent joints; None for those of Dynamics.
    varied_links : sequence of int
        Links whose inertias are arguments, one (10,) for each: M, MX, MY, MZ, XX, XY, XZ, YY, YZ, ZZ.
    payloads : sequence of str
        Frames that carry payloads, whose inertias in these frames are arguments, one (10,) for each as above.

    Attributes
    ----------
    inputs : dict of str to array
        The arguments of the program, in order.
    q, qd : (all joints,)
        Positions and velocities of the prepared robot.
    force_robot : Robot
        The prepared robot in the units and frames in which forces are computed, with the same torques.
    force_q : (all joints,)
        Its positions.
    unactuated : tuple of int
        Indices of the independent joints that have no motor.
    base_is_free : bool
        Whether the acceleration of the base is unknown.
    base_acceleration : (6,)
        Of the base, minus gravity; zero where it is unknown.
    passive_efforts : (n,)
        Springs and friction of all joints, but for load-dependent friction, projected onto the independent joints.
    """

    def __init__(
        self,
        name: str,
        robot: Robot,
        arguments: Sequence[str],
        wrenches: Sequence[str] = (),
        prescribed_base: bool = False,
        group_parameters: bool = True,
        prepare: bool = True,
        frames: Sequence[str] = (),
        independent: Sequence[int] | None = None,
        varied_links: Sequence[int] = (),
        payloads: Sequence[str] = (),
    ) -> None:
        self.name = name
        self.trace = Trace()
        self.topology = topology_of(robot, independent)
        independent_joints = self.topology.independent
        self.size = len(independent_joints)
        self.unactuated = tuple(k for k, number in enumerate(independent_joints) if not robot.joints[number].actuated)
        self.inputs: dict[str, ScalarArray] = {key: self.trace.input(key, self.size) for key in arguments}
        named_links = {robot.frame(frame).link for frame in (*wrenches, *frames)}
        self._in_charts = name in CHART_MODELS and not virtual_links(robot) & named_links
        inertias = {number: self.trace.input(inertia_name(number), 10) for number in varied_links}
        loads = {frame: self.trace.input(payload_name(frame), 10) for frame in payloads}
        robot = with_payloads(with_inertias(robot, inertias), loads)
        self.robot = robot
        self._described_robot = robot
        self._joints = robot.joints
        self._has_load_friction = has_load_friction(robot)
        shifts = np.zeros(len(robot.joints))
        if prepare:
            charts = self.topology.attitudes if self._in_charts else ()
            self.robot, shifts = prepare_robot(robot, group_parameters, [chart.joints[0] for chart in charts])
        self._original_q = self._trace_positions(len(robot.joints))
        self._trace_motion(self._original_q + shifts, shifts)
        self._trace_base(base_argument_names(name, robot), prescribed_base)
        self.wrenches = self._trace_wrenches(wrenches)
        self.inputs.update({inertia_name(number): values for number, values in inertias.items()})
        self.inputs.update({payload_name(frame): values for frame, values in loads.items()})
        self.all_passive_efforts: ScalarArray = np.zeros(len(robot.joints), dtype=int)
        if "qd" in self.inputs:
            self.all_passive_efforts = self.passive_efforts_at(self.qd)
        self.passive_efforts = self.projected(self.all_passive_efforts)
        self.force_robot, shifts, self._length_unit = choose_force_frames(self.robot, has_wrenches=bool(wrenches))
        self.force_q = self.q + shifts
        self.pivot_results: dict[str, ScalarArray] = {}

    def _trace_positions(self, joints: int) -> ScalarArray:
        """Positions of all joints: functions of the independent ones, or all inputs where there are loops to close."""
        if self.topology.dependent:
            self.inputs["q"] = self.trace.input("q", joints)
            return self.inputs["q"]
        positions: ScalarArray = self.inputs["q"] @ self.topology.S.T + self.topology.offset
        return positions

    def _trace_motion(self, q: ScalarArray, shifts: ScalarArray) -> None:
        """Set the constrained state, and positions, velocities and drift accelerations of all joints."""
        solves = self.unactuated or self.robot.moving_base
        uses_G = (
            self.size <= MATRIX_FREE_THRESHOLD
            or self.name not in MATRIX_FREE_MODELS
            or (self.name == "inverse" and solves)
        )
        topology = self.topology.with_robot(self.robot, shifts)
        evaluate_state = charted_state_at if self._in_charts else state_at
        self.constrained_state = evaluate_state(topology, q, bool(uses_G))
        self.robot = self.constrained_state.robot
        self.q: ScalarArray = self.constrained_state.chart_q
        self.qd: ScalarArray = np.zeros(len(self.robot.joints), dtype=int)
        self.constraint_drift: ScalarArray | None = None
        if "qd" in self.inputs:
            self.qd = self.constrained_state.expand_rates(self.inputs["qd"])
            self.constraint_drift = self.constrained_state.constraint_drift(self.qd)

    def _trace_base(self, arguments: Sequence[str], prescribed_base: bool) -> None:
        """Set twist, gravity and acceleration (minus gravity) of the base, as far as they are known."""
        for name in (*arguments, *(["base_acceleration"] if prescribed_base else [])):
            self.inputs[name] = self.trace.input(name, 3 if name == "gravity" else 6)
        moves = self.robot.moving_base
        self.base_is_free = moves and not prescribed_base
        self.twist: ScalarArray = self.inputs.get("twist", ZERO_SCREW)
        gravity = self.inputs.get("gravity", ZERO_SCREW[:3]) if moves else self.robot.gravity
        self.gravity_screw: ScalarArray = np.concatenate([gravity, ZERO_SCREW[3:]])
        self.base_acceleration: ScalarArray = ZERO_SCREW
        if not self.base_is_free:
            self.base_acceleration = self.inputs.get("base_acceleration", 0) - self.gravity_screw

    def _trace_wrenches(self, names: Iterable[str]) -> dict[int, ScalarArray]:
        """Wrenches jf_e (6,) that links exert on their environment, by link number, in frame j.

        The arguments of the program have the opposite sign and are expressed in the named frames.
        """
        wrenches: dict[int, ScalarArray] = {}
        for name in names:
            frame = self.robot.frame(name)
            R, P = frame.placement[:3, :3], frame.placement[:3, 3]
            self.inputs[f"wrench on {name}"] = wrench = self.trace.input(f"wrench on {name}", 6)
            wrenches[frame.link] = wrenches.get(frame.link, 0) - wrench_to_antecedent(R, P, wrench)
        return wrenches

    def projected(self, forces: ScalarArray) -> ScalarArray:
        """Forces of all joints (all joints,) projected onto the independent joints (n,)."""
        projected: ScalarArray = self.constrained_state.projected(forces)
        return projected

    def joint_accelerations(self, qdd: ScalarArray) -> ScalarArray:
        """Accelerations of all joints (all joints,) from those of the independent ones (n,)."""
        accelerations: ScalarArray = self.constrained_state.expand_rates(qdd, self.constraint_drift)
        return accelerations

    @property
    def projection_matrix(self) -> ScalarArray:
        """G, with rows and columns of the identity for a moving base."""
        P: ScalarArray = projection_matrix(self.constrained_state.G, 6 if self.robot.moving_base else 0)
        return P

    def forces(self, qdd: ScalarArray, base_acceleration: ScalarArray) -> tuple[ScalarArray, ScalarArray]:
        """Forces of the tree (all joints,) and the wrench on the base (6,) at accelerations of independent joints."""
        return self.tree_forces(self.qd, self.joint_accelerations(qdd), base_acceleration)

    def tree_forces(
        self, qd: ScalarArray, accelerations: ScalarArray, base_acceleration: ScalarArray
    ) -> tuple[ScalarArray, ScalarArray]:
        """Forces of the tree (all joints,) and the wrench on the base (6,) at a motion (all joints,) of all joints."""
        if self._length_unit != 1:
            base_acceleration = np.concatenate([base_acceleration[:3] / self._length_unit, base_acceleration[3:]])
        forces, wrench = inverse_dynamics(
            self.force_robot, self.force_q, qd, accelerations, self.twist, base_acceleration, self.wrenches
        )
        return forces, wrench

    def passive_efforts_at(self, qd: ScalarArray) -> ScalarArray:
        """Efforts (all joints,) of springs, and of friction that does not depend on load, at velocities qd."""
        efforts: ScalarArray = friction(self._described_robot, qd)
        return efforts + spring_force(self._described_robot, self._original_q, qd)

    def load_friction_at(self, qd: ScalarArray, forces: ScalarArray) -> ScalarArray:
        """Load-dependent friction (all joints,) at velocities qd (all joints,) and forces of the tree (all joints,)."""
        if not self._has_load_friction:
            return np.zeros(len(self._joints), dtype=int)
        return load_friction(self._joints, qd, forces)

    def add_friction(self, forces: ScalarArray) -> ScalarArray:
        """Forces of the tree (all joints,) with passive efforts and load-dependent friction."""
        return forces + self.all_passive_efforts + self.load_friction_at(self.qd, forces)

    def loads(self, net_efforts: ScalarArray, numbers: Sequence[int], qd: ScalarArray | None = None) -> ScalarArray:
        """Loads of joints, by number, from their efforts less passive efforts; at other velocities of all joints."""
        joints = [self._joints[number] for number in numbers]
        return loads_from_net_efforts(joints, (self.qd if qd is None else qd)[list(numbers)], net_efforts)

    def load_growth(self, forces: ScalarArray) -> ScalarArray:
        """(n,) derivatives of efforts by loads; `forces` (n,) has loads of independent joints, or their signs."""
        if not self._has_load_friction:
            return np.ones(self.size, dtype=int)
        numbers = self.topology.independent
        return load_growth([self._joints[number] for number in numbers], self.qd[numbers], forces)

    def bias_rows(self, base_acceleration: ScalarArray) -> ScalarArray:
        """Efforts (m,) of the inverse model without joint accelerations; the wrench of a moving base comes first."""
        forces, wrench = self.forces(np.zeros(self.size, dtype=int), base_acceleration)
        forces = self.projected(forces)
        return np.concatenate([wrench, forces]) if self.robot.moving_base else forces

    def accelerations(
        self, unknown: Collection[int], known: ScalarArray, efforts: ScalarArray
    ) -> tuple[ScalarArray, ScalarArray]:
        """Accelerations of a free base and of joints of which the efforts are known.

        Parameters
        ----------
        unknown : collection of int
            Indices of the independent joints of which the accelerations are solved for.
        known : (n,)
            Accelerations of the others, zero for the unknown ones.
        efforts : (n,)
            Efforts without passive efforts; only those of unknown joints are read.

        Returns
        -------
        base_acceleration : (6,)
            Minus gravity.
        qdd : (n,)
        """
        forces, wrench = self.forces(known, self.base_acceleration)
        bias = np.concatenate([wrench, forces]) if self.base_is_free else forces
        zeros = np.zeros(self.size, dtype=int)
        # a base with prescribed acceleration has no rows in A
        matrix_robot = self.force_robot if self.base_is_free else replace(self.force_robot, moving_base=False)
        solution, pivots, diagonal = solve_constrained_accelerations(
            matrix_robot, self.constrained_state.G, self.force_q, unknown, zeros, efforts, bias
        )
        self.pivot_results = {"pivots": np.array(pivots, dtype=object), "diagonal": diagonal}
        first = len(solution) - self.size
        qdd = [solution[first + k] if k in unknown else known[k] for k in range(self.size)]
        base_acceleration = solution[:6] if self.base_is_free else self.base_acceleration
        return base_acceleration, np.array(qdd, dtype=object)

    def program(
        self,
        results: dict[str, ScalarArray],
        base_acceleration: ScalarArray | None = None,
        with_pivots: bool = False,
    ) -> Program:
        """The program of some results, with the acceleration of a free base (minus gravity, here) if it is passed."""
        if self.base_is_free and base_acceleration is not None:
            results["base_acceleration"] = base_acceleration + self.gravity_screw
        if with_pivots:
            results.update(self.pivot_results)
        return build_program(self.trace, self.name, {key: len(array) for key, array in self.inputs.items()}, results)


def inertia_name(number: int) -> str:
    """Name of the argument that has the inertia of a link."""
    return f"inertia of link {number}"


def payload_name(frame: str) -> str:
    """Name of the argument that has the inertia of the payload on a frame."""
    return f"payload on {frame}"


def with_inertias(robot: Robot, inertias: Mapping[int, ScalarArray]) -> Robot:
    """A robot with other inertias (10,) of some links: M, MX, MY, MZ, XX, XY, XZ, YY, YZ, ZZ."""
    links = list(robot.links)
    for number, values in inertias.items():
        links[number] = replace(links[number], inertia=_inertia_of(values))
    return replace(robot, links=tuple(links)) if inertias else robot


def with_payloads(robot: Robot, payloads: Mapping[str, ScalarArray]) -> Robot:
    """A robot that carries payloads, by the frame to which each is fixed: inertias (10,) in that frame, as above."""
    links = list(robot.links)
    for name, values in payloads.items():
        frame = robot.frame(name)
        carrier = links[frame.link]
        payload = _inertia_of(values).transformed_by(frame.placement)
        links[frame.link] = replace(carrier, inertia=carrier.inertia + payload)
    return replace(robot, links=tuple(links)) if payloads else robot


def _inertia_of(values: ScalarArray) -> Inertia:
    return Inertia(values[0], values[1:4], symmetric_matrix(*values[4:]))


def topology_of(robot: Robot, independent: Sequence[int] | None) -> ConstraintTopology:
    """The ConstraintTopology of a robot, with other independent joints if their numbers are passed."""
    topology: ConstraintTopology = build_topology(robot)
    if independent is not None:
        topology = topology.with_independent(independent)
    return topology
