"""A mode shape as bodies: beams with their sections, joints, and the rigid bodies between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import trimesh

from robot_dynamics.flexible.jacobians import compute_node_kinematics
from robot_dynamics.model.placement import rotation_with_z_along
from robot_dynamics.newton_euler.kinematics import link_placements

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from robot_dynamics.array_types import Array
    from robot_dynamics.flexible.elastodynamics import Elastodynamics
    from robot_dynamics.flexible.element import Element
    from robot_dynamics.flexible.jacobians import Jacobian
    from robot_dynamics.model.beam import Section

    IndexArray: TypeAlias = NDArray[np.integer[Any]]

SECTIONS = 7
"""Sections of an element that are drawn, its ends included."""
CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2
JOINT_SIZE = 0.02
"""Length of the symbol of a joint, relative to the extent of the robot; its radius is half of it."""
ARM_SIZE = 0.006
"""Thickness of a rigid arm, relative to the extent of the robot."""


@dataclass(frozen=True, eq=False)
class AttachedMesh:
    """A surface whose vertices move with sections of beams and with nodes.

    Attributes
    ----------
    vertices : (V, 3) at rest [m], in frame 0.
    faces : (F, 3) numbers of vertices.
    frames : (V,) number of the frame with which each vertex moves.
    """

    vertices: Array
    faces: IndexArray
    frames: IndexArray


class ModeGeometry:
    """The bodies of a robot with beams or elastic joints at a pose, and how a mode moves them.

    Parameters
    ----------
    elastodynamics : Elastodynamics
    q : ndarray, shape (all joints,)
        Positions that close the loops [rad or m].

    Attributes
    ----------
    bounds : ndarray, shape (2, 3)
        Least and greatest coordinates of the nodes [m], in frame 0.
    extent : float
        Largest extent of the structure along x, y or z of frame 0 [m].
    beams, joints, arms : AttachedMesh
        Beams with sections of the same area moments, joints that move, rigid connections between nodes.
    """

    def __init__(self, elastodynamics: Elastodynamics, q: Array) -> None:
        self._structure = elastodynamics.structure
        self._q = np.asarray(q, dtype=float)
        placements = link_placements(elastodynamics.robot, self._q)
        nodes = self._structure.nodes
        self._rotations = [placements[node.link][0] @ node.placement_in_link[:3, :3] for node in nodes]
        self._points, _ = elastodynamics.node_positions(self._q)
        self.bounds = np.array([self._points.min(axis=0), self._points.max(axis=0)])
        self.extent = float(np.ptp(self.bounds, axis=0).max()) or 1.0
        # frames that bodies move with: the nodes, then the sections of the elements
        self._origins = list(self._points)
        self.beams = self._make_beams()
        self.arms = self._make_arms()
        self.joints = self._make_joints()

    def _make_beams(self) -> AttachedMesh:
        parts = []
        for number, node in enumerate(self._structure.nodes):
            if node.element is None:
                continue
            R = self._rotations[number]
            start = self._points[number] - node.element.length * R[:, 0]
            corners = CORNERS * section_size(node.element.section)
            first = len(self._origins)
            centres = start + np.linspace(0, node.element.length, SECTIONS)[:, None] * R[:, 0]
            self._origins.extend(centres)
            vertices = centres[:, None, :] + corners @ R[:, 1:].T
            frames = np.repeat(np.arange(first, first + SECTIONS), len(CORNERS))
            parts.append(AttachedMesh(vertices.reshape(-1, 3), tube_faces(SECTIONS), frames))
        return join(parts)

    def _make_arms(self) -> AttachedMesh:
        parts = []
        for number, node in enumerate(self._structure.nodes):
            if node.parent is None or node.element is not None or self._structure.nodes[node.parent].link == 0:
                continue
            start, end = self._points[node.parent], self._points[number]
            length = np.linalg.norm(end - start)
            if length < 1e-9 * self.extent:
                continue
            across = rotation_with_z_along((end - start) / length)[:, :2]
            offsets = CORNERS * ARM_SIZE * self.extent @ across.T
            vertices = np.vstack([start + offsets, end + offsets])
            parts.append(AttachedMesh(vertices, tube_faces(2), np.repeat([node.parent, number], len(CORNERS))))
        return join(parts)

    def _make_joints(self) -> AttachedMesh:
        size = JOINT_SIZE * self.extent
        symbol = trimesh.creation.cylinder(size / 2, size, sections=16)
        parts = []
        for number, node in enumerate(self._structure.nodes):
            if node.joint is None or node.link == 0:
                continue
            vertices = self._points[number] + symbol.vertices @ self._rotations[number].T
            parts.append(AttachedMesh(vertices, np.asarray(symbol.faces), np.full(len(vertices), number)))
        return join(parts)

    def displacements(self, mode_shape: Array) -> Array:
        """Return twists (frames, 6) of nodes and sections in a mode, in frame 0: displacement [m] and rotation [rad].

        Parameters
        ----------
        mode_shape : ndarray, shape (g,)
            A row of `NaturalFrequencies.mode_shapes`, to any scale.
        """
        kinematics = compute_node_kinematics(self._structure, self._q)
        twists = [_twist(jacobian, mode_shape) for jacobian in kinematics.end_jacobians]
        result = [_turned(R, twist) for R, twist in zip(self._rotations, twists, strict=True)]
        for number, node in enumerate(self._structure.nodes):
            start = kinematics.start_jacobians[number]
            if node.element is None or start is None:
                continue
            elastic = np.zeros(6)
            if node.coordinates:
                elastic[list(self._structure.components)] = mode_shape[list(node.coordinates)]
            sections = _section_twists(node.element, _twist(start, mode_shape), elastic)
            result.extend(_turned(self._rotations[number], twist) for twist in sections)
        return np.array(result)

    def vertex_displacements(self, mesh: AttachedMesh, displacements: Array) -> Array:
        """Return the displacements (V, 3) of the vertices of a mesh, from those (frames, 6) of the frames."""
        offsets = mesh.vertices - np.array(self._origins)[mesh.frames]
        twists = displacements[mesh.frames]
        return np.asarray(twists[:, :3] + np.cross(twists[:, 3:], offsets))

    def scale(self, displacements: Array, share: float) -> float:
        """Return the factor that makes the largest displacement a share of the extent of the robot."""
        largest = np.linalg.norm(displacements[:, :3], axis=1).max(initial=0.0)
        return float(share * self.extent / largest) if largest > 0 else 0.0


def section_size(section: Section) -> Array:
    """Return the sides (2,) along y and z [m] of the rectangle with the radii of gyration of a section."""
    return np.sqrt(12 * np.array([section.second_moment_z, section.second_moment_y]) / section.area)


def tube_faces(count: int) -> IndexArray:
    """Return the faces of a closed tube of `count` rings of four corners."""
    corners = len(CORNERS)
    faces = []
    for ring in range(count - 1):
        for corner in range(corners):
            a, b = ring * corners + corner, ring * corners + (corner + 1) % corners
            faces += [(a, b, b + corners), (a, b + corners, a + corners)]
    last = (count - 1) * corners
    faces += [(0, 2, 1), (0, 3, 2), (last, last + 1, last + 2), (last, last + 2, last + 3)]
    return np.array(faces)


def join(parts: list[AttachedMesh]) -> AttachedMesh:
    """Return several meshes as one."""
    if not parts:
        return AttachedMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int), np.zeros(0, dtype=int))
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return AttachedMesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=True)]),
        np.concatenate([part.frames for part in parts]),
    )


def _twist(jacobian: Jacobian, mode_shape: Array) -> Array:
    """Return the twist (6,) of a frame in a mode, in its axes."""
    return np.asarray(mode_shape[list(jacobian.numbers)] @ jacobian.rows) if jacobian.numbers else np.zeros(6)


def _turned(R: Array, twist: Array) -> Array:
    """Return a twist (6,) in the axes in which R (3, 3) gives those that it is in."""
    return np.concatenate([R @ twist[:3], R @ twist[3:]])


def _section_twists(element: Element, start: Array, elastic: Array) -> list[Array]:
    """Return the twists (6,) of the sections that are drawn, in the axes of the element."""
    both = np.concatenate([start, elastic])
    return [element.section_jacobian(float(fraction)) @ both for fraction in np.linspace(0, 1, SECTIONS)]
