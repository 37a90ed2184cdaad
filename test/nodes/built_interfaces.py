"""Packages of messages that have no wheel, made by the tools of ROS, and the environment in which they are found."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

WITHOUT = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "PYTHONPATH")


def build_interfaces(source, build, prefix):
    """Compile and install a package with CMake, and return the variables with which its types can be imported."""
    venv = Path(sys.prefix)
    cmake = shutil.which("cmake", path=venv / "bin") or shutil.which("cmake")
    if cmake is None or not (venv / "share" / "ament_cmake" / "cmake").is_dir():
        pytest.skip(f"no {source.name}, and no cmake or no ament_cmake to make it with")
    environment = {name: value for name, value in os.environ.items() if name not in WITHOUT}
    environment["PATH"] = os.pathsep.join([str(venv / "bin"), environment["PATH"]])
    environment["AMENT_PREFIX_PATH"] = environment["CMAKE_PREFIX_PATH"] = str(venv)
    options = [f"-DCMAKE_INSTALL_PREFIX={prefix}", f"-DCMAKE_INSTALL_RPATH={prefix / 'lib'}"]
    options += [f"-DPython3_EXECUTABLE={sys.executable}", "-DBUILD_TESTING=OFF"]
    for command in (["-S", source, "-B", build, "-G", "Ninja", *options], ["--build", build], ["--install", build]):
        done = subprocess.run([cmake, *map(str, command)], env=environment, capture_output=True, text=True, timeout=400)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return import_variables(prefix)


def import_variables(prefix):
    """The variables of the environment with a prefix in front."""
    (packages,) = prefix.glob(f"lib/python{sysconfig.get_python_version()}/*-packages")
    folders = {"PYTHONPATH": packages, "LD_LIBRARY_PATH": prefix / "lib", "AMENT_PREFIX_PATH": prefix}
    return {
        name: os.pathsep.join([str(folder), os.environ.get(name, "")]).rstrip(os.pathsep)
        for name, folder in folders.items()
    }
