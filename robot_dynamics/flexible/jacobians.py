"""Recursive Jacobians of the nodes, and the elimination that closes the loops (Briot, eq. 3-5 and 8-14).

A Jacobian is stored as its nonzero columns, in rows: for the coordinates `numbers`, (..., k, 6), each the twist of a
frame, in its own axes at its origin, for a unit rate of the coordinate. Scalars are generic and leading axes are
batches.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.newton_euler.joint_placement import joint_placement
from robot_dynamics.newton_euler.kinematics import axis_screw, link_placements
from robot_dynamics.newton_euler.screw import twist_to_successor

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.flexible.structure import Closure, Node, Structure
    from robot_dynamics.model.robot import Robot

UNIT_TWISTS = np.eye(6, dtype=int)


class Jacobian(NamedTuple):
    """numbers: of k coordinates; rows: (..., k, 6), or another number of columns where they are not twists."""

    numbers: tuple[int, ...]
    rows: ScalarArray

    def transform(self, R: ScalarArray, P: ScalarArray) -> Jacobian:
        """Return the Jacobian of a frame with rotation R (..., 3, 3) and position P (..., 3) in this one."""
        if not self.numbers:
            return self
        return Jacobian(self.numbers, twist_to_successor(R[..., None, :, :], P[..., None, :], self.rows))

    def with_rows(self, numbers: tuple[int, ...], rows: ScalarArray) -> Jacobian:
        """Return the Jacobian with rows of some coordinates added; rows of the same coordinate add up."""
        return sum_jacobians([self, Jacobian(numbers, rows)])

    def without(self, numbers: Collection[int]) -> Jacobian:
        """Return the Jacobian without the rows of some coordinates."""
        kept = [column for column, number in enumerate(self.numbers) if number not in numbers]
        return Jacobian(tuple(self.numbers[column] for column in kept), self.rows[..., kept, :])


def sum_jacobians(jacobians: Sequence[Jacobian], signs: Sequence[int] | None = None) -> Jacobian:
    """Return the sum of Jacobians of one frame; signs: 1 or -1 of each."""
    signs = [1] * len(jacobians) if signs is None else signs
    terms = [(jacobian, sign) for jacobian, sign in zip(jacobians, signs, strict=True) if jacobian.numbers]
    rows: dict[int, ScalarArray] = {}
    for jacobian, sign in terms:
        for column, number in enumerate(jacobian.numbers):
            row = jacobian.rows[..., column, :] if sign > 0 else -jacobian.rows[..., column, :]
            rows[number] = rows[number] + row if number in rows else row
    width = terms[0][0].rows.shape[-1] if terms else 6
    stacked = np.stack(np.broadcast_arrays(*rows.values()), axis=-2) if rows else np.zeros((0, width))
    return Jacobian(tuple(rows), stacked)


class NodeKinematics(NamedTuple):
    """Jacobians and placements of each node.

    start_jacobians: of the start of its element, None without; end_jacobians: of the node itself; rotations, positions:
    in its parent.
    """

    start_jacobians: list[Jacobian | None]
    end_jacobians: list[Jacobian]
    rotations: list[ScalarArray]
    positions: list[ScalarArray]


def compute_node_kinematics(structure: Structure, q: ScalarArray) -> NodeKinematics:
    """Return the NodeKinematics of a structure at positions q (..., all joints) of the robot."""
    kinematics = NodeKinematics([], [], [], [])
    for node in structure.nodes:
        R, P = _node_placement(node, q)
        parent = Jacobian((), np.zeros((0, 6))) if node.parent is None else kinematics.end_jacobians[node.parent]
        jacobian = parent.transform(R, P)
        start = None
        if node.element is not None:
            start = jacobian
            end = np.array([node.element.length, 0.0, 0.0])
            jacobian = start.transform(np.eye(3), end)
            P = P + node.element.length * R[..., :, 0]
        if node.coordinates:
            jacobian = jacobian.with_rows(node.coordinates, own_unit_twists(structure, node))
        kinematics.start_jacobians.append(start)
        kinematics.end_jacobians.append(jacobian)
        kinematics.rotations.append(R)
        kinematics.positions.append(P)
    return kinematics


def _node_placement(node: Node, q: ScalarArray) -> tuple[ScalarArray, ScalarArray]:
    """Return rotation and position of a node, or of the start of its element, in its parent."""
    if node.joint is None:
        return node.placement[:3, :3], node.placement[:3, 3]
    return joint_placement(node.joint, q[..., node.joint_number : node.joint_number + 1])


def own_unit_twists(structure: Structure, node: Node) -> ScalarArray:
    """Return twists (k, 6) of a node for unit rates of its own coordinates."""
    if node.joint is not None:
        return axis_screw(node.joint, np.array([[node.multiplier]]))
    return UNIT_TWISTS[[3, 4, 5]] if node.is_spherical else UNIT_TWISTS[list(structure.components)]


def closure_jacobians(
    structure: Structure, kinematics: NodeKinematics, robot: Robot, q: ScalarArray
) -> list[tuple[Jacobian, Jacobian]]:
    """Return for each closure the Jacobians of its leaf and of its target, in the frame of the leaf (eq. 8 and 9)."""
    pairs = []
    for closure in structure.closures:
        target = kinematics.end_jacobians[closure.target]
        if closure.is_spherical and target.numbers:  # only the origins of the frames coincide
            rotation = _leaf_rotation(structure, closure, link_placements(robot, q))
            target = target.transform(rotation, np.zeros(3))
        pairs.append((kinematics.end_jacobians[closure.leaf], target))
    return pairs


def _leaf_rotation(
    structure: Structure, closure: Closure, placements: Sequence[tuple[ScalarArray, ScalarArray]]
) -> ScalarArray:
    """Return (..., 3, 3) of the leaf's frame in the target's, with placements (R, P) of the links."""
    leaf_node = structure.nodes[closure.leaf]
    target_node = structure.nodes[closure.target]
    leaf = placements[leaf_node.link][0] @ leaf_node.placement_in_link[:3, :3]
    target = placements[target_node.link][0] @ target_node.placement_in_link[:3, :3]
    return np.swapaxes(target, -1, -2) @ leaf


def choose_eliminated_elements(structure: Structure) -> list[tuple[int, bool]] | None:
    """Return for each closure the element whose coordinates it determines (eq. 11).

    An element is the number of its node, the last one of a chain that ends at the closure, and whether it is on the
    side of the target. None where no elements make each closure solvable by itself.
    """
    chosen: list[tuple[int, bool]] = []
    for number, closure in enumerate(structure.closures):
        element = _last_element(structure, number, closure.leaf, closure.target)
        is_swapped = element is None
        if element is None:
            element = _last_element(structure, number, closure.target, closure.leaf)
        if element is None or any(element == node for node, _ in chosen):
            return None
        chosen.append((element, is_swapped))
    return chosen


def _last_element(structure: Structure, number: int, leaf: int, opposite: int) -> int | None:
    """Return the last element before a leaf that moves neither the opposite side nor the nodes of other closures."""
    excluded = set(structure.moving_coordinates[opposite])
    for index, closure in enumerate(structure.closures):
        if index != number:
            excluded |= {*structure.moving_coordinates[closure.leaf], *structure.moving_coordinates[closure.target]}
    for node in structure.path_to_root(leaf):
        if structure.nodes[node].element is not None:
            return node if not excluded & set(structure.nodes[node].coordinates) else None
    return None


def dependent_jacobians(
    structure: Structure,
    kinematics: NodeKinematics,
    robot: Robot,
    q: ScalarArray,
    elements: Sequence[tuple[int, bool]],
) -> Mapping[tuple[int, ...], Jacobian]:
    """Return the Jacobians of eliminated elements with respect to independent coordinates (eq. 12 to 14).

    elements: as `choose_eliminated_elements` returns them. The keys are the coordinates of an element.
    """
    jacobians: dict[tuple[int, ...], Jacobian] = {}
    components = list(structure.components)
    sides = closure_jacobians(structure, kinematics, robot, q)
    for closure, (leaf, target), (element, is_swapped) in zip(structure.closures, sides, elements, strict=True):
        if is_swapped:
            leaf, target = target, leaf
        own = structure.nodes[element].coordinates
        remainder = sum_jacobians([target, leaf.without(own)], [1, -1])
        end = closure.target if is_swapped else closure.leaf
        R, P = relative_placement(structure, kinematics, end, element)
        if is_swapped and closure.is_spherical:
            R = R @ _leaf_rotation(structure, closure, link_placements(robot, q))
        inverse = np.swapaxes(R, -1, -2)  # of the 6x6 block of eq. 13: that of the inverse placement
        remainder = remainder.transform(inverse, -(inverse @ P[..., None])[..., 0])
        jacobians[own] = Jacobian(remainder.numbers, remainder.rows[..., components])
    return jacobians


def relative_placement(
    structure: Structure, kinematics: NodeKinematics, node: int, ancestor: int
) -> tuple[ScalarArray, ScalarArray]:
    """Return rotation and position of a node in one of its ancestors, undeformed."""
    R: ScalarArray = np.eye(3)
    P: ScalarArray = np.zeros(3)
    while node != ancestor:
        R_node = kinematics.rotations[node]
        P_node = kinematics.positions[node]
        R = R_node @ R
        P = P_node + (R_node @ P[..., None])[..., 0]
        node = structure.nodes[node].parent_number
    return R, P
