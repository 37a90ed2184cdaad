"""Mesh files: those of real robots are Pinocchio's; a hostile name reaches no file outside the allowed folders."""

import os
import re
from dataclasses import replace

import numpy as np
import pytest
from peers.pinocchio_visuals import pinocchio_visuals
from peers.real_robots import REAL_ROBOTS, ROBOTS

from robot_dynamics import InvalidInputError, load_robot
from robot_dynamics.model.visual import MeshShape, SphereShape, Visual
from robot_dynamics.viewing import mesh_files
from robot_dynamics.viewing.mesh_files import resolve_mesh
from robot_dynamics.viewing.mesh_loading import load_visual_meshes

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture(autouse=True)
def no_packages(monkeypatch):
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)


@pytest.fixture
def package(tmp_path):
    """Return the folder of a package `arm` with urdf/ and meshes/, beside a file that is not part of it."""
    root = tmp_path / "src" / "arm"
    (root / "urdf").mkdir(parents=True)
    (root / "meshes").mkdir()
    (root / "package.xml").write_text("<package><name>arm</name></package>")
    for folder in (root / "urdf", root / "meshes", tmp_path):
        (folder / "part.obj").write_text(TRIANGLE)
    (tmp_path / "secret.obj").write_text(TRIANGLE)
    return root


def mesh(file, folder=None):
    return MeshShape(str(file), np.ones(3), folder)


def inside(package, file, packages=None):
    """Return the path of a mesh of a description in urdf/ of the package, from the root of the package."""
    return str(resolve_mesh(mesh(file, package / "urdf"), packages).relative_to(package.resolve()))


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL_ROBOTS)
def test_meshes_of_a_real_robot_are_those_of_pinocchio(name):
    robot, peer = load_robot(ROBOTS / REAL_ROBOTS[name]), pinocchio_visuals(name)
    meshes, warnings = load_visual_meshes(robot)
    assert warnings == ()
    assert list(meshes) == [k for k, visual in enumerate(robot.visuals) if isinstance(visual.shape, MeshShape)]
    indices = {frame.name: iter(peer.on_frame(frame.name)) for frame in robot.frames}
    for number, visual in enumerate(robot.visuals):
        geometry = peer.geometry.geometryObjects[next(indices[visual.frame])]
        if number in meshes:
            assert resolve_mesh(visual.shape).samefile(geometry.meshPath)
            vertices = geometry.geometry.vertices()
            expected = np.array([vertices.min(axis=0), vertices.max(axis=0)])
            bounds = np.sort(meshes[number].bounds * visual.shape.scale, axis=0)
            np.testing.assert_allclose(bounds, expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def test_files_in_the_folder_and_in_its_package(package):
    assert inside(package, "part.obj") == "urdf/part.obj"
    assert inside(package, "./part.obj") == "urdf/part.obj"
    assert inside(package, "../meshes/part.obj") == "meshes/part.obj"
    assert inside(package, package / "meshes" / "part.obj") == "meshes/part.obj"
    assert inside(package, f"file://{package}/meshes/part.obj") == "meshes/part.obj"
    assert inside(package, "package://arm/meshes/part.obj") == "meshes/part.obj"
    assert inside(package, "package:///arm/meshes/part.obj") == "meshes/part.obj"


def test_packages_that_the_caller_gives(package):
    packages = {"parts": package}
    file = "package://parts/meshes/part.obj"
    assert resolve_mesh(mesh(file), packages) == (package / "meshes" / "part.obj").resolve()
    assert resolve_mesh(mesh(package / "meshes" / "part.obj"), packages)
    with pytest.raises(InvalidInputError, match="no package 'parts' is known"):
        resolve_mesh(mesh(file))
    with pytest.raises(InvalidInputError, match="there is no such file"):  # the given folder counts, not that around it
        resolve_mesh(mesh("package://arm/meshes/part.obj", package / "urdf"), {"arm": package / "urdf"})


@pytest.mark.parametrize("variable", ["AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH"])
def test_packages_of_the_environment(package, variable, monkeypatch, tmp_path):
    prefix = tmp_path / "install"
    share = prefix / "share" if variable == "AMENT_PREFIX_PATH" else prefix
    share.mkdir(parents=True)
    package.rename(share / "arm")
    monkeypatch.setenv(variable, f"/nowhere:{prefix}:relative")
    expected = (share / "arm" / "meshes" / "part.obj").resolve()
    assert resolve_mesh(mesh("package://arm/meshes/part.obj")) == expected
    assert resolve_mesh(mesh(f"file://{expected}")) == expected
    (share / "secret.obj").write_text(TRIANGLE)
    with pytest.raises(InvalidInputError, match="is outside"):
        resolve_mesh(mesh(f"file://{share}/secret.obj"))


def test_workspace_built_with_symlinks(package, monkeypatch, tmp_path):
    installed = tmp_path / "install" / "share" / "arm" / "meshes"
    installed.mkdir(parents=True)
    (installed / "part.obj").symlink_to(package / "meshes" / "part.obj")
    (installed / "secret.obj").symlink_to(tmp_path / "secret.obj")
    (tmp_path / "src" / "hand").mkdir()
    (tmp_path / "src" / "hand" / "package.xml").write_text("<package><name>hand</name></package>")
    (tmp_path / "src" / "hand" / "part.obj").write_text(TRIANGLE)
    (installed / "hand.obj").symlink_to(tmp_path / "src" / "hand" / "part.obj")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    assert resolve_mesh(mesh("package://arm/meshes/part.obj")) == (package / "meshes" / "part.obj").resolve()
    for name in ("secret", "hand"):
        with pytest.raises(InvalidInputError, match="is not inside package 'arm'"):
            resolve_mesh(mesh(f"package://arm/meshes/{name}.obj"))


HOSTILE = {
    "absolute": ("{root}/secret.obj", "outside"),
    "absolute url": ("file://{root}/secret.obj", "outside"),
    "parents": ("../../../secret.obj", "outside"),
    "parents in a url": ("file://../../../secret.obj", "outside"),
    "parents in a package": ("package://arm/../../secret.obj", "not inside package 'arm'"),
    "parents twice": ("package://arm/meshes/../../../secret.obj", "not inside package 'arm'"),
    "two slashes": ("package://arm//{root}/secret.obj", "no such file"),
    "package of dots": ("package://../secret.obj", "not the name of a package"),
    "package of a dot": ("package://./secret.obj", "not the name of a package"),
    "package with a slash": ("package://arm%2f..%2f/secret.obj", "not the name of a package"),
    "package with a backslash": ("package://arm\\..\\x/secret.obj", "not the name of a package"),
    "empty package": ("package://", "known are files"),
    "package without a file": ("package://a.obj", "no package 'a.obj' is known"),
    "folder above that is no package": ("package://src/arm/meshes/part.obj", "no package 'src' is known"),
    "root as package": ("package://{first}/secret.obj", "no package .* is known"),
    "link": ("link.obj", "outside"),
    "link in a package": ("package://arm/urdf/link.obj", "not inside"),
    "folder that is a link": ("up/secret.obj", "outside"),
    "loop of links": ("loop.obj", ""),
    "link to another kind": ("kind.obj", "known are files"),
    "passwords": ("file:///etc/passwd", "known are files"),
    "http": ("http://localhost/part.obj", "http:// is not read"),
    "https": ("https://localhost/part.obj", "https:// is not read"),
    "model": ("model://arm/part.obj", "model:// is not read"),
    "case": ("PACKAGE://arm/meshes/part.obj", "PACKAGE:// is not read"),
    "home": ("~/secret.obj", "no such file"),
    "variable": ("$HOME/secret.obj", "no such file"),
    "NUL": ("part.obj\0.obj", "not the name of a file"),
    "long": ("a" * 5000 + ".obj", "not the name of a file"),
    "long component": ("a" * 900 + ".obj", ""),
    "device": ("/dev/zero", "known are files"),
    "pipe": ("pipe.obj", "not a regular file"),
    "folder": ("folder.obj", "not a regular file"),
    "missing": ("none.obj", "no such file"),
    "huge": ("huge.stl", "more than"),
    "other kind": ("../package.xml", "known are files"),
    "empty": ("", "known are files"),
    "dots": ("..", "known are files"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_name_is_refused_unopened(case, package, tmp_path, monkeypatch):
    file, reason = HOSTILE[case]
    urdf = package / "urdf"
    (urdf / "link.obj").symlink_to(tmp_path / "secret.obj")
    (urdf / "kind.obj").symlink_to(package / "package.xml")
    (urdf / "loop.obj").symlink_to(urdf / "loop.obj")
    (urdf / "up").symlink_to(tmp_path)
    (urdf / "folder.obj").mkdir()
    os.mkfifo(urdf / "pipe.obj")
    with (urdf / "huge.stl").open("wb") as sparse:
        sparse.truncate(mesh_files.MAX_MESH_BYTES + 1)

    shape = mesh(file.format(root=tmp_path, first=tmp_path.parts[1]), urdf)
    robot = replace(load_robot("panda"), visuals=(Visual("panda_link1", np.eye(4), shape),))

    def refuse(*_, **__):
        raise AssertionError("a file was opened")

    for module_or_class, name in ((os, "open"), (mesh_files.Path, "open"), (mesh_files.Path, "read_bytes")):
        monkeypatch.setattr(module_or_class, name, refuse)
    with pytest.raises(InvalidInputError, match=f"is not read: .*{reason}") as error:
        resolve_mesh(shape)
    assert len(str(error.value)) < 500
    meshes, (warning,) = load_visual_meshes(robot)
    begin = "mesh " if "no package" in warning else "link 'panda_link1': mesh "
    assert not meshes and warning.startswith(begin) and len(warning) < 600


def test_description_without_a_folder_names_no_relative_file(package, monkeypatch):
    monkeypatch.chdir(package / "urdf")
    with pytest.raises(InvalidInputError, match="the path is relative, but the description is a text"):
        resolve_mesh(mesh("part.obj"))
    with pytest.raises(InvalidInputError, match="outside"):
        resolve_mesh(mesh(package / "urdf" / "part.obj"))


def test_description_outside_a_package_names_files_of_its_folder_only(tmp_path):
    (tmp_path / "down").mkdir()
    for path in (tmp_path / "part.obj", tmp_path / "down" / "part.obj"):
        path.write_text(TRIANGLE)
    assert resolve_mesh(mesh("down/part.obj", tmp_path))
    with pytest.raises(InvalidInputError, match="outside"):
        resolve_mesh(mesh("../part.obj", tmp_path / "down"))
    with pytest.raises(InvalidInputError, match="no package"):
        resolve_mesh(mesh(f"package://{tmp_path.name}/part.obj", tmp_path / "down"))


def test_missing_meshes_are_warnings_and_the_others_are_loaded(package):
    def visual(shape):
        return Visual("panda_link1", np.eye(4), shape)

    names = ["part.obj", "none.obj", "../meshes/part.obj", "part.obj", "none.obj"]
    shapes = [SphereShape(1.0), *(mesh(name, package / "urdf") for name in names)]
    robot = replace(load_robot("panda"), visuals=tuple(map(visual, shapes)))
    meshes, warnings = load_visual_meshes(robot)
    assert list(meshes) == [1, 3, 4] and meshes[1] is meshes[4] is not meshes[3]
    assert warnings == ("link 'panda_link1': mesh 'none.obj' is not read: there is no such file",)


def test_number_of_warnings_is_limited(package):
    shapes = (mesh(f"none_{number}.obj", package) for number in range(500))
    visuals = tuple(Visual("panda_link1", np.eye(4), shape) for shape in shapes)
    meshes, warnings = load_visual_meshes(replace(load_robot("panda"), visuals=visuals))
    assert not meshes and len(warnings) == 21 and warnings[-1] == "480 further meshes are not read"


def test_unknown_package_is_named_once():
    """Of all meshes of a real robot, whose package is not known."""
    text = (ROBOTS / "panda_description" / "urdf" / "panda.urdf").read_text()
    robot = load_robot(text.replace("package://", "package://unknown_"))
    _, warnings = load_visual_meshes(robot)
    (warning,) = warnings
    assert re.match(r"\d+ meshes, 'package://unknown_.*' and others, are not read: no package 'unknown_", warning)
    assert warning.count("--package") == 1
