"""Elastic ground: a box rests at the height of the springs, slides with friction, and bounces."""

import numpy as np
import pytest

from robot_dynamics import Base, DescriptionError, Dynamics, InvalidInputError, load_robot
from robot_dynamics.errors import SimulationError
from robot_dynamics.simulation import Ground, Simulation
from robot_dynamics.simulation.frame_program import FrameProgram

MASS, HALF, HEIGHT = 2.0, 0.15, 0.05  # [kg], [m]: a flat box, so that it does not tip
CORNERS = ("front_left", "front_right", "rear_left", "rear_right")
SIGNS = {"front_left": (1, 1), "front_right": (1, -1), "rear_left": (-1, 1), "rear_right": (-1, -1)}
FRICTION, STIFFNESS = 0.5, 1e4


def box():
    along, up = MASS * (4 * HALF**2 + 4 * HEIGHT**2) / 12, MASS * 8 * HALF**2 / 12
    links = "".join(f'<link name="{name}"/>' for name in CORNERS)
    fixed = "".join(
        f'<joint name="to_{name}" type="fixed"><parent link="box"/><child link="{name}"/>'
        f'<origin xyz="{x * HALF} {y * HALF} {-HEIGHT}"/></joint>'
        for name, (x, y) in SIGNS.items()
    )
    return f"""<robot name="box"><link name="box"><inertial><mass value="{MASS}"/><inertia ixx="{along}" iyy="{along}"
        izz="{up}" ixy="0" ixz="0" iyz="0"/></inertial></link>{links}{fixed}</robot>"""


def resting_box(gravity=(0, 0, -9.81), velocity=(0, 0, 0), **settings):
    """A Simulation of the box, at its depth of rest in the ground."""
    ground = Ground(CORNERS, stiffness=STIFFNESS, damping=100.0, friction=FRICTION, **settings)
    simulation = Simulation(load_robot(box(), moving_base=True, gravity=list(gravity)), ground=ground)
    pose = np.eye(4)
    pose[2, 3] = HEIGHT + MASS * gravity[2] / (4 * STIFFNESS)
    simulation.start(base=Base(pose, [*velocity, 0, 0, 0]))
    return simulation


def test_box_rests_where_springs_bear_its_weight():
    simulation = resting_box()
    pose = np.eye(4)
    pose[2, 3] = HEIGHT + 0.03
    simulation.start(base=Base(pose))
    highest = max(simulation.advance(1).twist[2] for _ in range(200))
    state = simulation.advance(1300)
    assert state.pose[2, 3] == pytest.approx(HEIGHT - MASS * 9.81 / (4 * STIFFNESS), abs=1e-9)
    assert np.abs(state.twist).max() < 1e-6 and highest > 0  # it has bounced
    force_on_leaving_point = simulation.ground.forces(np.array([[0, 0, -0.001]]), np.array([[0, 0, 1.0]]))
    np.testing.assert_array_equal(force_on_leaving_point, np.zeros((1, 3)))  # no pull


def test_pushed_box_slides_the_stopping_distance_of_friction():
    speed = 0.9
    simulation = resting_box(velocity=(speed * 0.8, speed * 0.6, 0))
    state = simulation.advance(800)
    stopping_distance = speed**2 / (2 * FRICTION * 9.81)
    assert state.time > speed / (FRICTION * 9.81)
    distance = np.hypot(*state.pose[:2, 3])
    print(f"slid {distance:.5f} m, v²/(2 μ g) = {stopping_distance:.5f} m")
    assert distance == pytest.approx(stopping_distance, rel=5e-3)
    np.testing.assert_allclose(state.pose[:2, 3] / distance, [0.8, 0.6], atol=1e-3)
    assert np.abs(state.twist).max() < 1e-5


@pytest.mark.parametrize(("slope", "slides"), [(0.35, False), (0.6, True)])
def test_box_on_a_slope_slides_beyond_the_angle_of_friction(slope, slides):
    g = 9.81
    simulation = resting_box(gravity=(g * np.sin(slope), 0, -g * np.cos(slope)))
    state = simulation.advance(600)
    if not slides:
        assert np.tan(slope) < FRICTION and abs(state.twist[0]) < 2 * simulation.ground.slip_velocity
        return
    before = state.twist[0]
    after = simulation.advance(200).twist[0]
    assert (after - before) / 0.2 == pytest.approx(g * (np.sin(slope) - FRICTION * np.cos(slope)), rel=1e-3)


def test_box_moves_only_if_the_push_exceeds_friction():
    for force, moves in ((0.9 * FRICTION * MASS * 9.81, False), (1.2 * FRICTION * MASS * 9.81, True)):
        simulation = resting_box()
        early = simulation.advance(300, external_wrenches={"box": [force, 0, 0, 0, 0, 0]})
        late = simulation.advance(200, external_wrenches={"box": [force, 0, 0, 0, 0, 0]})
        if moves:
            assert (late.twist[0] - early.twist[0]) / 0.2 == pytest.approx(0.2 * FRICTION * 9.81, rel=0.005)
        else:
            assert abs(late.twist[0]) < 3 * simulation.ground.slip_velocity


def test_frame_kinematics_are_those_of_link_poses():
    dynamics = Dynamics(load_robot("free_flying_arm"))
    names, rng = ("arm_tool0", "arm_forearm_link", dynamics.robot.base_link), np.random.default_rng(5)
    q, rates, h = rng.uniform(-1, 1, 6), rng.uniform(-1, 1, 12), 1e-6
    rotations, positions, velocities = FrameProgram(dynamics, names)(q, rates)
    for k, name in enumerate(names):
        pose = dynamics.link_pose(name, q, base=Base())
        np.testing.assert_allclose(rotations[k], pose[:3, :3], atol=1e-14)
        np.testing.assert_allclose(positions[k], pose[:3, 3], atol=1e-14)
        before, after = (dynamics.link_pose(name, q + sign * h * rates[6:], base=Base())[:3, 3] for sign in (-1, 1))
        base_velocity = rates[:3] + np.cross(rates[3:6], positions[k])
        np.testing.assert_allclose(velocities[k], base_velocity + (after - before) / (2 * h), atol=1e-8)


def test_ground_pushes_an_arm_at_its_tip():
    robot = load_robot("ur5e", gravity=[0, 0, 0])
    probe, q = Dynamics(robot), np.array([0.0, -0.5, 1.2, -0.7, 0.3, 0.0])
    height = probe.link_pose("tool0", q)[2, 3] + 1e-3
    simulation = Simulation(robot, ground=Ground(("tool0",), height=height, friction=0.0))
    simulation.start(q)
    R = probe.link_pose("tool0", q)[:3, :3]
    expected = probe.direct(q, np.zeros(6), np.zeros(6), external_wrenches={"tool0": [*(R.T @ [0, 0, 20.0]), 0, 0, 0]})
    np.testing.assert_allclose(simulation.accelerations()[1], expected, rtol=1e-9)


def test_invalid_grounds_are_refused():
    for settings, message in (
        ({"friction": -0.1}, "friction is -0.1"),
        ({"stiffness": 0.0}, "must be positive"),
        ({"height": np.nan}, "height is nan"),
    ):
        with pytest.raises(DescriptionError, match=message):
            Ground(("box",), **settings)
    with pytest.raises(InvalidInputError, match="unknown link 'rear'"):
        Simulation(load_robot(box(), moving_base=True), ground=Ground(("rear",)))


@pytest.mark.parametrize("stiffness", [2e4, 1e7, 1e9])
def test_fast_impact_conserves_energy_and_reaches_the_depth_of_the_spring(stiffness):
    speed, step = 30.0, 1e-3
    ground = Ground(CORNERS, stiffness=stiffness, damping=0.0, friction=0.0)
    simulation = Simulation(load_robot(box(), moving_base=True), ground=ground, step=step)
    pose = np.eye(4)
    pose[2, 3] = HEIGHT + 0.01234
    simulation.start(base=Base(pose, [0, 0, -speed, 0, 0, 0]))
    before, lowest = sum(simulation.energy()), np.inf
    while simulation.state.twist[2] < 0 or simulation.state.pose[2, 3] < HEIGHT:
        simulation.advance()
        lowest = min(lowest, simulation.state.pose[2, 3])
        assert simulation.state.time < 0.1
    assert sum(simulation.energy()) == pytest.approx(before, rel=1e-3)
    depth = speed * np.sqrt(MASS / (4 * stiffness))
    if depth > 10 * speed * step:  # deep enough for the samples to be near the turn
        assert HEIGHT - lowest == pytest.approx(depth, rel=2e-2)


def test_ground_too_stiff_for_the_step_is_refused():
    ground = Ground(CORNERS, stiffness=1e16, damping=0.0, friction=0.0)
    simulation = Simulation(load_robot(box(), moving_base=True), ground=ground)
    pose = np.eye(4)
    pose[2, 3] = HEIGHT + 0.001
    simulation.start(base=Base(pose, [0, 0, -30.0, 0, 0, 0]))
    with pytest.raises(SimulationError, match="the step is too long"):
        simulation.advance(20)
