"""Programs of derivatives agree with complex steps through the programs of the models, to rounding.

The tangent of loops comes from the recursions. RANDOM_DERIVATIVES sets the number of random robots.
"""

import os

import numpy as np
import pytest
from peers.derivative_cases import largest_errors, random_state
from peers.frictions import with_random_friction
from peers.large_robots import LARGE_ROBOTS
from peers.random_loops import random_loops
from peers.random_platforms import random_platform
from peers.random_robots import random_urdf
from peers.traced_models import shipped_program, shipped_robot

from robot_dynamics import load_robot, shipped_robots

ROBOTS = int(os.environ.get("RANDOM_DERIVATIVES", "1"))  # of each kind
SLOW_ROBOTS = {"gough_stewart", "hexapod_stack", "orthoglide", "delta_wrist", "navaro"}
"""Robots whose derivatives take more than a second to trace."""

TOLERANCE = 1e-11


def require_small(errors):
    assert all(error < TOLERANCE for error in errors.values()), errors


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW_ROBOTS))
        for name in shipped_robots()
        if name not in LARGE_ROBOTS or "EVERY_ROBOT" in os.environ
    ],
)
def test_shipped_robots(name):
    robot = shipped_robot(name)
    state = random_state(robot)
    programs = {model: shipped_program(name, f"{model}_derivatives") for model in ("inverse", "direct")}
    require_small(largest_errors(robot, state, programs))
    if robot.moving_base:
        require_small(largest_errors(robot, state, prescribed_base=True))


@pytest.mark.parametrize("moving_base", [False, True])
@pytest.mark.parametrize("seed", range(ROBOTS))
def test_random_loops_with_springs_and_mimic_joints(seed, moving_base):
    looped = random_loops(seed, loops=1 + seed // 10 % 3, moving_base=moving_base)
    state = random_state(looped.robot, seed, looped.q)
    require_small(largest_errors(looped.robot, state))
    if moving_base:
        require_small(largest_errors(looped.robot, state, prescribed_base=True))


@pytest.mark.parametrize("seed", range(ROBOTS))
def test_random_trees(seed):
    robot = load_robot(random_urdf(seed, joints=6))
    require_small(largest_errors(robot, random_state(robot, seed)))


@pytest.mark.parametrize("seed", range(ROBOTS))
def test_random_platforms(seed):
    robot = random_platform(("3-RPS", "3-UPU", "3-PRS", "6-UPS")[seed % 4], seed)
    require_small(largest_errors(robot, random_state(robot, seed)))


@pytest.mark.parametrize("name", ["ur5e", "sr400", "manutec_r3", "free_flying_arm"])
def test_all_kinds_of_friction(name):
    robot = with_random_friction(shipped_robot(name), 2)
    require_small(largest_errors(robot, random_state(robot, 2)))


@pytest.mark.parametrize(("name", "links"), [("panda", ("panda_link5", "panda_link8")), ("four_bar", None)])
def test_external_wrenches(name, links):
    robot = shipped_robot(name)
    links = links or (robot.links[-1].name,)
    state = random_state(robot)
    rng = np.random.default_rng(3)
    state.update({f"wrench on {link}": rng.uniform(-9, 9, 6) for link in links})
    require_small(largest_errors(robot, state, wrenches=links))


def test_coulomb_friction_at_rest_counts_as_constant():
    robot = shipped_robot("puma560")
    state = random_state(robot)
    state["qd"][:] = 0
    require_small(largest_errors(robot, state))
