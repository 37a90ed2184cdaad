"""Build hook of hatchling: compiles the service types with CMake and collects the files of the wheel."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PACKAGE = "robot_dynamics_interfaces"
# What a Python node needs, and `ros2 interface show`: neither headers nor CMake files.
DATA_PATTERNS = (
    "lib/*.so",
    "share/ament_index/resource_index/packages/*",
    "share/ament_index/resource_index/rosidl_interfaces/*",
    f"share/{PACKAGE}/srv/*",
    f"share/{PACKAGE}/package.xml",
)
UNUSED_SUFFIXES = (".c", ".pyc")


class CMakeBuildHook(BuildHookInterface):
    """Compiles the package and adds its files to the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the package and name the files of the wheel."""
        if self.target_name != "wheel" or version == "editable":
            return
        # Not inside the source folder: ament_cmake fails where the path of the build folder has a space in it.
        self._folder = tempfile.TemporaryDirectory(prefix=f"{PACKAGE}_")
        installed = Path(self._folder.name, "installed")
        compile_package(Path(self.root), Path(self._folder.name, "build"), installed)
        build_data["pure_python"] = False
        build_data["infer_tag"] = True
        build_data["force_include"] = python_files(installed)
        build_data["shared_data"] = data_files(installed)

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the build folder."""
        if hasattr(self, "_folder"):
            self._folder.cleanup()


def compile_package(source: Path, build: Path, installed: Path) -> None:
    """Compile and install the package with CMake.

    Raises RuntimeError with the reason if a tool is missing or the build fails.
    """
    missing = find_missing_build_tool()
    if missing is not None:
        raise RuntimeError(missing)
    import ament_package
    import numpy

    from_wheels = Path(ament_package.__file__).parents[4]  # <prefix>/lib/python3.x/site-packages/ament_package
    correct_include_directories(from_wheels, sysconfig.get_paths()["include"], numpy.get_include())
    environment = {**os.environ, "AMENT_PREFIX_PATH": str(from_wheels), "CMAKE_PREFIX_PATH": str(from_wheels)}
    configure = ["cmake", "-S", source, "-B", build, "-G", "Ninja", f"-DCMAKE_INSTALL_PREFIX={installed}"]
    configure += [f"-DPython3_EXECUTABLE={sys.executable}", "-DBUILD_TESTING=OFF"]
    for command in (configure, ["cmake", "--build", build], ["cmake", "--install", build]):
        done = subprocess.run(
            list(map(str, command)), env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        if done.returncode:
            raise RuntimeError(f"{' '.join(map(str, command))} failed:\n{done.stdout[-8000:]}")


def python_files(installed: Path) -> dict[str, str]:
    """Return the files of the Python package: {path: path in the wheel}."""
    (package,) = installed.glob(f"lib/python3*/*-packages/{PACKAGE}")
    return {
        str(path): path.relative_to(package.parent).as_posix()
        for path in sorted(package.rglob("*"))
        if path.is_file() and path.suffix not in UNUSED_SUFFIXES
    }


def data_files(installed: Path) -> dict[str, str]:
    """Return the files beside the Python package: {path: path below the prefix}."""
    paths = sorted(path for pattern in DATA_PATTERNS for path in installed.glob(pattern))
    return {str(path): path.relative_to(installed).as_posix() for path in paths if path.is_file()}


sys.path.insert(0, str(Path(__file__).parent))
# beside this file, which hatchling loads by its path
from ros_wheels import correct_include_directories, find_missing_build_tool  # noqa: E402
