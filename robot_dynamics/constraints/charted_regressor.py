"""The regressor of all efforts on the independent joints, with platforms in the charts of their attitudes.

In a chart the links between the turning joints of a platform move otherwise than by rates of yaw, pitch and roll, to
which their parameters and those of these joints belong. The platform has a chart only where these parameters are zero:
their columns say what they would add if they were not. They grow with 1/cos² of pitch, and are zero where the rates of
the angles do not exist for every angular velocity.
"""

import numpy as np

from robot_dynamics.constraints import attitude_charts
from robot_dynamics.constraints.state import projection_matrix
from robot_dynamics.newton_euler.regressor import JOINT_PARAMETERS, LINK_PARAMETERS, regressor


def independent_regressor(constrained_state, qd, qdd, base_twist, base_acceleration):
    """Y of efforts on the independent joints at a Configuration.

    Parameters
    ----------
    configuration : Configuration
    qd, qdd : ndarray
        (..., all joints), as `Configuration.rates` gives them.
    base_twist, base_acceleration : ndarray
        (..., 6), as for `regressor`.

    Returns
    -------
    ndarray
        (..., n, p), or (..., 6 + n, p) with a moving base, whose wrench comes first. Columns are those of
        `parameter_names`.
    """
    robot = constrained_state.robot
    base = 6 if robot.moving_base else 0
    Y = regressor(robot, constrained_state.chart_q, qd, qdd, base_twist, base_acceleration)
    for one in constrained_state.attitudes:
        columns, virtual = _virtual_columns(constrained_state, one, qd, qdd, base_twist, base_acceleration)
        Y[..., columns] = virtual
    return np.swapaxes(projection_matrix(constrained_state.G, base), -1, -2) @ Y


def _virtual_columns(constrained_state, one, qd, qdd, base_twist, base_acceleration):
    """(numbers of columns, columns (..., base + joints, k)) of the virtual links of an Attitude and of its joints, rows
    along the coordinates of the charts."""
    coupling, q = constrained_state.topology, constrained_state.q
    others = [other for other in constrained_state.attitudes if other != one]
    robot, local = attitude_charts.attach_charts(coupling.robot, q, others, coupling.offset)
    base, chart = 6 if robot.moving_base else 0, ([one], coupling.offset, attitude_charts.divide_by_cosine_or_zero)
    velocities = attitude_charts.joint_velocities(q, qd, *chart)
    accelerations = attitude_charts.joint_accelerations(q, velocities, qdd, *chart)
    links = [number + 1 for number in one.joints]
    Y = regressor(robot, local, velocities, accelerations, base_twist, base_acceleration, links)
    numbers = np.concatenate([_columns_of(robot, link) for link in links])
    own = (
        np.arange(len(numbers)) // (len(LINK_PARAMETERS) + len(JOINT_PARAMETERS)) < len(links) - 1
    )  # of virtual links, or their joints
    own[-len(JOINT_PARAMETERS) :] = True
    Y, numbers = Y[..., own], numbers[own]
    forces = np.swapaxes(Y[..., base:, :], -1, -2)
    forces = attitude_charts.chart_forces(q[..., None, :], forces, *chart)
    Y = np.concatenate([Y[..., :base, :], np.swapaxes(forces, -1, -2)], axis=-2)
    existing = attitude_charts.angle_rates_exist(attitude_charts.pitch_sine_cosine(q, one, coupling.offset)[1])
    return numbers, Y * np.asarray(existing)[..., None, None]


def _columns_of(robot, link):
    """Numbers of the columns of a link that a joint moves, and of this joint."""
    width = len(LINK_PARAMETERS) + len(JOINT_PARAMETERS)
    return (len(LINK_PARAMETERS) if robot.moving_base else 0) + (link - 1) * width + np.arange(width)
