"""Positions of a robot that a user moves: loops stay closed, in the assembly mode in which they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError, SingularModelError
from robot_dynamics.inputs import Base
from robot_dynamics.model.robot import attach_payload
from robot_dynamics.parallel.platform_motion import coordinates_from_pose, pose_from_coordinates
from robot_dynamics.viewing.assembly_search import is_same_mode
from robot_dynamics.viewing.link_poses import link_matrices
from robot_dynamics.viewing.value_range import Range

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.inputs import ExternalWrenches
    from robot_dynamics.model.inertia import Inertia
    from robot_dynamics.model.robot import Robot

SINGULAR_RATIO = 100.0
"""Positions count as singular where a rate ratio or a condition number is as large as this."""


class Configuration:
    """Closed positions of a robot, moved by independent joints or by coordinates of platforms.

    Parameters
    ----------
    robot : Robot
    dynamics : Dynamics, optional
        Model of the robot. Default: a new one.

    Attributes
    ----------
    robot : Robot
        The robot, with the payload that it carries.
    dynamics : Dynamics
        Its model.
    q : ndarray, shape (all joints,)
        Positions that close the loops [rad or m].
    independent : list of int
        Indices of the independent joints.
    problem : str
        Why the last motion that was wanted is not possible; empty if it was. `q` are then the positions before.
    """

    def __init__(self, robot: Robot, dynamics: Dynamics | None = None) -> None:
        self.robot = robot
        self._robot_without_payload = robot
        self.dynamics = Dynamics(robot) if dynamics is None else dynamics
        self.q: Array = np.array(self.dynamics.initial_joint_positions, dtype=float)
        self.problem = ""
        names = self.dynamics.all_joint_names
        self.independent: list[int] = [names.index(name) for name in self.dynamics.joint_names]
        if not robot.loops:  # a URDF begins at zero, which may be outside the limits
            self.q = self.dynamics.expand_positions([self._limit(index) for index in self.independent])

    @property
    def independent_positions(self) -> Array:
        """(n,) positions of the independent joints [rad or m]."""
        return self.q[self.independent]

    def carry(self, frame: str, inertia: Inertia) -> None:
        """Carry a payload, as `Robot.with_payload` attaches it, in the place of another payload.

        Parameters
        ----------
        frame : str
            Frame to which the payload is fixed.
        inertia : Inertia
            Inertia of the payload in this frame; without mass for no payload.

        Raises
        ------
        InvalidInputError
            The frame is unknown, or the mass negative.
        """
        self.robot = attach_payload(self._robot_without_payload, frame, inertia)
        self.dynamics = Dynamics(self.robot)

    def move_joints(self, positions: ArrayLike) -> bool:
        """Move the independent joints to positions (n,) [rad or m]; the loops follow from where they are.

        Returns
        -------
        bool
            Whether the loops close there. If not, the robot stays, and `problem` has the reason.
        """
        q = np.asarray(positions, dtype=float)
        if not self.robot.loops:
            return self._accept(self.dynamics.expand_positions(q))
        try:
            return self._accept(self.dynamics.expand_positions(q, previous=self.q))
        except SingularModelError as error:
            self.problem = str(error)
            return False

    def move_platform(self, link: str, coordinates: ArrayLike) -> bool:
        """Move a platform to coordinates (6,): x, y, z [m], yaw, pitch, roll [rad]. Legs keep their assembly modes.

        Returns
        -------
        bool
            Whether the legs reach it. If not, the robot stays, and `problem` has the reason.

        Raises
        ------
        InvalidInputError
            The robot has no such platform.
        """
        platform = self.dynamics.platforms[link]
        pose = pose_from_coordinates(np.asarray(coordinates, dtype=float))
        others = self.q[[self.dynamics.all_joint_names.index(name) for name in platform.other_joint_names]]
        try:
            q = platform.joint_positions(pose, seed=self.q, other_joints=(others,) if len(others) else None)
        except SingularModelError as error:
            self.problem = str(error)
            return False
        return self._accept(q)

    def place(self, q: ArrayLike) -> bool:
        """Move all joints to positions (all joints,) near to where the loops close."""
        try:
            return self._accept(self.dynamics.expand_positions(q))
        except (SingularModelError, InvalidInputError) as error:
            self.problem = str(error)
            return False

    def is_at(self, q: ArrayLike) -> bool:
        """Return whether all joints and frames are where positions (all joints,) put them."""
        return is_same_mode(self.robot, self.q, np.asarray(q, dtype=float))

    def _limit(self, index: int) -> float:
        """Return the present position of a joint, or its limit nearest to it."""
        limits = self.robot.joints[index].limits
        return Range(limits.lower, limits.upper).clip(float(self.q[index]))

    def _accept(self, q: Array) -> bool:
        self.q = np.array(q, dtype=float)
        self.problem = ""
        return True

    def platform_coordinates(self, link: str) -> Array:
        """(6,) coordinates of a platform: x, y, z [m], yaw, pitch, roll [rad]."""
        platforms = dict(zip(self.robot.platform_links, self.robot.platforms, strict=True))
        pose = pose_from_coordinates(self.q[list(platforms[link].joints)])
        return np.asarray(coordinates_from_pose(pose))

    def joint_range(self, index: int, extent: float) -> Range:
        """Return the range of a joint: its limits; without limits half a turn each way, or half the robot's extent.

        A coordinate of a platform without limits gets a third of the extent, or a sixth of a turn, each way.
        """
        joint = self.robot.joints[index]
        is_coordinate = any(index in platform.joints for platform in self.robot.platforms)
        if is_coordinate:
            half = extent / 3 if joint.prismatic else np.pi / 3
        else:
            half = extent / 2 if joint.prismatic else np.pi
        lower, upper = joint.limits.lower, joint.limits.upper
        lower = lower if np.isfinite(lower) else min(self.q[index], upper) - half
        upper = upper if np.isfinite(upper) else max(self.q[index], lower) + half
        return Range(float(min(lower, self.q[index])), float(max(upper, self.q[index])))

    def link_poses(self) -> Array:
        """(links, 4, 4) poses of all link frames in frame 0 [m]."""
        return np.asarray(link_matrices(self.robot, self.q))

    def singularity(self) -> float:
        """Largest rate of a dependent joint for a unit rate of an independent joint; infinite where loops are singular.

        A radian counts as the characteristic length of the robot. 1 or less without loops.
        """
        if not self.robot.loops:
            return 1.0
        try:
            G = self.dynamics.constrained_state(self.q).G
        except SingularModelError:
            return float("inf")
        length = self.robot.characteristic_length
        units = np.array([1.0 if joint.prismatic else length for joint in self.robot.joints])
        return float(np.abs(G * units[:, None] / units[self.independent]).max())

    def platform_condition(self) -> float:
        """Largest condition number of the Jacobians of the platforms; 1 without platforms."""
        numbers = [float(platform.condition_number(self.q)) for platform in self.dynamics.platforms.values()]
        return max(numbers, default=1.0)

    @property
    def is_singular(self) -> bool:
        """Whether the robot is singular here, or nearly so: its loops, or platforms that motors cannot move."""
        return not (self.singularity() < SINGULAR_RATIO and self.platform_condition() < SINGULAR_RATIO)

    def holding_efforts(self, external_wrenches: ExternalWrenches | None = None) -> Array:
        """(n,) efforts at the independent joints that hold the robot [N m or N]; nan where the loops are singular.

        Something else holds a base that can move.

        Parameters
        ----------
        external_wrenches : mapping of str to array_like, optional
            What the environment exerts, as for `Dynamics.inverse`. Default: nothing.
        """
        zeros = np.zeros(len(self.independent))
        base = Base(np.eye(4), np.zeros(6), np.zeros(6)) if self.robot.moving_base else None
        try:
            q = self.q if self.robot.loops else self.independent_positions
            return self.dynamics.inverse(q, zeros, zeros, base=base, external_wrenches=external_wrenches)
        except SingularModelError:
            return np.full(len(self.independent), np.nan)
