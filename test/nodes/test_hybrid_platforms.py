"""Parallel modules in series over ROS 2: the field base has their platforms by name, the trajectory the joints that
no platform determines; results agree with multipliers on maximal coordinates."""

import numpy as np
import pytest
from geometry_msgs.msg import Transform
from nodes.service_requests import call_service, call_successfully, field, point, twist, twist_values
from peers.maximal_coordinates import MaximalCoordinates
from peers.planar_stack import planar_stack
from peers.platform_states import random_states
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import MultiDOFJointTrajectoryPoint

from robot_dynamics import Dynamics, load_robot
from robot_dynamics_interfaces.srv import DirectDynamics, InverseDynamics

COUNT = 3
TEXTS = {"hexapod_stack": {"robot_file": "hexapod_stack"}, "mounts": {"robot_description": planar_stack("mounts")}}
ROBOTS = {"hexapod_stack": load_robot("hexapod_stack"), "mounts": load_robot(planar_stack("mounts"))}


@pytest.fixture(scope="module", params=list(TEXTS))
def stack(request, start_module_server):
    """(server, Dynamics) of a robot with two modules."""
    return start_module_server(TEXTS[request.param]), Dynamics(ROBOTS[request.param], compiled=False)


def platform_points(links, states, accelerated):
    points = []
    for k in range(COUNT):
        platform_point = MultiDOFJointTrajectoryPoint(velocities=[twist(states.twists[link][k]) for link in links])
        for link in links:
            transform, pose = Transform(), states.poses[link][k]
            transform.translation.x, transform.translation.y, transform.translation.z = pose[:3, 3].tolist()
            turn = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
            transform.rotation.x, transform.rotation.y, transform.rotation.z, transform.rotation.w = turn
            platform_point.transforms.append(transform)
        if accelerated:
            platform_point.accelerations = [twist(states.accelerations[link][k]) for link in links]
        points.append(platform_point)
    return points


def told_of_others(dynamics, states, **more):
    """Trajectory points with what is told of joints that no platform places, nan for others; positions too."""
    places = [dynamics.joint_names.index(name) for name in dynamics.platform.other_joint_names]
    points = []
    for k in range(COUNT):
        fields = {}
        for field_name, values in zip(("positions", "velocities", "accelerations"), states.other_joints, strict=True):
            if places and not (field_name == "accelerations" and more):
                fields[field_name] = np.full(len(dynamics.joint_names), np.nan)
                fields[field_name][places] = values[k]
        points.append(point(k, **fields, **{key: values[k] for key, values in more.items()}))
    return points


def test_platform_motions_give_efforts_and_follow_from_them(client, stack):
    server, dynamics = stack
    states, robot = random_states(dynamics, COUNT, np.random.default_rng(6), reach=0.05), dynamics.robot
    links = list(reversed(robot.platform_links))
    request = InverseDynamics.Request()
    request.trajectory.joint_names, request.base.joint_names = list(dynamics.joint_names), links
    request.trajectory.points = told_of_others(dynamics, states)
    request.base.points = platform_points(links, states, accelerated=True)
    response = call_successfully(client, server, request)
    order = np.argsort([robot.joint_numbers[name] for name in response.trajectory.joint_names])
    q, qd, qdd, efforts = (
        field(response.trajectory, key)[:, order] for key in ("positions", "velocities", "accelerations", "effort")
    )
    assert list(response.base.joint_names) == list(robot.platform_links)
    peer = MaximalCoordinates(robot)
    for k in range(COUNT):
        expected = peer.direct(q[k], qd[k], efforts[k]).accelerations
        np.testing.assert_allclose(qdd[k], expected, rtol=0, atol=1e-8 * np.abs(expected).max())
        result = response.base.points[k]
        for column, link in enumerate(robot.platform_links):
            np.testing.assert_allclose(twist_values(result.velocities[column]), states.twists[link][k], atol=1e-9)
            acceleration = twist_values(result.accelerations[column])
            np.testing.assert_allclose(acceleration, states.accelerations[link][k], atol=1e-7)
            moved = result.transforms[column].translation
            np.testing.assert_allclose([moved.x, moved.y, moved.z], states.poses[link][k][:3, 3], atol=1e-10)

    back = DirectDynamics.Request()
    back.trajectory.joint_names = list(dynamics.joint_names)
    numbers = [robot.joint_numbers[name] for name in dynamics.joint_names]
    back.trajectory.points = told_of_others(dynamics, states, effort=efforts[:, numbers])
    back.base.points = platform_points(robot.platform_links, states, accelerated=False)
    result = call_successfully(client, server, back)
    for k in range(COUNT):
        for column, link in enumerate(robot.platform_links):
            acceleration = twist_values(result.base.points[k].accelerations[column])
            np.testing.assert_allclose(acceleration, states.accelerations[link][k], atol=1e-6)


def test_invalid_platform_requests_are_refused_and_the_node_goes_on(client, stack):
    server, dynamics = stack
    states = random_states(dynamics, COUNT, np.random.default_rng(6), reach=0.05)

    def call_with(names=(), links=dynamics.robot.platform_links, **fields):
        request = InverseDynamics.Request()
        request.trajectory.joint_names, request.base.joint_names = list(dynamics.joint_names), list(names)
        request.trajectory.points = [point(k, **fields) for k in range(COUNT)]
        request.base.points = platform_points(links, states, accelerated=True)
        return call_service(client, server, request)

    assert "base.joint_names are lower: each of" in call_with(names=["lower"]).message
    assert "base.joint_names are lower, lower: each of" in call_with(names=["lower", "lower"]).message
    assert "did you mean 'upper'" in call_with(names=["lower", "uper"]).message
    assert "has 1 entries: 2 are needed, of " in call_with(links=["lower"]).message
    refusal = call_with(velocities=np.ones(len(dynamics.joint_names))).message
    assert "base has the motion of the platform" in refusal and "points[0].velocities" in refusal
    assert call_with().success
