"""Empty virtual environments with the built wheels and their requirements, for each Python of WHEEL_PYTHONS.

Without this variable, which `make wheels-test` sets, the tests of this folder are skipped.
"""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DIST = ROOT / "dist"
CONSTRAINTS = ROOT / "requirements" / "constraints.txt"


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "interpreter" in metafunc.fixturenames:
        pythons = os.environ.get("WHEEL_PYTHONS", "").split()
        if "everything" in metafunc.fixturenames:
            pythons = pythons[-1:]  # all extras are large, and alike for every Python
        metafunc.parametrize("interpreter", pythons, ids=[Path(python).name for python in pythons], scope="package")


class Environment:
    """A virtual environment, and programs that run in it with nothing else of this machine."""

    def __init__(self, folder: Path, interpreter: str) -> None:
        self.folder = folder
        subprocess.run([interpreter, "-m", "venv", str(folder)], check=True, timeout=120)

    def install(self, requirement: str) -> None:
        """Install a requirement; wheels of this project come from dist/."""
        pip_install = [str(self.folder / "bin" / "python"), "-m", "pip", "install", "--quiet"]
        # Without their hashes: pip would ask for a hash of the wheels in dist/ too.
        versions = self.folder / "versions.txt"
        versions.write_text(re.sub(r" \\\n +--hash=\S+", "", CONSTRAINTS.read_text()))
        command = [*pip_install, "--find-links", str(DIST), "-c", str(versions), requirement]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600)
        assert done.returncode == 0, done.stderr

    def variables(self, scratch: Path) -> dict[str, str]:
        """Return the environment variables of a program: no compiler and no checkout can be reached by them."""
        return {
            "HOME": str(scratch),
            "PATH": str(self.folder / "bin"),
            "ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", "77"),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }

    def run(self, program: str, *arguments: str, scratch: Path) -> subprocess.CompletedProcess[str]:
        """Run an executable of the environment in the folder `scratch`."""
        return subprocess.run(
            [str(self.folder / "bin" / program), *arguments],
            cwd=scratch,
            env=self.variables(scratch),
            capture_output=True,
            text=True,
            timeout=180,
        )


@pytest.fixture(scope="package")
def core(interpreter: str, tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """Return an environment with `pip install robot_dynamics`."""
    environment = Environment(tmp_path_factory.mktemp("core"), interpreter)
    environment.install("robot_dynamics")
    return environment


@pytest.fixture(scope="package")
def with_ros(core: Environment) -> Environment:
    """Return an environment with `pip install robot_dynamics[ros]`: that of `core`, when its tests have run."""
    core.install("robot_dynamics[ros]")
    return core


@pytest.fixture(scope="package")
def everything(interpreter: str, tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """Return an environment with `pip install robot_dynamics[all]`."""
    environment = Environment(tmp_path_factory.mktemp("all"), interpreter)
    environment.install("robot_dynamics[all]")
    return environment
