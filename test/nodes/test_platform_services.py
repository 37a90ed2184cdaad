"""A parallel robot over ROS 2: the field base has the motion of its platform, in requests and responses."""

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
        twists = [] if accelerations is None else [twist(accelerations[k])]
        point = MultiDOFJointTrajectoryPoint(
            transforms=[transform], velocities=[twist(TWISTS[k])], accelerations=twists
        )
        points.append(point)
    return points


def test_platform_motion_gives_efforts_and_follows_from_them(client, server):
    request = InverseDynamics.Request()
    request.trajectory.points = [JointTrajectoryPoint() for _ in POSES]
    request.base.points = platform_points(ACCELERATIONS)
    response = call_successfully(client, server, request)
    q, qd, qdd = DYNAMICS.platform.joint_motion(POSES, TWISTS, ACCELERATIONS)
    order = [DYNAMICS.robot.joint_numbers[name] for name in response.trajectory.joint_names]
    for name, expected in (("positions", q), ("velocities", qd), ("accelerations", qdd)):
        np.testing.assert_allclose(field(response.trajectory, name), expected[:, order], rtol=1e-8, atol=1e-8)
    efforts = DYNAMICS.platform.inverse(POSES, TWISTS, ACCELERATIONS)
    motors = len(DYNAMICS.joint_names)
    assert list(response.trajectory.joint_names[:motors]) == list(DYNAMICS.joint_names)
    np.testing.assert_allclose(field(response.trajectory, "effort")[:, :motors], efforts, rtol=1e-8, atol=1e-7)
    np.testing.assert_allclose(base_accelerations(response.base), ACCELERATIONS, atol=1e-8)
    assert response.base.joint_names == [DYNAMICS.robot.links[DYNAMICS.robot.platform.link].name]

    back = DirectDynamics.Request()
    back.trajectory.joint_names = list(DYNAMICS.joint_names)
    back.trajectory.points = [JointTrajectoryPoint(effort=values.tolist()) for values in efforts]
    back.base.points = platform_points()
    direct_response = call_service(client, server, back)
    if not direct_response.success:  # positions and velocities may not be left out where the joints are named
        raise AssertionError(direct_response.message)
    np.testing.assert_allclose(base_accelerations(direct_response.base), ACCELERATIONS, atol=1e-7)


def test_platform_poses_give_the_efforts_that_hold_it(client, server):
    request = StaticEquilibrium.Request()
    request.base.points = platform_points()  # and none of joints
    assert "velocities that are not zero: the platform is at rest" in call_service(client, server, request).message
    for point in request.base.points:
        point.velocities = []
    request.base.points[0].accelerations = [twist(ACCELERATIONS[0])]
    assert not call_service(client, server, request).success
    request.base.points[0].accelerations = []
    response = call_successfully(client, server, request)
    order = [DYNAMICS.robot.joint_numbers[name] for name in response.trajectory.joint_names]
    q = DYNAMICS.platform.joint_motion(POSES)[0]
    np.testing.assert_allclose(field(response.trajectory, "positions"), q[:, order], rtol=1e-8, atol=1e-8)
    holding_efforts = DYNAMICS.platform.inverse(
        POSES, np.zeros((5, 6)), np.zeros((5, 6))
    )  # efforts of no motion at all
    np.testing.assert_allclose(
        field(response.trajectory, "effort")[:, : holding_efforts.shape[1]], holding_efforts, rtol=1e-8, atol=1e-7
    )
    assert len(response.stable) == 5


def test_motion_of_the_platform_excludes_that_of_its_joints(client, server):
    request = InverseDynamics.Request()
    request.trajectory.points = [JointTrajectoryPoint(velocities=[1.0]) for _ in POSES]
    request.base.points = platform_points(ACCELERATIONS)
    assert "leave it empty" in call_service(client, server, request).message
    request.trajectory.points = [JointTrajectoryPoint() for _ in POSES]
    request.base.points = platform_points()
    assert "acceleration of the platform is needed" in call_service(client, server, request).message
