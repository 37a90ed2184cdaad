"""The command lines of nodes: help, and arguments that are refused with one line."""

import subprocess
import sys


def test_command_line_has_help_and_refuses_unknown_arguments():
    command = [sys.executable, "-m", "robot_dynamics.nodes.dynamics_server"]
    helped = subprocess.run([*command, "--help"], capture_output=True, text=True, timeout=180)
    assert helped.returncode == 0 and "robot_file:=panda" in helped.stdout
    for wrong in (["panda"], ["-p", "robot_file:=panda"], ["--ros-args", "-p", "robot_file"]):
        refused = subprocess.run([*command, *wrong], capture_output=True, text=True, timeout=180)
        assert refused.returncode != 0 and wrong[-1] in refused.stderr and "Traceback" not in refused.stderr


def test_node_refuses_invalid_parameters_at_start():
    for node, wrong in (("computed_torque", "kp:=[-5.0]"), ("mobile_base_simulator", "step:=-0.1")):
        command = [sys.executable, "-m", f"robot_dynamics.nodes.{node}", "--ros-args", "-p", wrong]
        refused = subprocess.run(command, capture_output=True, text=True, timeout=180)
        assert refused.returncode == 1 and f"parameter {wrong.split(':')[0]} is" in refused.stderr
        assert "Traceback" not in refused.stderr
