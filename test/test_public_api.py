"""The public API: its names exist, have docstrings, and cost nothing until they are used."""

import inspect
import subprocess
import sys

import robot_dynamics


def test_public_names_are_few_and_resolve_to_documented_objects():
    assert len(robot_dynamics.__all__) == len({*robot_dynamics.__all__}) <= 45
    for name in robot_dynamics.__all__:
        public = getattr(robot_dynamics, name)
        assert public.__name__ == name and inspect.getdoc(public), name
        assert public.__module__.startswith("robot_dynamics."), name


def test_lazy_names_are_public_names():
    assert {*robot_dynamics._MODULES} < {*robot_dynamics.__all__}
    assert {*robot_dynamics.__all__} <= {*dir(robot_dynamics)}


def test_public_methods_have_docstrings_and_annotations():
    for name in ("Dynamics", "PlatformDynamics", "Elastodynamics", "FlexibleArm"):
        members = inspect.getmembers(getattr(robot_dynamics, name), inspect.isfunction)
        for method, function in members:
            if not method.startswith("_"):
                assert inspect.getdoc(function), f"{name}.{method}"
                signature = inspect.signature(function)
                assert signature.return_annotation is not signature.empty, f"{name}.{method}"


def test_import_of_the_package_imports_no_other_package():
    program = (
        "import sys, robot_dynamics; heavy = ['numpy', 'scipy', 'matplotlib', 'plotly', 'rosbags', 'llvmlite'];"
        "assert not [name for name in heavy if name in sys.modules]; robot_dynamics.Dynamics;"
        "assert not [name for name in heavy[2:] if name in sys.modules]"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
