"""Joint friction: sticking and sliding with dry friction, damping with viscous friction of any strength."""

import numpy as np
import pytest

from robot_dynamics import load_robot
from robot_dynamics.simulation import Simulation

INERTIA = 0.5


def flywheel(dry=0.0, viscous=0.0, inertia=INERTIA):
    return f"""<robot name="flywheel"><link name="base"/><link name="wheel"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="turn" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/>
        <dynamics friction="{dry}" damping="{viscous}"/></joint></robot>"""


def test_joint_sticks_until_the_effort_exceeds_dry_friction():
    simulation = Simulation(load_robot(flywheel(dry=2.0)))
    for effort in (1.0, -1.99, 2.0):
        state = simulation.advance(200, efforts=[effort])
        assert abs(state.positions[0]) < 1e-15 and abs(state.velocities[0]) < 1e-15
    state = simulation.advance(1000, efforts=[3.0])
    assert state.velocities[0] == pytest.approx((3.0 - 2.0) / INERTIA, rel=1e-12)


def test_sliding_joint_stops_at_the_time_and_place_of_dry_friction():
    simulation = Simulation(load_robot(flywheel(dry=2.0)))
    simulation.start(velocities=[4.0])
    state = simulation.advance(1100)
    assert state.velocities[0] == 0  # since t = 4 · 0.5 / 2 = 1 s
    assert state.positions[0] == pytest.approx(4.0**2 * INERTIA / (2 * 2.0), rel=2e-3)
    assert simulation.advance(100).positions[0] == pytest.approx(state.positions[0], abs=1e-14)


def test_viscous_friction_is_exact_where_steps_are_short():
    simulation = Simulation(load_robot(flywheel(viscous=0.7)))
    simulation.start(velocities=[4.0])
    assert simulation.advance(1000).velocities[0] == pytest.approx(4.0 * np.exp(-0.7 / INERTIA), rel=1e-12)


def test_viscous_friction_too_strong_for_explicit_steps_still_damps():
    simulation = Simulation(load_robot(flywheel(viscous=1.0, inertia=1e-6)))
    state = simulation.advance(100, efforts=[0.5])
    assert state.velocities[0] == pytest.approx(0.5, rel=1e-5)  # effort / Fv


@pytest.mark.slow
def test_pendulum_with_dry_friction_stops_at_an_angle_of_static_equilibrium():
    urdf = flywheel(dry=0.8).replace('<axis xyz="0 0 1"/>', '<axis xyz="0 1 0"/>')
    urdf = urdf.replace('<mass value="1"/>', '<origin xyz="0 0 -0.4"/><mass value="1"/>')
    simulation = Simulation(load_robot(urdf))
    simulation.start(positions=[1.2])
    state = simulation.advance(6000)
    assert abs(state.velocities[0]) < 1e-15
    assert 0 < abs(np.sin(state.positions[0])) * 9.81 * 0.4 <= 0.8
    # one half swing loses 2 F φ: m g l (cos φ1 - cos φ0) = F (φ0 + φ1)
    simulation.reset()
    least_angle = 1.2
    while (state := simulation.advance(1)).velocities[0] <= 0 and state.time < 3:
        least_angle = state.positions[0]
    assert 9.81 * 0.4 * (np.cos(least_angle) - np.cos(1.2)) == pytest.approx(0.8 * (1.2 - least_angle), rel=5e-3)


def test_many_joints_stick_together():
    simulation = Simulation(load_robot("puma560"))  # its table has dry friction
    gravity_efforts = simulation.dynamics.gravity(np.zeros(6))
    dry = np.array([joint.coulomb_friction for joint in simulation.robot.joints])
    assert (dry > 0).all()
    state = simulation.advance(300, efforts=gravity_efforts + 0.9 * dry)
    np.testing.assert_allclose(state.velocities, 0, atol=1e-12)
    np.testing.assert_allclose(state.positions, 0, atol=1e-12)
    assert (np.abs(simulation.advance(300, efforts=gravity_efforts + 1.5 * dry).velocities) > 1e-3).any()
