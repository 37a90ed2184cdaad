"""Meshes from files. Of other files the colours in a .mtl beside an .obj are read: no texture, no further buffer."""

from __future__ import annotations

import io
import os
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.errors import InvalidInputError, MissingPackageError
from robot_dynamics.model.visual import MeshShape
from robot_dynamics.optional_packages import import_optional
from robot_dynamics.viewing.mesh_files import MAX_MESH_BYTES, MESH_SUFFIXES, UnknownPackageError, resolve_mesh
from robot_dynamics.viewing.mesh_materials import MaterialFiles, NoFiles
from robot_dynamics.viewing.mesh_sizes import MAX_FACES, check_mesh_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from trimesh import Trimesh

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.mesh_sizes import SafeMesh

MAX_ROBOT_BYTES = 2 * MAX_MESH_BYTES
"""Size of all mesh files of one robot together."""

MAX_WARNINGS = 20
DEFAULT_COLOUR = (200, 200, 200, 255)  # of parts without a material beside others with one


def load_visual_meshes(
    robot: Robot, packages: Mapping[str, Path] | None = None
) -> tuple[dict[int, Trimesh], tuple[str, ...]]:
    """Load the meshes of all visuals of a robot.

    Parameters
    ----------
    robot : Robot
        The robot.
    packages : mapping of str to Path, optional
        Folders of packages by name, as for `resolve_mesh`.

    Returns
    -------
    meshes : dict of int to trimesh.Trimesh
        Meshes by the index of their visual in `robot.visuals`, in the units of their files: multiply the coordinates
        by `MeshShape.scale`. Visuals with the same file share one mesh.
    warnings : tuple of str
        A sentence for each package that is not known, and for each file that is missing, refused or broken, with the
        link that has it.
    """
    meshes: dict[int, Trimesh] = {}
    by_path: dict[Path, Trimesh] = {}
    packageless: dict[str, set[str]] = {}
    failures: dict[str, str] = {}
    size = 0
    for number, visual in enumerate(robot.visuals):
        if not isinstance(visual.shape, MeshShape) or visual.shape.file in failures:
            continue
        try:
            path = resolve_mesh(visual.shape, packages)
            if path not in by_path:
                size += path.stat().st_size
                if size > MAX_ROBOT_BYTES:
                    raise InvalidInputError(f"mesh {path.name!r}: the files have more than {MAX_ROBOT_BYTES} bytes")
                by_path[path] = load_mesh(path)
            meshes[number] = by_path[path]
        except UnknownPackageError as error:
            packageless.setdefault(error.reason, set()).add(visual.shape.file)
        except (InvalidInputError, MissingPackageError, OSError) as error:
            failures[visual.shape.file] = f"link {visual.frame[:60]!r}: {error}"
    warnings = [f"{_describe_meshes(files)} not read: {reason}" for reason, files in packageless.items()]
    warnings += failures.values()
    if len(warnings) > MAX_WARNINGS:
        warnings[MAX_WARNINGS:] = [f"{len(warnings) - MAX_WARNINGS} further meshes are not read"]
    return meshes, tuple(warnings)


def _describe_meshes(files: set[str]) -> str:
    first = sorted(files)[0][:200]
    return f"mesh {first!r} is" if len(files) == 1 else f"{len(files)} meshes, {first!r} and others, are"


def load_mesh(path: Path) -> Trimesh:
    """Load a mesh from a file.

    Parameters
    ----------
    path : Path
        Path of a .stl, .obj, .dae, .ply or .glb, such as `resolve_mesh` returns.

    Returns
    -------
    trimesh.Trimesh
        All parts of the file as one mesh, with the colours of its materials where it is a .dae, .glb or .obj. The
        coordinates are those of the file, as RViz takes them: a .dae in metres by its unit, its up axis ignored.

    Raises
    ------
    InvalidInputError
        If the file is no mesh, or one with more than MAX_FACES triangles. The message does not quote the content.
    MissingPackageError
        If trimesh, or for a .dae pycollada, is not installed.
    """
    kind = path.suffix.lower()
    if kind not in MESH_SUFFIXES:
        raise InvalidInputError(f"mesh {path.name!r}: known are files {', '.join(MESH_SUFFIXES)}")
    trimesh = import_optional("trimesh", "reading a mesh")
    if kind == ".dae":
        import_optional("collada", "reading a .dae")
    content = _read_bytes(path)
    try:
        safe = check_mesh_text(content, kind)
        scene = trimesh.load_scene(
            io.BytesIO(safe.content),
            file_type=kind[1:],
            resolver=_material_files(path, kind),
            skip_materials=kind not in (".obj", ".glb"),
            process=False,
        )
        return _join(trimesh, scene, safe)
    except InvalidInputError as error:
        raise InvalidInputError(f"mesh {path.name!r}: {error}") from None
    except Exception as error:  # parsers raise any error for a broken file
        raise InvalidInputError(f"mesh {path.name!r} cannot be read as {kind} ({type(error).__name__})") from None


def _material_files(path: Path, kind: str) -> MaterialFiles:
    """Return the resolver for the files that a mesh refers to."""
    return MaterialFiles(lambda name: _read_bytes(path.parent / name)) if kind == ".obj" else NoFiles()


def _read_bytes(path: Path) -> bytes:
    """Return the content of a regular file, which is opened without waiting and without following a link."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise InvalidInputError(f"mesh {path.name!r} is not a regular file")
            content = file.read(MAX_MESH_BYTES + 1)
    except (OSError, ValueError) as error:
        raise InvalidInputError(f"mesh {path.name!r} cannot be read ({getattr(error, 'strerror', error)})") from None
    if len(content) > MAX_MESH_BYTES:
        raise InvalidInputError(f"mesh {path.name!r} has more than {MAX_MESH_BYTES} bytes")
    return content


def _join(trimesh: Any, scene: Any, safe: SafeMesh) -> Trimesh:
    """Return all triangles of a scene as one mesh."""
    parts = []
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        geometry = scene.geometry[name]
        if isinstance(geometry, trimesh.Trimesh) and len(geometry.faces):
            parts.append((np.array(matrix, dtype=float), geometry))
    count = sum(len(geometry.faces) for _, geometry in parts)
    if not 0 < count <= MAX_FACES:
        raise InvalidInputError(f"it has {count} triangles, 1 to {MAX_FACES} are needed")
    starts = np.cumsum([0, *(len(geometry.vertices) for _, geometry in parts)])
    vertices = np.concatenate([_transform(matrix, geometry.vertices) for matrix, geometry in parts]) * safe.unit
    faces = np.concatenate([geometry.faces + start for start, (_, geometry) in zip(starts, parts, strict=False)])
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise InvalidInputError("it has coordinates that are not finite, or triangles without vertices")
    mesh: Trimesh = trimesh.Trimesh(vertices, faces, face_colors=_face_colours(parts), process=False)
    mesh.merge_vertices()
    return mesh


def _transform(matrix: Array, vertices: Array) -> Array:
    """Return vertices (n, 3) moved by a matrix (4, 4)."""
    result: Array = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return result


def _face_colours(parts: list[tuple[Array, Any]]) -> Any:
    """Return the colours (n, 4) of all triangles from the materials of their parts; None where no part has one."""
    if not any(_has_material(geometry) for _, geometry in parts):
        return None
    colours = [
        geometry.visual.material.main_color if _has_material(geometry) else DEFAULT_COLOUR for _, geometry in parts
    ]
    return np.repeat(np.array(colours, np.uint8), [len(geometry.faces) for _, geometry in parts], axis=0)


def _has_material(geometry: Any) -> bool:
    """Return whether a part has a material with a colour."""
    return geometry.visual.kind == "texture" and geometry.visual.material is not None
