"""Motor positions that robots with loops reach: within limits, for parallel robots at poses of the platform."""

import numpy as np

from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.model.platform import COORDINATES

STRIDES = 6  # from the initial positions
ITERATIONS = 6


def limits_of(dynamics):
    """(2, n): lower and upper limits of the joints of a Dynamics, within ±2 where there are none."""
    limits = [dynamics.robot.joints[dynamics.robot.joint_numbers[name]].limits for name in dynamics.joint_names]
    bounds = np.array([(limit.lower, limit.upper) for limit in limits]).T
    return np.where(np.isfinite(bounds), bounds, [[-2.0], [2.0]])


def free_coordinates(robot):
    """(numbers of the joints that are the free coordinates of the platforms, their limits (2, f))."""
    numbers = [
        single_platform.joints[COORDINATES.index(name)]
        for single_platform in robot.platforms
        for name in single_platform.free
    ]
    limits = [robot.joints[number].limits for number in numbers]
    return numbers, np.array([(limit.lower, limit.upper) for limit in limits]).T


def closed_at_poses(dynamics, poses):
    """Positions (N, all joints) with the free coordinates of the platform at poses (N, f), loops closed from the
    initial positions by Newton's method with steps of least length."""
    robot, (numbers, _) = dynamics.robot, free_coordinates(dynamics.robot)
    moving = sorted(robot.joints_in_loops - {*numbers})
    q = np.tile(dynamics.initial_joint_positions, (len(poses), 1))
    start = q[:, numbers]
    for fraction in np.linspace(0, 1, STRIDES)[1:]:
        q[:, numbers] = start + fraction * (poses - start)
        for _ in range(ITERATIONS):
            equations = loop_equations(robot, q)
            inverse = np.linalg.pinv(equations.jacobian[..., moving], rcond=1e-9)
            q[:, moving] -= (inverse @ equations.residual[..., None])[..., 0]
    return q


def reachable(dynamics, count, rng):
    """(count, n) random positions of the joints of a Dynamics, within their limits; of a parallel robot the motors of
    the legs are where the platform is somewhere in its own limits."""
    q = rng.uniform(*limits_of(dynamics), (count, len(dynamics.joint_names)))
    robot = dynamics.robot
    if robot.platforms:
        _, limits = free_coordinates(robot)
        positions = closed_at_poses(dynamics, rng.uniform(*limits, (count, limits.shape[1])))
        for column, name in enumerate(dynamics.joint_names):
            if robot.joint_numbers[name] in robot.joints_in_loops:
                q[:, column] = positions[:, robot.joint_numbers[name]]
    return q
