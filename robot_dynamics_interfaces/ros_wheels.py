"""Correction of the CMake files of the ROS wheels. Standard library only: the bootstrap of a checkout uses it too."""

from __future__ import annotations

import re
from pathlib import Path

# Include directories of the machine that the wheels were built on: those of Python, and those of NumPy.
PYTHON_INCLUDE = re.compile(r"/opt/python/[^;\"]+?/include/python3\.\d+")
NUMPY_INCLUDE = re.compile(r"/opt/python/[^;\"]+?/numpy/_?core/include")


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
