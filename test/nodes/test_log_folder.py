"""Where the folder of ROS logs cannot be written, executables start all the same, and say where the logs are."""

import os
import subprocess
import sys

import pytest

MESSAGE = "ROS logs are in "


def run(variables, *command):
    environment = {name: value for name, value in os.environ.items() if name not in ("ROS_LOG_DIR", "ROS_HOME", "HOME")}
    return subprocess.run(
        [sys.executable, "-c", *command],
        env=environment | variables,
        capture_output=True,
        text=True,
        timeout=120,
    )


INIT = """
import rclpy
from robot_dynamics.nodes.log_folder import ensure_log_folder
ensure_log_folder()
rclpy.init()
rclpy.create_node("probe").get_logger().info("alive")
"""


@pytest.mark.parametrize("variables", [{"HOME": "/proc/none"}, {"ROS_LOG_DIR": "/proc/none"}, {"HOME": ""}, {}])
def test_a_node_starts_without_a_folder_for_its_logs(variables):
    done = run(variables, INIT)
    assert done.returncode == 0 and "alive" in done.stderr, done.stderr
    assert done.stderr.startswith(MESSAGE)


@pytest.mark.parametrize(("name", "folder"), [("HOME", ".ros/log"), ("ROS_HOME", "log"), ("ROS_LOG_DIR", "")])
def test_logs_are_where_ros_writes_them(name, folder, tmp_path):
    done = run({name: str(tmp_path)}, INIT)
    assert done.returncode == 0 and MESSAGE not in done.stderr
    assert [path.name for path in (tmp_path / folder).iterdir() if path.suffix == ".log"]
