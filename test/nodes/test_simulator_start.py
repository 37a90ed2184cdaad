"""The initial state of a simulated robot: within the limits of its description, else with a warning."""

import time

import numpy as np
import pytest
from peers.real_robots import real_urdf

from robot_dynamics import load_robot
from robot_dynamics.nodes.mobile_base_simulator.parameters import PARAMETERS
from robot_dynamics.nodes.mobile_base_simulator.simulation_setup import build_simulation, joint_limit_warnings
from robot_dynamics.nodes.processes import running_node
from robot_dynamics.simulation import Simulation

from .simulator_probe import SimulatorProbe

SLIDE = """<robot name="slide"><link name="base"/><link name="cart"><inertial><mass value="1"/>
  <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
  <limit lower="{}" upper="{}" effort="1" velocity="1"/></joint></robot>"""


def begun(robot, **told):
    values = {name: spec.validate(told.get(name.replace(".", "_"), spec.default)) for name, spec in PARAMETERS.items()}
    return build_simulation(values, robot).simulation


@pytest.mark.parametrize("name", ["panda", "ur5", "kinova", "xarm7", "z1", "so101", "allegro", "solo12", "hyq"])
def test_real_robots_start_within_their_limits(name):
    robot = load_robot(real_urdf(name))
    simulation, resting = begun(robot), Simulation(robot).state.positions
    assert not list(joint_limit_warnings(simulation))
    for joint, position, before in zip(simulation.joint_names, simulation.state.positions, resting, strict=True):
        limits = robot.joints[robot.joint_numbers[joint]].limits
        inside = limits.lower <= before <= limits.upper
        assert position == (before if inside else (limits.lower + limits.upper) / 2), joint


@pytest.mark.parametrize(
    "name",
    ["panda", "ur5e", "rx90", "puma560", "manutec_r3", "free_flying_arm", "turtlebot3_burger", "sr400"],
)
def test_shipped_robots_start_at_the_positions_of_their_description(name):
    robot = load_robot(name)
    simulation, resting = begun(robot), Simulation(robot).state.positions
    moved = {joint for joint, a, b in zip(simulation.joint_names, simulation.state.positions, resting, strict=True)
             if a != b}  # fmt: skip
    assert moved == ({"panda_joint4"} if name == "panda" else set())


@pytest.mark.parametrize(
    ("lower", "upper", "position"), [(-1, 1, 0), (0.5, 1.5, 1), (-3, -1, -2), (0.2, 1e300, 0.2), (2, 1, 0)]
)
def test_initial_position_is_zero_if_allowed_and_else_the_middle_of_the_limits(lower, upper, position):
    assert begun(load_robot(SLIDE.format(lower, upper))).state.positions == pytest.approx([position])


def test_parameters_and_description_have_priority_over_the_limits():
    robot = load_robot("panda")
    simulation = begun(robot, initial_joints=["panda_joint4"], initial_positions=[0.3])
    assert simulation.state.positions[3] == 0.3 and len(list(joint_limit_warnings(simulation))) == 1
    table = (
        "robot: r\njoints:\n  - {joint: j, link: l, mass: 1, inertia: {zz: 1}, initial_position: 2, limits: {upper: 1}}"
    )
    simulation = begun(load_robot(table))
    assert simulation.state.positions.tolist() == [2.0] and len(list(joint_limit_warnings(simulation))) == 1


def test_simulated_panda_starts_without_a_warning(client, tmp_path):
    log = tmp_path / "log"
    with log.open("w") as file, running_node("mobile_base_simulator", {"robot_file": "panda", "start_paused": True},
                                             "/within", log=file):  # fmt: skip
        node = SimulatorProbe("/within/mobile_base_simulator", client)
        node.wait_until(lambda: node.joint_states, "joint_states")
        deadline = time.monotonic() + 30
        while "simulates" not in log.read_text():
            assert time.monotonic() < deadline
            time.sleep(0.05)
    limits = {joint.name: joint.limits for joint in load_robot("panda").joints}
    told = node.joint_states[-1]
    assert all(limits[name].lower < q < limits[name].upper for name, q in zip(told.name, told.position, strict=True))
    np.testing.assert_array_equal(np.delete(told.position, 3), 0.0)
    assert "WARN" not in log.read_text(), log.read_text()
