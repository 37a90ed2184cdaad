"""Programs of the rates of platforms: finite differences of the geometry, and the inverse of each other."""

import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("llvmlite")
from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.codegen.jit.compiled_program import compile_program
from robot_dynamics.parallel.platform_programs import motor_rates_program, platform_acceleration_program

pytestmark = pytest.mark.slow  # compiles models of all platforms that ship

PLATFORMS = [name for name in shipped_robots() if len(load_robot(name).platforms) == 1]
STEP = 1e-4  # of finite differences [s]


class Rates:
    """Both programs of a robot, and its Dynamics without programs."""

    def __init__(self, robot):
        self.dynamics = Dynamics(robot, compiled=False)
        self.motors = [robot.joint_numbers[name] for name in self.dynamics.joint_names]
        platform = self.dynamics.platform
        joints = robot.platforms[0].joints
        self.motor_rates = compile_program(motor_rates_program(platform._closure.solver.topology, joints, self.motors))
        self.acceleration = compile_program(
            platform_acceleration_program(self.dynamics._closure_solver.topology, joints)
        )


@pytest.fixture(scope="module", params=PLATFORMS)
def rates(request):
    return Rates(load_robot(request.param))


def moved(pose, twist, seconds):
    """The pose after a constant twist in its own frame."""
    screw = np.zeros((4, 4))
    screw[:3, :3] = np.cross(np.eye(3), twist[3:])
    screw[:3, 3] = twist[:3]
    return pose @ expm(seconds * screw)


def test_rates_of_the_motors_are_those_of_the_inverse_geometry(rates):
    rng = np.random.default_rng(0)
    platform = rates.dynamics.platform
    start = rates.dynamics.initial_joint_positions
    q = rates.dynamics.expand_positions(start[rates.motors] + 0.02 * rng.uniform(-1, 1, len(rates.motors)))
    pose = platform.pose(q)
    twist = platform.jacobian(q) @ rng.uniform(-0.3, 0.3, len(rates.motors))  # the legs allow it
    before, after = (
        platform.joint_positions(moved(pose, twist, seconds), seed=q)[rates.motors] for seconds in (-STEP, STEP)
    )
    acceleration = np.concatenate([np.cross(twist[3:], twist[:3]), np.zeros(3)])  # of the origin, at constant twist
    qd, qdd = rates.motor_rates.evaluate(q, twist, acceleration)
    np.testing.assert_allclose(qd, (after - before) / (2 * STEP), rtol=0, atol=1e-6 * np.abs(qd).max())
    differences = (after - 2 * q[rates.motors] + before) / STEP**2
    np.testing.assert_allclose(qdd, differences, rtol=0, atol=1e-4 * (np.abs(qd).max() + np.abs(qdd).max()))


def test_acceleration_of_the_platform_belongs_to_those_of_the_motors(rates):
    rng = np.random.default_rng(1)
    start = rates.dynamics.initial_joint_positions
    q = rates.dynamics.expand_positions(start[rates.motors] + 0.02 * rng.uniform(-1, 1, len(rates.motors)))
    qd, qdd = rng.uniform(-1, 1, (2, len(rates.motors)))
    acceleration = rates.acceleration.evaluate(q, qd, qdd)
    result = rates.dynamics.platform.acceleration(
        (q, rates.dynamics.expand_velocities(qd, q), rates.dynamics.expand_accelerations(qdd, q, qd))
    )
    np.testing.assert_allclose(acceleration, result, rtol=0, atol=1e-9 * (1 + np.abs(result).max()))
    twist = rates.dynamics.platform.jacobian(q) @ qd
    others = rates.dynamics.platform.other_joint_names  # the platform does not determine them
    legs = [column for column, name in enumerate(rates.dynamics.joint_names) if name not in others]
    back = rates.motor_rates.evaluate(q, twist, acceleration)
    for actual, expected in zip(back, (qd, qdd), strict=True):
        np.testing.assert_allclose(actual[legs], expected[legs], rtol=0, atol=1e-9)
