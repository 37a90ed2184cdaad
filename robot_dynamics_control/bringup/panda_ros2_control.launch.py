"""A Panda under ros2_control: ros2 launch robot_dynamics_control panda_ros2_control.launch.py

The trajectory controller sends its references to the computed torque controller, which sends efforts to a simulated
robot. hardware:=mujoco takes MuJoCo (package mujoco_ros2_control) instead, without its window with headless:=true;
hardware:=mock takes mock_components, whose joints do not move under efforts.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

if TYPE_CHECKING:
    from launch import LaunchContext


def describe_robot(hardware: str, headless: str = "false") -> str:
    """Return the URDF of the robot with the tags of its hardware: "simulated", "mujoco" or "mock"."""
    config = Path(get_package_share_directory("robot_dynamics"), "config")
    bringup = Path(get_package_share_directory("robot_dynamics_control"), "bringup")
    if hardware == "mock":
        tags = (config / "ros2_control" / "panda_mock.xml").read_text()
    else:
        tags = (bringup / f"panda_{hardware}.ros2_control.xml").read_text()
    tags = tags.removeprefix('<?xml version="1.0"?>')
    tags = tags.replace("{mujoco_model}", str(bringup / "panda_mujoco.xml")).replace("{headless}", headless)
    return (config / "robots" / "panda.urdf").read_text().replace("</robot>", f"{tags}</robot>")


def nodes(context: LaunchContext) -> list[Node]:
    """Return the controller manager and what it needs."""
    hardware = LaunchConfiguration("hardware").perform(context)
    description = describe_robot(hardware, LaunchConfiguration("headless").perform(context))
    controllers = LaunchConfiguration("controllers").perform(context)
    is_mujoco = hardware == "mujoco"
    clock = {"use_sim_time": is_mujoco}
    # one spawner that waits for each: the chained controller must be there before the one that uses its interfaces
    names = ["joint_state_broadcaster", "computed_torque_controller", "joint_trajectory_controller"]
    return [
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            parameters=[{"robot_description": description}, clock],
        ),
        Node(
            package="mujoco_ros2_control" if is_mujoco else "controller_manager",
            executable="ros2_control_node",
            parameters=[controllers, clock],
            output="screen",
        ),
        Node(
            package="controller_manager",
            executable="spawner",
            arguments=[*names, "--param-file", controllers],
            output="screen",
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the nodes and the arguments."""
    shipped = Path(get_package_share_directory("robot_dynamics_control"), "bringup", "panda_controllers.yaml")
    return LaunchDescription(
        [
            DeclareLaunchArgument("hardware", default_value="simulated", choices=["simulated", "mujoco", "mock"]),
            DeclareLaunchArgument("headless", default_value="false", description="MuJoCo without its window"),
            DeclareLaunchArgument("controllers", default_value=str(shipped), description="YAML of the controllers"),
            OpaqueFunction(function=nodes),
        ]
    )
