"""Steps that are too long for vibrations: divided into parts, or refused."""

import logging

import numpy as np
import pytest

from robot_dynamics import load_robot
from robot_dynamics.errors import SimulationError
from robot_dynamics.simulation import Simulation

STIFFNESS, MASS, BODY = 100.0, 0.1, 2.0
ARM = """
format: 1
robot: stiff
base: {{link: body, moving: true, mass: 2, central_inertia: {{xx: .02, yy: .02, zz: .02}}}}
joints:
  - joint: hinge
    link: arm
    role: elastic
    mdh: {{d: 0.1}}
    spring: {{stiffness: 100, damping: {damping}}}
    mass: 0.1
    centre_of_mass: [0.05, 0, 0]
    central_inertia: {{xx: 1e-5, yy: 1e-5, zz: 1e-5}}
"""


def arm(tmp_path, damping, step=1e-3):
    path = tmp_path / "stiff.yaml"
    path.write_text(ARM.format(damping=damping))
    simulation = Simulation(load_robot(str(path), gravity=[0, 0, 0]), step=step)
    simulation.start(positions=[0.3])
    return simulation


@pytest.mark.slow
def test_strong_damper_is_integrated_in_parts_with_a_warning(tmp_path, caplog):
    """Overdamped, the deflection decays with k/c: the inertia does not matter."""
    simulation = arm(tmp_path, damping=20.0)
    with caplog.at_level(logging.WARNING):
        state = simulation.advance(200)
    assert state.positions[0] == pytest.approx(0.3 * np.exp(-STIFFNESS / 20.0 * 0.2), rel=2e-3)
    messages = [record.getMessage() for record in caplog.records if "too long" in record.getMessage()]
    assert len(messages) == 1 and "'stiff'" in messages[0] and "0.001 s" in messages[0]


@pytest.mark.slow
def test_stiff_spring_conserves_energy_and_momentum_in_parts(tmp_path):
    simulation = arm(tmp_path, damping=0.0, step=5e-3)
    start = sum(simulation.energy())
    for _ in range(20):
        simulation.advance(10)
        assert sum(simulation.energy()) == pytest.approx(start, rel=1e-5)
        np.testing.assert_allclose(simulation.momentum().linear, 0, atol=1e-12)


@pytest.mark.parametrize("damping", [100.0, 1000.0, 1e6])
def test_steps_that_are_too_long_raise_and_keep_the_state(tmp_path, damping):
    simulation = arm(tmp_path, damping)
    start = simulation.state
    with pytest.raises(SimulationError, match=r"at 0 s the step is too long.*shorter step"):
        simulation.advance(5)
    assert simulation.state is start
