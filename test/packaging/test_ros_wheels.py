"""Nodes from wheels alone: an environment without compiler, checkout or installed ROS."""

import json
import subprocess
import time

import pytest

CLIENT = """
import json, rclpy
from robot_dynamics import Dynamics, load_robot
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics_interfaces.srv import InverseDynamics
from trajectory_msgs.msg import JointTrajectoryPoint

rclpy.init()
client = ServiceClient("wheel_client")
dynamics = Dynamics(load_robot("panda"))
q, qd, qdd = [0.1, -0.3, 0.2, -2.2, 0.1, 1.9, 0.8], [0.5] * 7, [1.0] * 7
request = InverseDynamics.Request()
request.trajectory.joint_names = list(dynamics.joint_names)
request.trajectory.points = [JointTrajectoryPoint(positions=q, velocities=qd, accelerations=qdd)]
response = client.call(InverseDynamics, "/dynamics_server/inverse_dynamics", request, timeout=60.0)
efforts = response.trajectory.points[0].effort if response.success else []
print(json.dumps([response.success, list(efforts), dynamics.inverse(q, qd, qdd).tolist()]))
client.close()
rclpy.shutdown()
"""


def test_server_responds(with_ros, tmp_path):
    command = [str(with_ros.folder / "bin" / "dynamics_server"), "--ros-args", "-p", "robot_file:=panda"]
    log = (tmp_path / "log").open("w")
    server = subprocess.Popen(command, cwd=tmp_path, env=with_ros.variables(tmp_path), stdout=log, stderr=log)
    try:
        done = with_ros.run("python", "-c", CLIENT, scratch=tmp_path)
        assert done.returncode == 0, (done.stderr, (tmp_path / "log").read_text())
        success, efforts, expected = json.loads(done.stdout.splitlines()[-1])
        assert success and efforts == pytest.approx(expected, abs=1e-9) and abs(efforts[1]) > 1
    finally:
        server.terminate()
        server.wait(timeout=30)
    assert server.returncode in (0, -15)


@pytest.mark.parametrize(
    "name",
    ["computed_torque", "contact_monitor", "joint_state_completer", "mobile_base_simulator", "replay_check"],
)
def test_node_starts_and_ends(with_ros, tmp_path, name):
    helped = with_ros.run(name, "--help", scratch=tmp_path)
    assert helped.returncode == 0 and "robot_file" in helped.stdout, helped
    command = [str(with_ros.folder / "bin" / name), "--ros-args", "-p", "robot_file:=panda"]
    with (tmp_path / "log").open("w") as log:
        node = subprocess.Popen(command, cwd=tmp_path, env=with_ros.variables(tmp_path), stdout=log, stderr=log)
        deadline = time.monotonic() + 60
        while "serving Robot('panda'" not in (tmp_path / "log").read_text() and time.monotonic() < deadline:
            assert node.poll() is None, (tmp_path / "log").read_text()
            time.sleep(0.2)
        node.terminate()
        node.wait(timeout=30)
    assert "serving Robot('panda'" in (tmp_path / "log").read_text() and node.returncode in (0, -15)


def test_message_types_are_listed_for_ros(with_ros):
    share = with_ros.folder / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / "robot_dynamics_interfaces").is_file()
    names = {path.stem for path in (share / "robot_dynamics_interfaces" / "srv").glob("*.srv")}
    assert names >= {
        "InverseDynamics",
        "DirectDynamics",
        "DynamicsTerms",
        "StaticEquilibrium",
        "NaturalFrequencies",
        "FrameKinematics",
    }
