"""The rates of all joints at positions that close the loops, as a straight-line program."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_dynamics.codegen.trace.preparation import prepare_robot
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.constraints.constrained_state import charted_state_at

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.constraints.constrained_state import ConstrainedState
    from robot_dynamics.constraints.topology import ConstraintTopology


def joint_rates_program(topology: ConstraintTopology) -> Program:
    """q (all joints,), qd (n,) of the independent joints -> rates (all joints,), as `ConstrainedState.expand_rates`."""
    inputs = {"q": len(topology.robot.joints), "qd": len(topology.independent)}
    trace = Trace()
    q, qd = (trace.input(name, size) for name, size in inputs.items())
    return build_program(trace, "joint_rates", inputs, {"rates": symbolic_state(topology, q).expand_rates(qd)})


def symbolic_state(topology: ConstraintTopology, q: ScalarArray) -> ConstrainedState:
    """The constrained state at symbols q (all joints,), of the robot in frames with the fewest numbers."""
    robot, shifts = prepare_robot(topology.robot, group_parameters=False)
    return charted_state_at(topology.with_robot(robot, shifts), q + shifts, uses_G=False)
