"""Gearboxes of an SDF: one of two revolute joints of a reference body mimics the other one."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

import numpy as np

from robot_dynamics.model.joint import Mimic

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.formats.sdf.joint_axes import JointReader
    from robot_dynamics.model.formats.sdf.poses import Poses
    from robot_dynamics.model.formats.sdf.scopes import Assembly, Node
    from robot_dynamics.model.formats.sdf.spanning_tree import JointEdge

PARALLEL = 1e-6  # largest sine of the angle between parallel axes


class GearboxReader:
    """Reads gearboxes: θ₂ = -ratio · θ₁, the angles of their child and parent in the reference body (SDF, <joint>)."""

    def __init__(self, assembly: Assembly, poses: Poses, joints: JointReader) -> None:
        self._assembly = assembly
        self._poses = poses
        self._joints = joints

    def couple(self, gearbox: JointEdge, edges: list[JointEdge]) -> None:
        """Make the joint of the parent of a gearbox mimic that of its child, in a list of the other joints."""
        node = gearbox.node
        assert node.scope is not None and node.element is not None
        document = node.scope.document
        name = document.text(node.element, "gearbox_reference_body")
        if not name:
            self._fail(node, "it needs <gearbox_reference_body>")
        reference = self._poses.link(self._assembly.find(node.scope, name, node.element))
        ratio = document.number(node.element, "gearbox_ratio", 1.0)
        if not ratio:
            self._fail(node, "its <gearbox_ratio> is 0, which no gearbox has")
        numbers, signs = [], []
        for link, tag in ((gearbox.parent, "axis"), (gearbox.child, "axis2")):
            number = self._joint_number(node, reference, link, edges)
            numbers.append(number)
            signs.append(self._sign(node, tag, edges[number], reference))
        follower, leader = (edges[number] for number in numbers)
        motion = follower.motions[0]
        if motion.mimic is not None or motion.spring is not None:
            self._fail(node, f"joint {motion.name!r} has <mimic> or a spring already: it follows the gearbox")
        mimic = Mimic(leader.motions[0].name, -signs[1] / (ratio * signs[0]))
        edges[numbers[0]] = follower._replace(motions=[motion._replace(mimic=mimic)])

    def _joint_number(self, node: Node, reference: Node, link: Node, edges: list[JointEdge]) -> int:
        """Return the number of the revolute joint between the reference body and a link."""
        for number, edge in enumerate(edges):
            if {edge.parent, edge.child} == {reference, link} and edge.kind in ("revolute", "continuous"):
                return number
        self._fail(node, f"no revolute joint is between its reference body {reference.name!r} and {link.name!r}")

    def _sign(self, node: Node, tag: str, edge: JointEdge, reference: Node) -> float:
        """Return 1 where an angle of a gearbox has the sense of a joint, -1 where it has the other one."""
        assert node.scope is not None and node.element is not None
        element = node.scope.document.child(node.element, tag)
        if element is None:
            self._fail(node, f"it has no <{tag}>")
        axis = self._in_model(node, self._joints.direction(node, element))
        cosine = float(axis @ self._in_model(edge.node, edge.motions[0].axis))
        if abs(cosine) < 1 - PARALLEL:
            self._fail(node, f"its <{tag}> is not parallel to that of joint {edge.node.name!r}")
        return float(np.sign(cosine)) * (1.0 if edge.parent is reference else -1.0)

    def _in_model(self, node: Node, axis: Array) -> Array:
        """Return a direction (3,) in the frame of a joint as one in the frame of the model."""
        return self._poses.of(node)[:3, :3] @ axis

    def _fail(self, node: Node, message: str) -> NoReturn:
        """Raise DescriptionError with the line of a gearbox."""
        assert node.scope is not None and node.element is not None
        node.scope.document.fail(node.element, f"gearbox {node.name!r}: {message}")
