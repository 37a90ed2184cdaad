"""Versions, requirements and lists that stand in several files agree."""

import importlib
import re
from pathlib import Path

import pytest
import yaml

from robot_dynamics.optional_packages import INSTALL_SOURCES

ROOT = Path(__file__).parents[1]
INTERFACES = ROOT / "robot_dynamics_interfaces"
CONTROL = ROOT / "robot_dynamics_control"


def read(path):
    return (ROOT / path).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def tables():
    """Return pyproject.toml of both Python packages as dictionaries."""
    toml = pytest.importorskip("tomllib")  # Python 3.11
    return [toml.loads(read(folder / "pyproject.toml")) for folder in (ROOT, INTERFACES)]


def test_versions_agree(tables):
    versions = [table["project"]["version"] for table in tables]
    manifests = [read(folder / "package.xml") for folder in (ROOT, INTERFACES, CONTROL)]
    versions += re.findall("<version>(.*)</version>", "".join(manifests))
    versions += re.findall(r"^project\(.* VERSION (\S+)", read(CONTROL / "CMakeLists.txt"), re.MULTILINE)
    versions.append(yaml.safe_load(read("CITATION.cff"))["version"])
    versions.append(re.findall(r"^## \[(\d[\d.]*)\]", read("CHANGELOG.md"), re.MULTILINE)[0])
    assert len(versions) == 8 and len(set(versions)) == 1, versions


def test_nodes_need_interfaces_of_the_same_minor_version(tables):
    minor = tables[0]["project"]["version"].rpartition(".")[0]
    assert f"robot_dynamics_interfaces=={minor}.*" in tables[0]["project"]["optional-dependencies"]["ros"]
    assert f'version_gte="{minor}.0"' in read("package.xml")


def test_extras_that_messages_name_have_the_packages(tables):
    extras = tables[0]["project"]["optional-dependencies"]
    required = {requirement_name(text) for text in tables[0]["project"]["dependencies"]}
    for name, _, extra in INSTALL_SOURCES.values():
        if extra is None:
            assert requirement_name(name) in required, name
        else:
            assert requirement_name(name) in map(requirement_name, extras[extra]), (name, extra)
    assert set(re.findall(r"\w+", extras["all"][0].partition("[")[2])) == set(extras) - {"all", "ros"}


def test_colcon_has_what_builds_the_interfaces(tables):
    """What a build of the wheel needs, requirements/build.in lists, which `make colcon` installs into .venv."""
    build = {requirement_name(text) for text in tables[1]["build-system"]["requires"]}
    listed = "".join(read(f"requirements/{name}.in") for name in ("build", "setuptools")).splitlines()
    names = {requirement_name(line) for line in listed if line and not line.startswith(("#", "-r "))}
    assert build <= names and len(build) > 12
    assert "-r build.in" in read("requirements/colcon.in").splitlines()


def test_executables_are_those_that_colcon_is_checked_for(tables):
    scripts = tables[0]["project"]["scripts"]
    (listed,) = re.findall(r"for executable in ([\w ]+); do", read(".ci/run"))
    assert set(listed.split()) == set(scripts) - {"robot-dynamics"}
    for target in scripts.values():
        module, _, function = target.partition(":")
        assert callable(getattr(importlib.import_module(module), function))


def requirement_name(text):
    """Return the name of the package that a requirement names, in lower case."""
    return re.match(r"[\w.-]+", text)[0].lower()
