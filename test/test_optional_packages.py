"""A package that is missing stops only the tasks that need it, and one line says what to install."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from robot_dynamics import Dynamics, load_robot

ROOT = Path(__file__).parents[1]
REQUIRED = {
    "numpy": "python3-numpy",
    "scipy": "python3-scipy",
    "lxml": "python3-lxml",
    "lark": "python3-lark",
    "yaml": "python3-yaml",
    "jsonschema": "python3-jsonschema",
    "tabulate": "python3-tabulate",
    "tqdm": "python3-tqdm",
}
OPTIONAL = ("yourdfpy", "rosbags", "mcap", "plotly", "clarabel", "distributed", "dask", "llvmlite")
# An interpreter in which some packages are not installed: imports of them end as they then do.
BEGINNING = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in MISSING:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
"""
COMMAND = "from robot_dynamics.cli.main import main; sys.exit(main(sys.argv[1:]))"
EVERY_MODULE = """
import importlib, pkgutil, robot_dynamics
names = [module.name for module in pkgutil.walk_packages(robot_dynamics.__path__, "robot_dynamics.")]
assert len(names) > 150
for name in names:
    if not name.startswith("robot_dynamics.nodes.") and name != "robot_dynamics.codegen.jit.engine":
        importlib.import_module(name)
"""


def run_without(missing, *arguments, program=COMMAND):
    program = f"MISSING = {set(missing)!r}\n{BEGINNING}{program}"
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=ROOT)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return the CSV of a motion of the RX90 with the efforts of its model, an MDH table."""
    dynamics = Dynamics(load_robot("rx90"), compiled=False)
    times, rng = np.arange(0, 10, 0.01), np.random.default_rng(0)
    rates = rng.uniform(1, 4, (4, 1, len(dynamics.joint_names)))
    phases, sizes = rng.uniform(0, 6, rates.shape), rng.uniform(0.05, 0.15, rates.shape)
    angles = rates * times[:, None] + phases
    q, qd, qdd = (
        (sizes * rates**k * part).sum(0) for k, part in enumerate((np.sin(angles), np.cos(angles), -np.sin(angles)))
    )
    columns = np.stack([q, qd, dynamics.inverse(q, qd, qdd)], axis=-1).reshape(len(times), -1)
    head = [f"{name}.{kind}" for name in dynamics.joint_names for kind in ("position", "velocity", "effort")]
    path = tmp_path_factory.mktemp("recording") / "run.csv"
    np.savetxt(path, np.column_stack([times, columns]), delimiter=",", header=",".join(["time", *head]), comments="")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("package", REQUIRED)
def test_missing_required_package_is_named_in_one_line(package):
    done = run_without([package], "robots")
    assert done.returncode == 1 and not done.stdout
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"robot-dynamics needs {package}, which is not installed: pip install ")
    assert line.endswith(f", or sudo apt install {REQUIRED[package]}")


def test_missing_required_package_is_named_by_the_library():
    done = run_without(["scipy"], program="from robot_dynamics import Dynamics")
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and "robot_dynamics needs scipy, which is not installed: pip install scipy" in last
    program = "import robot_dynamics; assert not hasattr(robot_dynamics, 'no_such_name')"
    assert run_without(["scipy"], program=program).returncode == 0


@pytest.mark.slow
def test_modules_import_without_optional_packages():
    done = run_without(OPTIONAL, program=EVERY_MODULE)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_csv_and_mdh_tables_need_no_optional_packages(recording, tmp_path):
    arguments = [recording, "--robot", "rx90"]
    pictures = ["--pictures", tmp_path / "pictures"]
    checked = run_without(OPTIONAL, "replay-check", *arguments, "--faults", *pictures)
    assert checked.returncode == 0 and not checked.stderr, checked
    assert "no fault found" in checked.stdout and len(list((tmp_path / "pictures").iterdir())) == 3
    identified = run_without(OPTIONAL, "identify", *arguments)
    assert identified.returncode == 0 and "base parameters" in identified.stdout, identified
    shown = run_without(OPTIONAL, "show", "rx90")
    assert shown.returncode == 0 and "robot 'rx90'" in shown.stdout and not shown.stderr


@pytest.mark.slow
def test_shipped_robots_are_listed_without_yourdfpy():
    done, whole = run_without(["yourdfpy"], "robots"), run_without([], "robots")
    names = [[line.split()[0] for line in process.stdout.splitlines()] for process in (done, whole)]
    assert done.returncode == 0 and names[0] == names[1] and len(names[0]) > 15
    (line,) = done.stderr.splitlines()
    assert line == "robot-dynamics robots: reading a URDF needs yourdfpy, which is not installed: pip install yourdfpy"
    assert not whole.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("package", "arguments", "remedy"),
    [
        ("yourdfpy", ["show", "panda"], "reading a URDF needs yourdfpy, which is not installed: pip install yourdfpy"),
        (
            "rosbags",
            ["replay-check", "BAG", "--robot", "rx90"],
            "reading or writing a bag needs rosbags, which is not installed: pip install rosbags"
            ", part of the extra robot_dynamics[bags]",
        ),
        (
            "rosbags",
            ["replay-check", "CSV", "--robot", "rx90", "--write-golden", "NEW"],
            "reading or writing a bag needs rosbags, which is not installed: pip install rosbags"
            ", part of the extra robot_dynamics[bags]",
        ),
        (
            "plotly",
            ["replay-check", "CSV", "--robot", "rx90", "--report", "NEW.html"],
            "a report needs plotly, which is not installed: pip install plotly, part of the extra robot_dynamics[view]",
        ),
        (
            "plotly",
            ["frequencies", "navaro", "--map", "x:0:0.01:2,y:0:0.01:2", "--output", "NEW.html"],
            "a picture in HTML needs plotly, which is not installed: pip install plotly"
            ", part of the extra robot_dynamics[view]",
        ),
        (
            "viser",
            ["frequencies", "navaro", "--mode", "1", "--output", "NEW.html"],
            "a page in three dimensions needs viser, which is not installed: pip install viser"
            ", part of the extra robot_dynamics[view]",
        ),
        (
            "viser",
            ["view", "four_bar"],
            "a page in three dimensions needs viser, which is not installed: pip install viser"
            ", part of the extra robot_dynamics[view]",
        ),
        (
            "clarabel",
            ["identify", "CSV", "--robot", "rx90", "--output", "NEW.yaml"],
            "computing physically consistent inertias needs clarabel, which is not installed: pip install clarabel"
            ", part of the extra robot_dynamics[identify]",
        ),
        (
            "distributed",
            ["replay-check", "CSV", "--robot", "rx90", "--scheduler", "tcp://localhost:9"],
            "--scheduler needs distributed, which is not installed: pip install 'dask[distributed]'"
            ", part of the extra robot_dynamics[fleet]",
        ),
        (
            "matplotlib",
            ["replay-check", "CSV", "--robot", "rx90", "--pictures", "NEW"],
            "--pictures needs matplotlib, which is not installed: pip install matplotlib, part of the extra "
            "robot_dynamics[plots], or sudo apt install python3-matplotlib",
        ),
        (
            "matplotlib",
            ["map", "gough_stewart", "--over", "x:0:1:3", "--output", "NEW.png"],
            "robot-dynamics map needs matplotlib, which is not installed: pip install matplotlib, part of the extra "
            "robot_dynamics[plots], or sudo apt install python3-matplotlib",
        ),
    ],
)
def test_task_with_a_missing_package_states_the_installation(package, arguments, remedy, recording, tmp_path):
    bag = tmp_path / "run.mcap"
    bag.write_bytes(b"\x89MCAP0\r\n")
    places = {"CSV": recording, "BAG": bag, "NEW": tmp_path / "new"}
    arguments = [str(places.get(word, word)).replace("NEW", str(tmp_path / "new")) for word in arguments]
    done = run_without([package], *arguments)
    assert done.returncode == 1, done
    (line,) = done.stderr.splitlines()
    assert line in (remedy, f"robot-dynamics {arguments[0]}: {remedy}")
    assert not list(tmp_path.glob("new*"))


def test_missing_dependency_of_an_optional_package_is_named():
    program = (
        "from robot_dynamics.optional_packages import import_optional; import_optional('yourdfpy', 'reading a URDF')"
    )
    done = run_without(["trimesh"], program=program)
    assert "reading a URDF needs yourdfpy, and that trimesh, which is not installed" in done.stderr.splitlines()[-1]


@pytest.mark.parametrize("package", ["trimesh", "PIL"])
def test_tables_of_a_notebook_need_no_optional_package(package):
    program = (
        "from robot_dynamics import load_robot; text = load_robot('rx90')._repr_html_();"
        "assert text.count('<tr>') == 8, text; print(text[text.index('<p>'):][:400])"
    )
    done = run_without([package], program=program)
    assert done.returncode == 0, done.stderr
    assert "needs" in done.stdout and "pip install" in done.stdout and "robot_dynamics[view]" in done.stdout


def test_plots_of_a_notebook_become_a_line_without_matplotlib():
    program = (
        "import numpy as np; from robot_dynamics import Dynamics, load_robot; q = np.zeros((3, 6));"
        "print(Dynamics(load_robot('rx90'), compiled=False).solve(q, q, qdd=q)._repr_html_())"
    )
    done = run_without(["matplotlib"], program=program)
    assert "A plot needs matplotlib: pip install" in done.stdout and "<table>" in done.stdout, done.stderr
