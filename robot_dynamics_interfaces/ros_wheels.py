"""What a build against the ROS wheels needs. Standard library only: the bootstrap of a checkout uses it too."""

from __future__ import annotations

import os
import re
import shutil
import sys
import sysconfig
from pathlib import Path

# Include directories of the machine that the wheels were built on: those of Python, and those of NumPy.
PYTHON_INCLUDE = re.compile(r"/opt/python/[^;\"]+?/include/python3\.\d+")
NUMPY_INCLUDE = re.compile(r"/opt/python/[^;\"]+?/numpy/_?core/include")


def find_missing_build_tool() -> str | None:
    """Return which compiler or header file is missing, and the package to install; None if all are there."""
    for language, variable, names in (
        ("C", "CC", ("cc", "gcc", "clang")),
        ("C++", "CXX", ("c++", "g++", "clang++")),
    ):
        chosen = os.environ.get(variable, "").split()[:1] or names
        if not any(map(shutil.which, chosen)):
            return (
                f"no {language} compiler ({' '.join(chosen)}) on PATH to build the message types with; "
                "install build-essential"
            )
    if not Path(sysconfig.get_paths()["include"], "Python.h").is_file():
        name = f"python{sys.version_info.major}.{sys.version_info.minor}"
        return f"{name} has no header files to compile against; install {name}-dev"
    return None


def correct_include_directories(prefix: Path, python_include: str, numpy_include: str) -> None:
    """Replace include directories of the build machine in the CMake files of the ROS wheels.

    Parameters
    ----------
    prefix : Path
        Prefix that the wheels are installed in.
    python_include, numpy_include : str
        Include directories of the Python and the NumPy to compile with.
    """
    for path in prefix.glob("share/*/cmake/*.cmake"):
        text = path.read_text()
        corrected = PYTHON_INCLUDE.sub(lambda _: python_include, text)
        corrected = NUMPY_INCLUDE.sub(lambda _: numpy_include, corrected)
        if corrected != text:
            path.write_text(corrected)
