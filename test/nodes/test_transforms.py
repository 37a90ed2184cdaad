"""/tf, with a tf2_msgs of the same definition where the real one is missing: made here, by the tools of ROS."""

import importlib.util
import os
import subprocess
import sys

import pytest
from nodes.built_interfaces import build_interfaces

from robot_dynamics.nodes.processes import running_node

PACKAGE = """<?xml version="1.0"?><package format="3"><name>tf2_msgs</name><version>0.0.0</version>
<description>For tests</description><maintainer email="nobody@example.org">nobody</maintainer><license>BSD</license>
<buildtool_depend>ament_cmake</buildtool_depend><buildtool_depend>rosidl_default_generators</buildtool_depend>
<depend>geometry_msgs</depend><exec_depend>rosidl_default_runtime</exec_depend>
<member_of_group>rosidl_interface_packages</member_of_group>
<export><build_type>ament_cmake</build_type></export></package>"""
CMAKE = """cmake_minimum_required(VERSION 3.20)
project(tf2_msgs)
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(${PROJECT_NAME} "msg/TFMessage.msg" DEPENDENCIES geometry_msgs)
ament_package()
"""
LISTENER = """
import sys, time, rclpy
from tf2_msgs.msg import TFMessage
rclpy.init()
node, heard = rclpy.create_node("listener"), []
node.create_subscription(TFMessage, "/tf", heard.append, 100)
until = time.monotonic() + 60
while not heard and time.monotonic() < until:
    rclpy.spin_once(node, timeout_sec=0.1)
for transform in heard[-1].transforms:
    t, r = transform.transform.translation, transform.transform.rotation
    print(transform.header.frame_id, transform.child_frame_id, t.x, t.y, t.z, r.x, r.y, r.z, r.w)
rclpy.shutdown()
"""


@pytest.fixture(scope="module")
def tf2(tmp_path_factory):
    """The environment in which tf2_msgs can be imported: as it is, or with one that is made now."""
    if importlib.util.find_spec("tf2_msgs") is not None:
        return {}
    source, prefix = tmp_path_factory.mktemp("tf2_msgs"), tmp_path_factory.mktemp("prefix")
    (source / "msg").mkdir()
    (source / "msg" / "TFMessage.msg").write_text("geometry_msgs/TransformStamped[] transforms\n")
    (source / "package.xml").write_text(PACKAGE)
    (source / "CMakeLists.txt").write_text(CMAKE)
    return build_interfaces(source, source / "build", prefix)


def test_pose_of_the_base_is_published_on_tf(tf2):
    parameters = {"robot_file": "free_flying_arm", "initial.pose": [1.0, -2.0, 3.0, 0.0, 0.0, 0.6, 0.8]}
    parameters.update({"gravity": [0.0, 0.0, 0.0], "odom_frame": "world", "base_frame": "satellite"})
    with running_node("mobile_base_simulator", parameters, environment=tf2):
        messages = subprocess.run(
            [sys.executable, "-c", LISTENER], env={**os.environ, **tf2}, capture_output=True, text=True, timeout=90
        )
    assert messages.returncode == 0, messages.stderr
    world, base, *numbers = messages.stdout.split()
    assert (world, base) == ("world", "satellite")
    assert list(map(float, numbers)) == pytest.approx([1.0, -2.0, 3.0, 0.0, 0.0, 0.6, 0.8], abs=1e-12)
