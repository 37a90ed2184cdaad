"""Names the files that are installed to share/; all else is in pyproject.toml. Read by colcon and pip."""

from pathlib import Path

from setuptools import setup

PACKAGE = "robot_dynamics"


def files_below(folder):
    """List every file below `folder` with the share directory it belongs in, as `data_files` wants it."""
    files_of = {}
    for path in sorted(Path(folder).rglob("*")):
        if path.is_file():
            files_of.setdefault(f"share/{PACKAGE}/{path.parent.as_posix()}", []).append(path.as_posix())
    return sorted(files_of.items())


setup(
    license="Apache-2.0",
    python_requires=">=3.10",
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *files_below("config"),
        *files_below("launch"),
    ],
    zip_safe=False,
)
