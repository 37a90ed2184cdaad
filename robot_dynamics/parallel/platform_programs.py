"""Straight-line programs of the rates of a platform and its motors, at positions that close the legs.

They are traced from ConstrainedState and ChartRates, for platforms that have an attitude chart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.codegen.trace.joint_rates import symbolic_state
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.parallel.platform_motion import ChartRates

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.constraints.topology import ConstraintTopology


def motor_rates_program(
    topology: ConstraintTopology, coordinate_joints: Sequence[int], motors: Sequence[int]
) -> Program:
    """q (all joints,), twist (6,), acceleration (6,) of the platform -> qd, qdd (motors,), as `joint_motion`.

    Parameters
    ----------
    topology : ConstraintTopology
        With coordinates of the platform as independent joints, and no others.
    coordinate_joints : sequence of int
        Numbers of the joints of x, y, z, yaw, pitch and roll.
    motors : sequence of int
        Numbers of the joints whose rates are computed.
    """
    joints = len(topology.robot.joints)
    inputs = {"q": joints, "twist": 6, "acceleration": 6}
    trace = Trace()
    q, twist, acceleration = (trace.input(name, size) for name, size in inputs.items())
    state = symbolic_state(topology, q)
    coordinates = list(coordinate_joints)
    x = q[coordinates]
    rates = state.complete_rates(_embed(ChartRates.rates(x, twist), coordinates, joints))
    derivatives = ChartRates.rate_derivatives(x, rates[coordinates], acceleration)
    rate_derivatives = state.complete_rates(_embed(derivatives, coordinates, joints), state.constraint_drift(rates))
    results = {"qd": rates[list(motors)], "qdd": rate_derivatives[list(motors)]}
    return build_program(trace, "motor_rates", inputs, results)


def platform_acceleration_program(topology: ConstraintTopology, coordinate_joints: Sequence[int]) -> Program:
    """q (all joints,), qd, qdd (n,) of the independent joints -> acceleration (6,) of the platform.

    topology: of the robot, with its motors as independent joints; coordinate_joints: as for `motor_rates_program`.
    """
    size = len(topology.independent)
    inputs = {"q": len(topology.robot.joints), "qd": size, "qdd": size}
    trace = Trace()
    q, qd, qdd = (trace.input(name, count) for name, count in inputs.items())
    state = symbolic_state(topology, q)
    rates = state.expand_rates(qd)
    rate_derivatives = state.expand_rates(qdd, state.constraint_drift(rates))
    coordinates = list(coordinate_joints)
    acceleration = ChartRates.acceleration(q[coordinates], rates[coordinates], rate_derivatives[coordinates])
    return build_program(trace, "platform_acceleration", inputs, {"acceleration": acceleration})


def _embed(values: ScalarArray, columns: Sequence[int], size: int) -> ScalarArray:
    """(size,) values in some columns, zero elsewhere."""
    embedded: ScalarArray = np.zeros(size, dtype=object)
    embedded[list(columns)] = values
    return embedded
