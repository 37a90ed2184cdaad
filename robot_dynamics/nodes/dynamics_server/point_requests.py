"""Requests with one point or many, whose values are read range by range.

Requests with a trajectory and those with flat arrays have the same meaning: the services read both as PointRequest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, TypeAlias

from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.base import LinkTrajectories, check_base, require_no_base
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.codecs.flat_points import FlatFields, FlatLinkMotions, read_flat_wrenches
from robot_dynamics.nodes.codecs.joint_order import match_joints
from robot_dynamics.nodes.codecs.joint_trajectories import PointFields
from robot_dynamics.nodes.codecs.wrenches import read_wrenches, wrenches_at
from robot_dynamics_interfaces.srv import DirectDynamics, DynamicsTermsBatch, InverseDynamics, StaticEquilibrium

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.inputs import Base
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.nodes.codecs.base import LinkMotions
    from robot_dynamics.nodes.codecs.flat_points import FlatRequest
    from robot_dynamics.nodes.codecs.joint_order import JointOrder
    from robot_dynamics.nodes.codecs.joint_values import JointFields

TrajectoryMessage: TypeAlias = InverseDynamics.Request | DirectDynamics.Request | StaticEquilibrium.Request
"""A request with a trajectory."""


class PointRequest(Protocol):
    """A checked request with points; their values are read range by range.

    Attributes
    ----------
    order : order of the joints.
    count : number of points.
    by_platform : whether the platforms of a robot on the ground give the motion, in place of its joints.
    links : motion of the base, or of the platforms if `by_platform`; None if there is none.
    """

    order: JointOrder
    count: int
    by_platform: bool
    links: LinkMotions | None

    def fields(self, rows: slice) -> JointFields:
        """Return the fields of the joints at a range of points."""
        ...

    def wrenches(self, rows: slice) -> dict[str, Array]:
        """Return {link name: (k, 6) or (6,)} of external wrenches at a range of points."""
        ...


class TrajectoryRequest:
    """A PointRequest with a JointTrajectory.

    Parameters
    ----------
    message, dynamics, namespace : the request, the robot, the namespace of the node.
    empty_fields : fields of points that the service computes.
    at_rest : velocities of the base may be left out.

    Raises
    ------
    InvalidInputError
        The joints, links or points do not fit the robot.
    """

    def __init__(
        self,
        message: TrajectoryMessage,
        dynamics: Dynamics,
        namespace: str,
        empty_fields: Sequence[str],
        at_rest: bool = False,
    ) -> None:
        robot = dynamics.robot
        self.by_platform = _has_platform_motion(robot, message.base.points)
        if self.by_platform and not message.trajectory.points:
            times = [point.time_from_start for point in message.base.points]
            message.trajectory.points = [JointTrajectoryPoint(time_from_start=time) for time in times]
        self.order = _match_request_joints(message.trajectory.joint_names, dynamics, namespace, self.by_platform)
        self.points: list[JointTrajectoryPoint] = message.trajectory.points
        self.count = len(self.points)
        if not self.count:
            raise InvalidInputError("the trajectory has no points: one at least is needed")
        for field in empty_fields:
            PointFields(self.points).require_empty(field, "the service computes it")
        times = []
        if message.external_wrenches or message.base.points:
            times = [to_nanoseconds(point.time_from_start) for point in self.points]
        self._wrenches = read_wrenches(message.external_wrenches, times, robot, namespace)
        self.links: LinkMotions | None
        if self.by_platform:
            description = f"the platform of {robot.name!r}"
            links = dynamics.platform.link_names
            self.links = LinkTrajectories(message.base, times, links, namespace, description, at_rest)
        else:
            self.links = check_base(message.base, times or range(self.count), robot, namespace, at_rest)

    def fields(self, rows: slice) -> PointFields:
        """Return the fields of the joints at a range of points."""
        return PointFields(self.points[rows], first=rows.start)

    def wrenches(self, rows: slice) -> dict[str, Array]:
        """Return {link name: (k, 6)} of external wrenches at a range of points."""
        return wrenches_at(self._wrenches, rows)


class FlatPointRequest:
    """A PointRequest with flat arrays.

    Parameters
    ----------
    message, dynamics, namespace : the request, the robot, the namespace of the node.

    Raises
    ------
    InvalidInputError
        The joints, links or numbers of points do not fit the robot.
    """

    def __init__(self, message: FlatRequest, dynamics: Dynamics, namespace: str) -> None:
        robot = dynamics.robot
        has_terms = isinstance(message, DynamicsTermsBatch.Request)
        self._message = message
        self.by_platform = not has_terms and _has_platform_motion(robot, message.base_poses)
        self.order = _match_request_joints(message.joint_names, dynamics, namespace, self.by_platform)
        self.count = message.count
        if not self.count:
            raise InvalidInputError("count is 0: one point at least is needed")
        self._wrenches = {} if has_terms else read_flat_wrenches(message, robot, namespace)
        self.links: LinkMotions | None = None
        names = () if has_terms else message.base_links
        if self.by_platform:
            self.links = FlatLinkMotions(message, dynamics.platform.link_names, names, namespace)
        elif robot.moving_base:
            self.links = FlatLinkMotions(message, (robot.base_link,), names, namespace)
        else:
            for field in ("base_links", "base_poses", "base_twists", "base_accelerations"):
                require_no_base(robot, getattr(message, field, ()), field)

    def fields(self, rows: slice) -> FlatFields:
        """Return the fields of the joints at a range of points."""
        return FlatFields(self._message, self.order.requested_names, rows)

    def wrenches(self, rows: slice) -> dict[str, Array]:
        """Return {link name: (k, 6) or (6,)} of external wrenches at a range of points."""
        return wrenches_at(self._wrenches, rows)


def read_base(request: PointRequest, rows: slice) -> Base | None:
    """Return the motion of a moving base at a range of points, None for a fixed base. Raises InvalidInputError."""
    return None if request.links is None else request.links.read(rows)[request.order.dynamics.robot.base_link]


def _has_platform_motion(robot: Robot, entries: Sequence[object]) -> bool:
    """Return whether entries for the base are the motion of the platforms of a robot on the ground."""
    return bool(robot.platforms) and not robot.moving_base and len(entries) > 0


def _match_request_joints(names: Sequence[str], dynamics: Dynamics, namespace: str, by_platform: bool) -> JointOrder:
    """Return the order of the joints; if the platforms give the motion, the joints need not be named."""
    return match_joints(names or (dynamics.joint_names if by_platform else []), dynamics, namespace)
