"""Regressor of all efforts on the independent joints, with platforms in the charts of their attitudes.

In a chart the links between the rotational joints of a platform move differently from rates of yaw, pitch and roll, to
which the parameters of these links and joints belong. A platform has a chart only where these parameters are zero:
their columns are the efforts that they would add. These grow with 1/cos² of pitch, and are zero where the rates of the
angles do not exist for every angular velocity.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.constraints import attitude_charts
from robot_dynamics.constraints.constrained_state import projection_matrix
from robot_dynamics.newton_euler.regressor import JOINT_PARAMETERS, LINK_PARAMETERS, regressor

if TYPE_CHECKING:
    from robot_dynamics.array_types import IntArray, ScalarArray
    from robot_dynamics.constraints.attitude_charts import AttitudeJoints
    from robot_dynamics.constraints.constrained_state import ConstrainedState
    from robot_dynamics.model.robot import Robot


def independent_regressor(
    constrained_state: ConstrainedState,
    qd: ScalarArray,
    qdd: ScalarArray,
    base_twist: ScalarArray,
    base_acceleration: ScalarArray,
) -> ScalarArray:
    """Regressor Y of the efforts on the independent joints.

    Parameters
    ----------
    constrained_state : ConstrainedState
    qd, qdd : ndarray, shape (..., all joints)
        As `ConstrainedState.expand_rates` returns them.
    base_twist, base_acceleration : ndarray, shape (..., 6)
        As for `regressor`.

    Returns
    -------
    ndarray, shape (..., n, p) or (..., 6 + n, p)
        With a moving base its wrench comes first. Columns are those of `parameter_names`.
    """
    robot = constrained_state.robot
    base = 6 if robot.moving_base else 0
    Y = regressor(robot, constrained_state.chart_q, qd, qdd, base_twist, base_acceleration)
    for attitude in constrained_state.attitudes:
        columns, values = _virtual_columns(constrained_state, attitude, qd, qdd, base_twist, base_acceleration)
        Y[..., columns] = values
    projected: ScalarArray = np.swapaxes(projection_matrix(constrained_state.G, base), -1, -2) @ Y
    return projected


def _virtual_columns(
    constrained_state: ConstrainedState,
    attitude: AttitudeJoints,
    qd: ScalarArray,
    qdd: ScalarArray,
    base_twist: ScalarArray,
    base_acceleration: ScalarArray,
) -> tuple[IntArray, ScalarArray]:
    """Columns of the virtual links of an attitude and of its joints.

    Returns their numbers (k,) and values (..., base + joints, k), rows along the coordinates of the charts.
    """
    topology = constrained_state.topology
    q = constrained_state.q
    others = [other for other in constrained_state.attitudes if other != attitude]
    robot, chart_q = attitude_charts.attach_charts(topology.robot, q, others, topology.offset)
    base = 6 if robot.moving_base else 0
    chart = [attitude], topology.offset, attitude_charts.divide_by_cosine_or_zero
    velocities = attitude_charts.joint_velocities(q, qd, *chart)
    accelerations = attitude_charts.joint_accelerations(q, velocities, qdd, *chart)
    links = [number + 1 for number in attitude.joints]
    Y = regressor(robot, chart_q, velocities, accelerations, base_twist, base_acceleration, links)
    numbers = np.concatenate([_column_numbers(robot, link) for link in links])
    # all columns of the virtual links and their joints, and of the last joint without the platform
    width = len(LINK_PARAMETERS) + len(JOINT_PARAMETERS)
    is_virtual = np.arange(len(numbers)) // width < len(links) - 1
    is_virtual[-len(JOINT_PARAMETERS) :] = True
    Y = Y[..., is_virtual]
    forces = np.swapaxes(Y[..., base:, :], -1, -2)
    forces = attitude_charts.chart_forces(q[..., None, :], forces, *chart)
    Y = np.concatenate([Y[..., :base, :], np.swapaxes(forces, -1, -2)], axis=-2)
    _, cosine = attitude_charts.pitch_sine_cosine(q, attitude, topology.offset)
    exists = np.asarray(attitude_charts.angle_rates_exist(cosine))
    return numbers[is_virtual], Y * exists[..., None, None]


def _column_numbers(robot: Robot, link: int) -> IntArray:
    """Numbers of the columns of a link and of the joint that moves it."""
    width = len(LINK_PARAMETERS) + len(JOINT_PARAMETERS)
    first = (len(LINK_PARAMETERS) if robot.moving_base else 0) + (link - 1) * width
    return first + np.arange(width)
