"""pyproject.toml and package.xml declare what the code imports; commands of the documentation see all packages."""

import ast
import os
import re
import shlex
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from robot_dynamics.optional_packages import INSTALL_SOURCES

ROOT = Path(__file__).parents[1]
INSTALLATION = (ROOT / "docs" / "how_to" / "install.md").read_text(encoding="utf-8")
EXTRAS_WITH_A_KEY = {"matplotlib", "rosbags"}  # a comment of package.xml names the others
KEYS = {
    "pyyaml": "python3-yaml",
    "lark": "python3-lark-parser",
    "yourdfpy": "python3-yourdfpy-pip",
    "rosbags": "python3-rosbags-pip",
}


@pytest.fixture(scope="module")
def declared():
    """Return the Distribution of setup.py and pyproject.toml, as colcon reads it."""
    pytest.importorskip("setuptools")  # whose distutils it is, from Python 3.12 on
    from distutils.core import run_setup

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        return run_setup("setup.py", stop_after="config")


def names(requirements):
    return {re.match(r"[\w.-]+", requirement).group().lower() for requirement in requirements}


def imported():
    """Return {imported top-level package: a file that imports it} of the library outside nodes/, functions included."""
    packages = {}
    for path in (ROOT / "robot_dynamics").rglob("*.py"):
        if "nodes" in path.parts:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            modules = []
            if isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and not node.level:
                modules = [node.module]
            elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "import_optional":
                modules = [value.value for value in ast.walk(node.args[0]) if isinstance(value, ast.Constant)]
            for module in modules:
                packages[module.partition(".")[0]] = path.name
    return {name: file for name, file in packages.items() if name not in {*sys.stdlib_module_names, "robot_dynamics"}}


@pytest.mark.slow
def test_every_package_that_is_imported_is_declared(declared):
    assert {"lark", "scipy", "rosbags", "distributed", "llvmlite"} <= set(imported())
    required, extra = declared.install_requires, [name for more in declared.extras_require.values() for name in more]
    for package, file in imported().items():
        assert package in INSTALL_SOURCES, f"{file} imports {package}, of which nothing says how it is installed"
        by_pip = INSTALL_SOURCES[package][0].partition("[")[0]
        assert by_pip in names(required) | names(extra), (
            f"{file} imports {package}, which pyproject.toml does not declare"
        )


def test_package_xml_declares_what_pyproject_does(declared):
    manifest = ElementTree.parse(ROOT / "package.xml").getroot()
    keys = {element.text for element in manifest if element.tag in ("depend", "exec_depend")}
    required = names(declared.install_requires) | EXTRAS_WITH_A_KEY
    assert EXTRAS_WITH_A_KEY <= names(name for more in declared.extras_require.values() for name in more)
    expected = {KEYS.get(name, f"python3-{name}") for name in required}
    assert {key for key in keys if key.startswith("python3-")} == expected


def clone_into(workspace):
    """Copy this checkout to the folder into which the documentation clones it."""
    (folder,) = re.findall(r"^git clone .* (src/\S+)$", INSTALLATION, re.MULTILINE)
    ignored = shutil.ignore_patterns(".*", "build", "install", "log", "__pycache__", "test", "docs")
    shutil.copytree(ROOT, workspace / folder, ignore=ignored)


@pytest.mark.parametrize(("program", "option"), [("rosdep", "--from-paths"), ("colcon", "--base-paths")])
def test_commands_of_the_documentation_find_all_packages(program, option, tmp_path, monkeypatch):
    """The programs search packages below each path, not inside a package."""
    packages = pytest.importorskip("catkin_pkg.packages", reason="catkin_pkg, by which rosdep looks, is not installed")
    lines = [line for block in re.findall(r"```bash\n(.*?)```", INSTALLATION, re.DOTALL) for line in block.splitlines()]
    (line,) = [line for line in lines if f"{program} " in line and option in line]
    words = shlex.split(line, comments=True)
    first = words.index(option) + 1
    last = next((k for k in range(first, len(words)) if words[k].startswith("-")), len(words))
    clone_into(tmp_path)
    monkeypatch.chdir(tmp_path)
    names = {package.name for path in words[first:last] for package in packages.find_packages(path).values()}
    assert names == {"robot_dynamics", "robot_dynamics_interfaces", "robot_dynamics_control"}
    assert {package.name for package in packages.find_packages("src").values()} == {"robot_dynamics"}


def test_rosdep_of_the_documentation_resolves_every_key(tmp_path):
    """The real rosdep, as on Ubuntu 24.04 with Jazzy, where its index was downloaded (`rosdep update`)."""
    rosdep = shutil.which("rosdep")
    if rosdep is None or subprocess.run([rosdep, "db", "--rosdistro", "jazzy"], capture_output=True).returncode:
        pytest.skip("rosdep is not installed, or its index was not downloaded")
    (setting, line) = re.search(r"^(\w+=1) (rosdep install .*)$", INSTALLATION, re.MULTILINE).groups()
    clone_into(tmp_path)
    arguments = [*shlex.split(line)[1:], "--simulate", "--rosdistro", "jazzy", "--os", "ubuntu:noble"]
    environment = {**os.environ, **dict([setting.split("=")])}
    done = subprocess.run(
        [rosdep, *arguments], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    for package in ("python3-scipy", "python3-lark", "ros-jazzy-rclpy", "ros-jazzy-rosidl-default-generators"):
        assert f"apt-get install -y {package}\n" in done.stdout
    assert all(f"pip3 install -U {package}" in done.stdout for package in ("yourdfpy", "rosbags"))
