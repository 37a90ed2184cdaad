"""A parallel robot over ROS 2: the state of its platform in the field base tells the motion, and comes back."""

import numpy as np
import pytest
from geometry_msgs.msg import Transform
from nodes.service_requests import base_accelerations, call_service, call_successfully, field, twist
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import JointTrajectoryPoint, MultiDOFJointTrajectoryPoint

from robot_dynamics import Dynamics, load_robot
from robot_dynamics_interfaces.srv import DirectDynamics, InverseDynamics, StaticEquilibrium

DYNAMICS = Dynamics(load_robot("gough_stewart"), compiled=False)
START = DYNAMICS.platform.pose(DYNAMICS.initial_joint_positions)
RNG = np.random.default_rng(2)
POSES = np.array([START @ np.block([[Rotation.from_rotvec(RNG.uniform(-0.1, 0.1, 3)).as_matrix(), np.zeros((3, 1))],
                                    [np.zeros((1, 3)), np.ones((1, 1))]]) for _ in range(5)])  # fmt: skip
POSES[:, :3, 3] += RNG.uniform(-0.03, 0.03, (5, 3))
TWISTS, ACCELERATIONS = RNG.uniform(-0.3, 0.3, (2, 5, 6))


@pytest.fixture(scope="module")
def server(start_module_server):
    return start_module_server({"robot_file": "gough_stewart"})


def platform_points(accelerations=None):
    points = []
    for k, pose in enumerate(POSES):
        transform = Transform()
        transform.translation.x, transform.translation.y, transform.translation.z = pose[:3, 3].tolist()
        quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
        transform.rotation.x, transform.rotation.y, transform.rotation.z, transform.rotation.w = quaternion
        told = [] if accelerations is None else [twist(accelerations[k])]
        point = MultiDOFJointTrajectoryPoint(transforms=[transform], velocities=[twist(TWISTS[k])], accelerations=told)
        points.append(point)
    return points


def test_motion_of_the_platform_asks_for_efforts_and_comes_back_from_them(client, server):
    request = InverseDynamics.Request()
    request.trajectory.points = [JointTrajectoryPoint() for _ in POSES]
    request.base.points = platform_points(ACCELERATIONS)
    answer = call_successfully(client, server, request)
    q, qd, qdd = DYNAMICS.platform.joint_motion(POSES, TWISTS, ACCELERATIONS)
    order = [DYNAMICS.robot.joint_numbers[name] for name in answer.trajectory.joint_names]
    for name, expected in (("positions", q), ("velocities", qd), ("accelerations", qdd)):
        np.testing.assert_allclose(field(answer.trajectory, name), expected[:, order], rtol=1e-8, atol=1e-8)
    efforts = DYNAMICS.platform.inverse(POSES, TWISTS, ACCELERATIONS)
    motors = len(DYNAMICS.joint_names)
    assert list(answer.trajectory.joint_names[:motors]) == list(DYNAMICS.joint_names)
    np.testing.assert_allclose(field(answer.trajectory, "effort")[:, :motors], efforts, rtol=1e-8, atol=1e-7)
    np.testing.assert_allclose(base_accelerations(answer.base), ACCELERATIONS, atol=1e-8)
    assert answer.base.joint_names == [DYNAMICS.robot.links[DYNAMICS.robot.platform.link].name]

    back = DirectDynamics.Request()
    back.trajectory.joint_names = list(DYNAMICS.joint_names)
    back.trajectory.points = [JointTrajectoryPoint(effort=values.tolist()) for values in efforts]
    back.base.points = platform_points()
    found = call_service(client, server, back)
    if not found.success:  # positions and velocities may not be left out where the joints are named
        raise AssertionError(found.message)
    np.testing.assert_allclose(base_accelerations(found.base), ACCELERATIONS, atol=1e-7)


def test_poses_of_the_platform_ask_for_the_efforts_that_hold_it(client, server):
    request = StaticEquilibrium.Request()
    request.base.points = platform_points()  # and none of joints
    assert "velocities that are not zero: the platform is at rest" in call_service(client, server, request).message
    for point in request.base.points:
        point.velocities = []
    request.base.points[0].accelerations = [twist(ACCELERATIONS[0])]
    assert not call_service(client, server, request).success
    request.base.points[0].accelerations = []
    answer = call_successfully(client, server, request)
    order = [DYNAMICS.robot.joint_numbers[name] for name in answer.trajectory.joint_names]
    q = DYNAMICS.platform.joint_motion(POSES)[0]
    np.testing.assert_allclose(field(answer.trajectory, "positions"), q[:, order], rtol=1e-8, atol=1e-8)
    held = DYNAMICS.platform.inverse(POSES, np.zeros((5, 6)), np.zeros((5, 6)))  # efforts of no motion at all
    np.testing.assert_allclose(field(answer.trajectory, "effort")[:, : held.shape[1]], held, rtol=1e-8, atol=1e-7)
    assert len(answer.stable) == 5


def test_what_the_base_tells_is_not_told_twice(client, server):
    request = InverseDynamics.Request()
    request.trajectory.points = [JointTrajectoryPoint(velocities=[1.0]) for _ in POSES]
    request.base.points = platform_points(ACCELERATIONS)
    assert "leave it empty" in call_service(client, server, request).message
    request.trajectory.points = [JointTrajectoryPoint() for _ in POSES]
    request.base.points = platform_points()
    assert "acceleration of the platform is needed" in call_service(client, server, request).message
