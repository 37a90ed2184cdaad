"""Inverse geometry of parallel robots: positions of all joints where platforms have prescribed poses.

The coordinates of the platforms and the other joints that no platform determines are independent joints here. Each leg
is then closed by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.errors import DescriptionError, InvalidInputError
from robot_dynamics.inputs import common_batch_shape
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.parallel.platform_motion import POSE_TOLERANCE, coordinates_from_pose, pose_from_coordinates

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray, IntArray
    from robot_dynamics.constraints.closure_solver import ClosureSolver
    from robot_dynamics.joint_space.joint_dynamics import JointDynamics
    from robot_dynamics.model.platform import Platform
    from robot_dynamics.model.robot import Robot

RANK_TOLERANCE = 1e-6


class PlatformClosure:
    """Closure of the legs of a robot at prescribed poses of some of its platforms.

    solver: the ClosureSolver with coordinates of these platforms as independent joints; coordinate_joints: (platforms,
    6) numbers of their joints; free_joints: numbers of the joints that are free coordinates; other_joints: numbers of
    the other independent joints of the solver.
    """

    def __init__(
        self,
        dynamics: JointDynamics,
        platforms: Sequence[Platform],
        make_closure_solver: Callable[[Robot], ClosureSolver],
    ) -> None:
        robot = dynamics.robot
        free = [tuple(platform.free) for platform in platforms]
        self._characteristic_length = robot.characteristic_length
        self._joint_count = len(robot.joints)
        self.coordinate_joints: IntArray = np.array([platform.joints for platform in platforms])
        free_columns = [(row, COORDINATES.index(name)) for row, names in enumerate(free) for name in names]
        rows, columns = np.array(free_columns).T
        self._free_index = (..., rows, columns)  # of the free coordinates, among (..., platforms, 6)
        self.free_joints: list[int] = self.coordinate_joints[rows, columns].tolist()
        platform_driven = _with_independent_platforms(robot, self.coordinate_joints, self.free_joints)
        try:
            self.solver = make_closure_solver(platform_driven)
        except DescriptionError:
            links = [robot.links[platform.link].name for platform in platforms]
            message = _describe_wrong_coordinates(dynamics, links, self.coordinate_joints, free)
            raise DescriptionError(message) from None
        self.other_joints = [number for number in self.solver.independent if number not in self.free_joints]

    def close_legs(self, poses: Array, seed: ArrayLike | None, other_positions: Array | None) -> Array:
        """Return positions (..., all joints) with the platforms at poses (..., platforms, 4, 4).

        seed: (..., all joints) or None; other_positions: (..., k) of the other joints, or None. Raises
        SingularModelError where a leg cannot reach.
        """
        seed = self._check_seed(seed, poses, other_positions)
        if self._all_coordinates_are_free:
            return self.solver.close_loops(
                self._solver_positions(self._coordinates(poses, seed), seed, other_positions)
            )
        q, reached, arguments = self.try_close_legs(poses, seed, other_positions)
        if reached.all():
            return q
        closed = q if arguments.shape[-1] == q.shape[-1] else q[..., self.solver.independent]
        return self.solver.close_loops(np.where(reached[..., None], closed, arguments))  # refuses the others

    def try_close_legs(
        self, poses: Array, seed: ArrayLike | None, other_positions: Array | None
    ) -> tuple[Array, BoolArray, Array]:
        """Return positions (..., all joints), whether the legs reach (...), and the arguments of the solver.

        poses: (..., platforms, 4, 4). Where not all coordinates are free, more than one pose may have the free
        coordinates. The requested pose is then also sought from itself, and from its other angles.
        """
        seed = self._check_seed(seed, poses, other_positions)
        x = self._coordinates(poses, seed)
        arguments = self._solver_positions(x, seed, other_positions)
        q, reached = self.solver.try_close_loops(arguments)
        if self._all_coordinates_are_free:
            return q, reached, arguments
        alternatives = [partial(self._solver_positions, x, self._seed_at(x, seed), other_positions)]
        if seed is None:
            alternatives.append(partial(self._solver_positions, _flip_angles(x), None, other_positions))
        for alternative in alternatives:
            is_exact = reached & self._has_poses(q, poses)
            if is_exact.all():
                break
            candidate, is_closed = self.solver.try_close_loops(alternative())
            is_better = ~is_exact & is_closed & self._has_poses(candidate, poses)
            q = np.where(is_better[..., None], candidate, q)
            reached = reached | is_better
        return q, reached, arguments

    @property
    def _all_coordinates_are_free(self) -> bool:
        return len(self.free_joints) == self.coordinate_joints.size

    def _check_seed(self, seed: ArrayLike | None, poses: Array, other_positions: Array | None) -> Array | None:
        """Return the seed (..., all joints) as an array, nan where unknown.

        Raises InvalidInputError where it does not fit the robot, or where the batches of the arguments differ.
        """
        values = None
        if seed is not None:
            try:
                values = np.array(seed, dtype=float)
            except (TypeError, ValueError):
                values = np.zeros(0)
            if values.shape[-1:] != (self._joint_count,):
                names = ", ".join(joint.name for joint in self.solver.robot.joints)
                require_finite("seed", seed, self._joint_count, f"joints ({names})")  # refuses the shape
        common_batch_shape(poses[..., 0, 0, :], values, other_positions)
        return values

    def _coordinates(self, poses: Array, seed: Array | None) -> Array:
        """Return coordinates (..., platforms, 6) of poses (..., platforms, 4, 4).

        Angles are those nearest to the seed, or to the initial positions where the seed has none.
        """
        near = self.solver.closed_positions[self.coordinate_joints]
        if seed is not None:
            seeded = seed[..., self.coordinate_joints]
            near = np.where(np.isnan(seeded), near, seeded)
        return coordinates_from_pose(poses, near)

    def _seed_at(self, x: Array, seed: Array | None) -> Array:
        """Return a seed (..., all joints) with the platforms at coordinates x (..., platforms, 6)."""
        batch = np.broadcast_shapes(x.shape[:-2], () if seed is None else seed.shape[:-1])
        seeds = np.full((*batch, self._joint_count), np.nan)
        if seed is not None:
            seeds[...] = seed
        seeds[..., self.coordinate_joints] = x
        return seeds

    def _has_poses(self, q: Array, poses: Array) -> BoolArray:
        """Return (...) whether the platforms are at poses (..., platforms, 4, 4)."""
        difference = np.abs(pose_from_coordinates(q[..., self.coordinate_joints]) - poses)
        difference[..., :3, 3] /= self._characteristic_length
        return np.asarray(difference.max(axis=(-3, -2, -1)) <= POSE_TOLERANCE)

    def _solver_positions(self, x: Array, seed: Array | None, other_positions: Array | None) -> Array:
        """Return the argument of the solver: positions of its independent joints, or of all joints with a seed.

        x: (..., platforms, 6) coordinates; seed: (..., all joints); other_positions: (..., k), by default those of the
        seed or the initial ones.
        """
        initial = self.solver.closed_positions[self.other_joints]
        if seed is None:
            return self._independent_positions(x, initial if other_positions is None else other_positions)
        if other_positions is None:
            seeded = seed[..., self.other_joints]
            other_positions = np.where(np.isnan(seeded), initial, seeded)
        batch = np.broadcast_shapes(x.shape[:-2], seed.shape[:-1], other_positions.shape[:-1])
        seeds = np.array(np.broadcast_to(seed, (*batch, self._joint_count)))
        seeds[..., self.free_joints] = x[self._free_index]
        seeds[..., self.other_joints] = other_positions
        return seeds

    def _independent_positions(self, x: Array, other_positions: Array) -> Array:
        """Return positions (..., n) of the solver's independent joints, of coordinates and of the other joints."""
        free = x[self._free_index]
        independent = list(self.solver.independent)
        batch = np.broadcast_shapes(free.shape[:-1], other_positions.shape[:-1])
        positions = np.empty((*batch, len(independent)))
        positions[..., [independent.index(number) for number in self.free_joints]] = free
        positions[..., [independent.index(number) for number in self.other_joints]] = other_positions
        return positions


def _flip_angles(x: Array) -> Array:
    """Return the other coordinates (..., 6) of the same pose: with pitch on the other side of ±90°."""
    return np.concatenate([x[..., :3], x[..., 3:] * [1, -1, 1] + np.pi], axis=-1)


def _with_independent_platforms(robot: Robot, coordinate_joints: IntArray, free_joints: Sequence[int]) -> Robot:
    """Return the robot with actuated free coordinates of its platforms and passive legs.

    coordinate_joints: (platforms, 6) numbers of joints. Raises InvalidInputError where the legs hold other platforms
    too.
    """
    leg_joints = {*coordinate_joints.ravel().tolist()}
    loops = [
        {robot.mimic_relations[number][0] for number in {*robot.path_to_base(a.link)} ^ {*robot.path_to_base(b.link)}}
        for a, b in (loop.ends for loop in robot.loops)
    ]
    while True:
        connected = [loop for loop in loops if loop & leg_joints and not loop <= leg_joints]
        if not connected:
            break
        leg_joints = leg_joints.union(*connected)
    for name, platform in zip(robot.platform_links, robot.platforms, strict=True):
        if leg_joints & {*platform.joints} and platform.joints[0] not in coordinate_joints:
            raise InvalidInputError(
                f"these legs hold platform {name!r} too: use Dynamics.platform, which has both platforms"
            )
    joints = [
        replace(joint, actuated=number in free_joints, spring=None if joint.actuated else joint.spring)
        if number in leg_joints and joint.mimic is None
        else joint
        for number, joint in enumerate(robot.joints)
    ]
    platforms = tuple(replace(platform, is_virtually_actuated=True) for platform in robot.platforms)
    return replace(robot, joints=tuple(joints), platforms=platforms)


def _describe_wrong_coordinates(
    dynamics: JointDynamics, links: Sequence[str], coordinate_joints: IntArray, free: Sequence[tuple[str, ...]]
) -> str:
    """Return an error message on free coordinates that do not determine the platforms, with those that would.

    free: names of the free coordinates of each platform. The rank of the rates of the coordinates for unit rates of the
    motors decides.
    """
    motors = len(dynamics.joint_names)
    positions = np.tile(dynamics.initial_joint_positions, (motors, 1))
    rates = np.nan_to_num(dynamics.expand_velocities(np.eye(motors), positions))
    messages = []
    for link, joints, names in zip(links, coordinate_joints, free, strict=True):
        chosen: list[int] = []
        for column in range(len(COORDINATES)):
            rank = np.linalg.matrix_rank(rates[:, joints[[*chosen, column]]], tol=RANK_TOLERANCE)
            if rank > len(chosen):
                chosen.append(column)
        if set(names) != {COORDINATES[column] for column in chosen}:
            right = ", ".join(COORDINATES[column] for column in chosen)
            messages.append(
                f"platform {link!r}: its legs let it move by {len(chosen)} coordinates (mobility {len(chosen)}), which "
                f"{', '.join(names)} do not determine: write free: [{right}]"
            )
    return "; ".join(messages) or f"the free coordinates of platforms {', '.join(links)} do not determine their legs"
