"""Installs the Python package robot_dynamics; read by colcon (ament_python) and by pip alike."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "robot_dynamics"


def files_below(folder):
    """List every file below `folder` with the share directory it belongs in, as `data_files` wants it."""
    files_of = {}
    for path in sorted(Path(folder).rglob("*")):
        if path.is_file():
            files_of.setdefault(f"share/{PACKAGE}/{path.parent.as_posix()}", []).append(path.as_posix())
    return sorted(files_of.items())


setup(
    name=PACKAGE,
    version="0.1.0",
    description="Inverse and direct dynamic models of robots, as a Python library and as ROS 2 services",
    license="Apache-2.0",
    maintainer="robot_dynamics maintainers",
    maintainer_email="maintainers@robot-dynamics.example.org",
    # Named one by one: a bare search would also take test/ and the folder of the interface package.
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: [
            "model/formats/mdh_yaml/mdh.schema.json",
            "recordings/*.schema.json",
            "checking/*.schema.json",
            "nodes/fastdds/*.xml",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *files_below("config"),
        *files_below("launch"),
    ],
    python_requires=">=3.10",
    install_requires=[
        *("numpy>=1.26", "scipy", "lxml", "lark", "pyyaml", "jsonschema", "tabulate", "matplotlib", "tqdm"),
        "yourdfpy",  # URDFs
        *("rosbags", "mcap", "plotly"),  # bags and reports
        "clarabel",  # inertias that bodies can have
    ],
    extras_require={
        "compiled": ["llvmlite>=0.46"],  # without it models run as Python
        "fleet": ["dask[distributed]"],  # recordings on a cluster
    },
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "computed_torque = robot_dynamics.nodes.executables:computed_torque",
            "dynamics_server = robot_dynamics.nodes.executables:dynamics_server",
            "demo = robot_dynamics.nodes.executables:demo",
            "mobile_base_simulator = robot_dynamics.nodes.executables:mobile_base_simulator",
            "replay_check = robot_dynamics.nodes.executables:replay_check",
            "robot-dynamics = robot_dynamics.cli.main:main",
        ],
    },
)
