"""Positions of sliding joints at which no loop can close, by the lengths of links alone.

Links that form a closed polygon cannot have one that is longer than all others together. The polygons are the loops,
and each two loops that share joints, without these joints: a platform that two legs carry, whose position is unknown.
A polygon has one side in each link, between the points at which the next links are attached. Sides depend on sliding
joints only, so that the bound holds for all positions of the other joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.errors import SingularModelError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.constraints.topology import ConstraintTopology
    from robot_dynamics.model.robot import Robot

MAX_PAIRS = 500
"""Pairs of loops that are considered: more take longer to find than a search for closed positions."""
BLOCK_SIZE = 1000
"""Samples that are checked together, for the memory that their sides take."""
ROUNDING = 1e-9
"""Gap, as a part of the longest side and the characteristic length, that rounding and the closure may leave."""


class _Point(NamedTuple):
    """A point of a link at P + Z q (3,), for positions q (all joints,)."""

    P: Array
    Z: Array


class _Connection(NamedTuple):
    """Points of two links, by number, that coincide."""

    links: tuple[int, int]
    points: tuple[_Point, _Point]


class Reach:
    """The polygons of the loops of a robot that contain independent sliding joints, and no dependent ones.

    Parameters
    ----------
    topology : ConstraintTopology

    Notes
    -----
    Positions q (N, n) are those of the independent joints.
    """

    def __init__(self, topology: ConstraintTopology) -> None:
        robot = topology.robot
        self._length = robot.characteristic_length
        self._columns = topology.independent_columns
        self._names: list[str] = []
        sides: list[_Point] = []
        first_sides: list[int] = []
        moved = np.flatnonzero(topology.S[:, self._columns].any(axis=-1))
        has_slides = any(robot.joints[number].prismatic for number in moved if number in robot.joints_in_loops)
        for names, polygon in _polygons(robot) if has_slides else ():
            Z = np.array([side.Z for side in polygon]) @ topology.S
            if Z[..., self._columns].any() and not Z[..., topology.dependent_columns].any():
                self._names.append(names)
                first_sides.append(len(sides))
                sides += polygon
        self._first_sides = np.array(first_sides, dtype=int)
        self._side_counts = np.diff([*first_sides, len(sides)])
        Z = np.array([side.Z for side in sides]).reshape(len(sides), 3, len(robot.joints))
        self._P = np.array([side.P for side in sides]).reshape(len(sides), 3) + Z @ topology.offset
        self._Z = Z @ topology.S[:, self._columns]

    def gaps(self, q: Array) -> Array:
        """Least gaps [m] (N, polygons) that the links leave at q (N, n), zero where the loops may close."""
        vectors = self._P + np.einsum("sxn,kn->ksx", self._Z, q)
        sides = np.hypot(np.hypot(vectors[..., 0], vectors[..., 1]), vectors[..., 2])
        longest = np.maximum.reduceat(sides, self._first_sides, axis=-1)
        ratios = sides / np.repeat(longest, self._side_counts, axis=-1)  # their sum does not overflow
        gaps = longest * (2 - np.add.reduceat(ratios, self._first_sides, axis=-1))
        result: Array = np.where(gaps > ROUNDING * (longest + self._length), gaps, 0.0)
        return result

    def is_far(self, q: Array) -> BoolArray:
        """(N,) whether the links leave a gap of more than the characteristic length at q (N, n).

        A search for closed positions cannot succeed there. It takes a second, and finds by how much each loop stays
        open, which users want to know of smaller gaps.
        """
        if not self._names:
            return np.zeros(len(q), dtype=bool)
        far = np.empty(len(q), dtype=bool)
        with np.errstate(all="ignore"):
            for first in range(0, len(q), BLOCK_SIZE):
                block = slice(first, first + BLOCK_SIZE)
                far[block] = (self.gaps(q[block]) > self._length).any(axis=-1)
        return far

    def refuse_far(self, q: Array, numbers: Sequence[int] | IntArray, many: bool = False) -> None:
        """Raise SingularModelError for the first sample of q (N, n) that `is_far`.

        numbers: of the samples, for messages; many: whether they name the sample.
        """
        far = self.is_far(q)
        if not far.any():
            return
        sample = int(np.argmax(far))
        with np.errstate(all="ignore"):
            gaps = self.gaps(q[sample : sample + 1])[0]
        location = f" at sample {numbers[sample]}" if many else ""
        raise SingularModelError(
            f"{self._names[int(np.argmax(gaps))]} does not close{location}: its links leave a gap of at least "
            f"{gaps.max():.3g} m, wherever its other joints are. These positions are out of reach"
        )


def _polygons(robot: Robot) -> Iterator[tuple[str, list[_Point]]]:
    """Yield the names of the loops of each polygon, and its sides: vectors in the links."""
    connections = _connections(robot)
    cycles = [robot.joints_in_loop(loop) | {len(robot.joints) + k} for k, loop in enumerate(robot.loops)]
    for loop, cycle in zip(robot.loops, cycles, strict=True):
        sides = _sides([connections[number] for number in sorted(cycle)])
        if sides is not None:
            yield f"loop {loop.name!r}", sides
    pairs = combinations(zip(robot.loops, cycles, strict=True), 2)
    for (first, cycle), (second, other) in islice((pair for pair in pairs if pair[0][1] & pair[1][1]), MAX_PAIRS):
        sides = _sides([connections[number] for number in sorted(cycle ^ other)])
        if sides is not None:
            yield f"loop {first.name!r}, with {second.name!r},", sides


def _connections(robot: Robot) -> list[_Connection]:
    """Connections of the joints, then of the loops, by number."""
    count = len(robot.joints)
    still = np.zeros((3, count))
    connections = []
    for number, joint in enumerate(robot.joints):
        Z = still.copy()
        if joint.prismatic:
            Z[:, number] = joint.rotation[:, 2]
        points = _Point(joint.placement[:3, 3], Z), _Point(np.zeros(3), still)
        connections.append(_Connection((joint.antecedent, number + 1), points))
    for loop in robot.loops:
        first, second = (_Point(end.placement[:3, 3], still) for end in loop.ends)
        connections.append(_Connection((loop.moved.link, loop.closed_on.link), (first, second)))
    return connections


def _sides(connections: Sequence[_Connection]) -> list[_Point] | None:
    """Vectors between the two points in each link; None where the connections are not a single cycle of links."""
    points: dict[int, list[_Point]] = {}
    neighbours: dict[int, list[int]] = {}
    for connection in connections:
        for link, other, point in zip(connection.links, connection.links[::-1], connection.points, strict=True):
            points.setdefault(link, []).append(point)
            neighbours.setdefault(link, []).append(other)
    if any(len(ends) != 2 for ends in points.values()):
        return None
    start = connections[0].links[0]
    visited = {start}
    front = [start]
    while front:
        new = {*neighbours[front.pop()]} - visited
        visited |= new
        front += new
    if visited != set(points):
        return None
    return [_Point(first.P - second.P, first.Z - second.Z) for first, second in points.values()]
