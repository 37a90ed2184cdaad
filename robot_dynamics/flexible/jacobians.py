"""Recursive Jacobians of the nodes, and the elimination that closes the loops (Briot, eq. 3-5 and 8-14).

A Jacobian is kept as its columns that are not zero, as rows: for the coordinates `numbers`, (..., k, 6), each the twist
of a frame, in its own axes at its origin, that a unit rate of the coordinate causes. Scalars are generic and leading
axes are batches.
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.newton_euler.kinematics import axis_screw, joint_placement, link_placements
from robot_dynamics.newton_euler.screw import twist_to_successor

UNIT_TWISTS = np.eye(6, dtype=int)


class Jacobian(NamedTuple):
    """numbers: of k coordinates; rows: (..., k, 6), or as many columns as what they move has."""

    numbers: tuple
    rows: np.ndarray

    def transform(self, R, P):
        """Of a frame that the rotation R (..., 3, 3) and the position P (..., 3) place in this one."""
        if not self.numbers:
            return self
        return Jacobian(self.numbers, twist_to_successor(R[..., None, :, :], P[..., None, :], self.rows))

    def with_rows(self, numbers, rows):
        """With rows for some coordinates added; a coordinate that is there already moves the sum."""
        return sum_jacobians([self, Jacobian(numbers, rows)])

    def without(self, numbers):
        kept = [column for column, number in enumerate(self.numbers) if number not in numbers]
        return Jacobian(tuple(self.numbers[column] for column in kept), self.rows[..., kept, :])


def sum_jacobians(jacobians, signs=None):
    """The sum of Jacobians of one frame; signs: 1 or -1 for each."""
    signs = [1] * len(jacobians) if signs is None else signs
    told = [(one, sign) for one, sign in zip(jacobians, signs, strict=True) if one.numbers]
    rows = {}
    for one, sign in told:
        for column, number in enumerate(one.numbers):
            row = one.rows[..., column, :] if sign > 0 else -one.rows[..., column, :]
            rows[number] = rows[number] + row if number in rows else row
    width = told[0][0].rows.shape[-1] if told else 6
    stacked = np.stack(np.broadcast_arrays(*rows.values()), axis=-2) if rows else np.zeros((0, width))
    return Jacobian(tuple(rows), stacked)


class NodeKinematics(NamedTuple):
    """What the sweep leaves, for each node: begins, the Jacobian of the beginning of its element, None without; ends,
    its own; rotations, positions: how it stands in its parent."""

    start_jacobians: list
    end_jacobians: list
    rotations: list
    positions: list


def compute_node_kinematics(structure, q):
    """The Motion of a Structure where its robot's joints have positions q (..., all joints)."""
    motion = NodeKinematics([], [], [], [])
    for node in structure.nodes:
        R, P = (node.placement[:3, :3], node.placement[:3, 3]) if node.joint is None else joint_placement(
            node.joint, q[..., node.joint_number : node.joint_number + 1]
        )  # fmt: skip
        before = Jacobian((), np.zeros((0, 6))) if node.parent is None else motion.end_jacobians[node.parent]
        here = before.transform(R, P)
        begin = None
        if node.element is not None:
            begin, tip = here, np.array([node.element.length, 0.0, 0.0])
            here, P = begin.transform(np.eye(3), tip), P + node.element.length * R[..., :, 0]
        if node.coordinates:
            here = here.with_rows(node.coordinates, own_unit_twists(structure, node))
        for kept, value in zip(motion, (begin, here, R, P), strict=True):
            kept.append(value)
    return motion


def own_unit_twists(structure, node):
    """(k, 6) twists of a node for unit rates of its own coordinates."""
    if node.joint is not None:
        return axis_screw(node.joint, np.array([[node.multiplier]]))
    return UNIT_TWISTS[[3, 4, 5]] if node.is_spherical else UNIT_TWISTS[list(structure.components)]


def closure_jacobians(structure, motion, robot, q):
    """For each closure the Jacobians of its leaf and of its target, both at the frame of the leaf (eq. 8 and 9)."""
    found = []
    for closure in structure.closures:
        target = motion.end_jacobians[closure.target]
        if closure.is_spherical and target.numbers:  # the frames coincide in their origins only
            turned = _rotation(structure, closure, link_placements(robot, q))
            target = target.transform(turned, np.zeros(3))
        found.append((motion.end_jacobians[closure.leaf], target))
    return found


def _rotation(structure, closure, placements):
    """(..., 3, 3) of the leaf's frame in the target's."""
    leaf, target = (placements[node.link][0] @ node.placement_in_link[:3, :3]
                    for node in (structure.nodes[closure.leaf], structure.nodes[closure.target]))  # fmt: skip
    return np.swapaxes(target, -1, -2) @ leaf


def choose_eliminated_elements(structure):
    """For each closure (node whose element's coordinates it determines, whether that is on the side of the target),
    the last element of a chain that ends there; None where elements cannot be chosen so that each closure is solved by
    itself (eq. 11)."""
    chosen = []
    for number, closure in enumerate(structure.closures):
        found = _last_element(structure, number, closure.leaf, closure.target)
        swapped = found is None
        if swapped:
            found = _last_element(structure, number, closure.target, closure.leaf)
        if found is None or any(found == node for node, _ in chosen):
            return None
        chosen.append((found, swapped))
    return chosen


def _last_element(structure, number, leaf, other):
    """The last element before a leaf that moves neither the other side nor anything that another closure binds."""
    elsewhere = set(structure.moving_coordinates[other])
    for another, closure in enumerate(structure.closures):
        if another != number:
            elsewhere |= {*structure.moving_coordinates[closure.leaf], *structure.moving_coordinates[closure.target]}
    for node in structure.path_to_root(leaf):
        if structure.nodes[node].element is not None:
            return node if not elsewhere & set(structure.nodes[node].coordinates) else None
    return None


def dependent_jacobians(structure, motion, robot, q, elements):
    """{numbers of an element's coordinates: Jacobian that tells them by the independent ones} (eq. 12 to 14)."""
    found = {}
    components = list(structure.components)
    sides = closure_jacobians(structure, motion, robot, q)
    for closure, (leaf, target), (element, swapped) in zip(structure.closures, sides, elements, strict=True):
        if swapped:
            leaf, target = target, leaf
        own = structure.nodes[element].coordinates
        rest = sum_jacobians([target, leaf.without(own)], [1, -1])
        R, P = relative_placement(structure, motion, closure.target if swapped else closure.leaf, element)
        if swapped and closure.is_spherical:
            turned = _rotation(structure, closure, link_placements(robot, q))
            R, P = R @ turned, P
        inverse = np.swapaxes(R, -1, -2)  # of the 6x6 block of eq. 13: that of the inverse placement
        rest = rest.transform(inverse, -(inverse @ P[..., None])[..., 0])
        found[own] = Jacobian(rest.numbers, rest.rows[..., components])
    return found


def relative_placement(structure, motion, node, ancestor):
    """(R, P) of a node in one that it hangs on, where nothing bends."""
    R, P = np.eye(3), np.zeros(3)
    while node != ancestor:
        R_node, P_node = motion.rotations[node], motion.positions[node]
        R, P, node = R_node @ R, P_node + (R_node @ P[..., None])[..., 0], structure.nodes[node].parent
    return R, P
