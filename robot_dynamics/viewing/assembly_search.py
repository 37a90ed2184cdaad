"""Search for the assembly modes of a robot: all closed positions with the same positions of the independent joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.constraints.closure_solver import ClosureSolver
from robot_dynamics.errors import SingularModelError
from robot_dynamics.viewing.link_poses import link_matrices

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.model.robot import Robot

SEEDS_PER_BATCH = 64
MAX_BATCHES = 16
MAX_IDLE_BATCHES = 6
"""Batches without a new mode after which the search ends."""
MAX_MODES = 60
SAME_PLACE = 1e-6
"""Largest distance of points in two positions that are one mode, in characteristic lengths of the robot."""


@dataclass(frozen=True, eq=False)
class AssemblyMode:
    """Closed positions of a robot.

    Attributes
    ----------
    q : ndarray, shape (all joints,)
        Positions [rad or m].
    distance : float
        Largest displacement of a point of the robot from the first mode [m].
    is_within_limits : bool
        Whether all joints are within their limits.
    is_of_description : bool
        Whether it is the mode of the initial positions of the description.
    """

    q: Array
    distance: float
    is_within_limits: bool
    is_of_description: bool


def find_assembly_modes(
    dynamics: Dynamics, q: Array, should_stop: Callable[[], bool] = lambda: False
) -> list[AssemblyMode]:
    """Find assembly modes with the positions of the independent joints that a robot has now.

    Loops are closed from random positions of the dependent joints, always the same ones, until no batch of
    SEEDS_PER_BATCH finds another mode, or the budget of MAX_BATCHES is spent. Modes can be missing.

    Parameters
    ----------
    dynamics : Dynamics
    q : ndarray, shape (all joints,)
        Positions that close the loops [rad or m].
    should_stop : callable
        Asked before each batch; the modes found so far are returned where it returns True.

    Returns
    -------
    list of AssemblyMode
        The first one is that of the description, or that of `q` where the description's is singular or does not
        exist; the others follow by their distance. Two modes differ in the place of a joint, of the end of a loop or
        of a frame: whole turns are no other modes, and neither is a leg that is turned about the line through its ends.
    """
    robot = dynamics.robot
    described = _mode_of_description(dynamics, q)
    modes = [q] if described is None or is_same_mode(robot, described, q) else [described, q]
    is_described = described is not None
    if not robot.loops:
        return _ordered(robot, modes, is_described)
    solver = ClosureSolver(robot)
    idle = 0
    for seeds in _seed_batches(dynamics, q):
        if should_stop() or idle == MAX_IDLE_BATCHES or len(modes) >= MAX_MODES:
            break
        samples, is_closed = solver.try_close_loops(seeds)
        before = len(modes)
        for positions in samples[is_closed]:
            if not any(is_same_mode(robot, positions, known) for known in modes):
                modes.append(_without_turns(robot, positions, q))
        idle = idle + 1 if len(modes) == before else 0
    return _ordered(robot, modes[:MAX_MODES], is_described)


def is_same_mode(robot: Robot, first: Array, second: Array) -> bool:
    """Return whether all points of a robot are at the same places in two positions (all joints,)."""
    return _distance(robot, first, second) <= SAME_PLACE * robot.characteristic_length


def _distance(robot: Robot, first: Array, second: Array) -> float:
    """Return the largest displacement of a point [m]."""
    return float(np.linalg.norm(_points(robot, first) - _points(robot, second), axis=1).max())


def _points(robot: Robot, q: Array) -> Array:
    """Return points of the robot (N, 3) [m], in frame 0: of joints, frames and ends of loops."""
    poses = link_matrices(robot, q)
    fixed = [(joint.antecedent, joint.placement[:3, 3]) for joint in robot.joints]
    fixed += [(frame.link, frame.placement[:3, 3]) for frame in robot.frames]
    fixed += [(end.link, end.placement[:3, 3]) for loop in robot.loops for end in loop.ends]
    links = [link for link, _ in fixed]
    local = np.array([point for _, point in fixed], dtype=float)
    moved: Array = np.einsum("nij,nj->ni", poses[links, :3, :3], local) + poses[links, :3, 3]
    return moved


def _mode_of_description(dynamics: Dynamics, q: Array) -> Array | None:
    """Return the positions in the mode of the initial positions of the description, None where it does not exist."""
    independent = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    try:
        return dynamics.expand_positions(q[independent])
    except SingularModelError:
        return None


def _seed_batches(dynamics: Dynamics, q: Array) -> Iterator[Array]:
    """Yield start positions (SEEDS_PER_BATCH, all joints): dependent joints within half a turn or a length of `q`."""
    robot = dynamics.robot
    dependent = [robot.joint_numbers[name] for name in dynamics.dependent_joint_names]
    spread = np.array([robot.characteristic_length if robot.joints[index].prismatic else np.pi for index in dependent])
    generator = np.random.default_rng(0)
    for _ in range(MAX_BATCHES):
        seeds = np.tile(q, (SEEDS_PER_BATCH, 1))
        seeds[:, dependent] += spread * generator.uniform(-1.0, 1.0, (SEEDS_PER_BATCH, len(dependent)))
        yield seeds


def _without_turns(robot: Robot, positions: Array, q: Array) -> Array:
    """Return positions without the whole turns by which revolute joints are away from `q`."""
    if any(joint.mimic is not None for joint in robot.joints):
        return positions  # turns of a mimic joint are not turns of the joint that it follows
    is_revolute = np.array([not joint.prismatic for joint in robot.joints])
    turns = np.round((positions - q) / (2 * np.pi))
    return np.where(is_revolute, positions - 2 * np.pi * turns, positions)


def _ordered(robot: Robot, closed: list[Array], is_described: bool) -> list[AssemblyMode]:
    """Return modes by their distance from the first one, which can be that of the description."""
    lower = np.array([joint.limits.lower for joint in robot.joints])
    upper = np.array([joint.limits.upper for joint in robot.joints])
    modes = [
        AssemblyMode(
            positions,
            _distance(robot, closed[0], positions),
            bool(((positions >= lower - 1e-9) & (positions <= upper + 1e-9)).all()),
            is_described and number == 0,
        )
        for number, positions in enumerate(closed)
    ]
    return sorted(modes, key=lambda mode: mode.distance)
