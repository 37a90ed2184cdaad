"""The table of a control model in C says what the description says, and its functions compute what the laws compute."""

import ctypes
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from peers.elastic_3rps import elastic_3rps
from peers.traced_models import shipped_robot

from robot_dynamics import Dynamics, Inertia, InvalidInputError, load_robot
from robot_dynamics.cli.main import main
from robot_dynamics.codegen.emit.control_model import c_string, control_model_source
from robot_dynamics.control.control_law import actuated_joint_names
from robot_dynamics.control.exported_model import export_control_model
from robot_dynamics.control.law_models import LawModels
from robot_dynamics.control.series_elastic_actuators import find_series_elastic_actuators
from robot_dynamics.model.inertia import symmetric_entries

INCLUDE = Path(__file__).parents[3] / "robot_dynamics_control" / "include"
STRICT = "-std=c99 -pedantic -Wall -Wextra -Werror -Wconversion -Wmissing-prototypes -Wundef".split()
COMPILER = shutil.which("cc")
CPP_COMPILER = shutil.which("c++")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler is here")

DOUBLES = ctypes.POINTER(ctypes.c_double)
INDICES = ctypes.POINTER(ctypes.c_uint32)


class Joint(ctypes.Structure):
    _fields_ = [
        ("name", ctypes.c_char_p),
        *((name, ctypes.c_double) for name in ("lower", "upper", "velocity", "effort", "load_friction")),
        ("actuated", ctypes.c_uint32),
        ("prismatic", ctypes.c_uint32),
    ]


class Position(ctypes.Structure):
    _fields_ = [
        ("name", ctypes.c_char_p),
        ("variable", ctypes.c_uint32),
        ("multiplier", ctypes.c_double),
        ("offset", ctypes.c_double),
    ]


class Loops(ctypes.Structure):
    _fields_ = [
        *((f"{name}_count", ctypes.c_uint32) for name in ("variable", "dependent", "row", "attitude")),
        *((name, INDICES) for name in ("independent", "dependent")),
        *((name, DOUBLES) for name in ("units", "reference")),
        *((name, INDICES) for name in ("motion", "attitudes")),
        ("positions", ctypes.POINTER(Position)),
        ("step", ctypes.CFUNCTYPE(None, *[DOUBLES] * 6)),
    ]


class Spring(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_uint32) for name in ("motor", "joint")),
        *((name, ctypes.c_double) for name in ("stiffness", "rest", "damping")),
    ]


class Springs(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_uint32) for name in ("count", "decoupled")),
        ("springs", ctypes.POINTER(Spring)),
    ]


class Model(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_uint32) for name in ("abi", "size")),
        *((name, ctypes.c_char_p) for name in ("robot", "generator")),
        *((name, ctypes.c_uint32) for name in ("joint_count", "position_count", "moving_base", "payload_size")),
        ("payload_frame", ctypes.c_char_p),
        ("gravity", ctypes.c_double * 3),
        ("joints", ctypes.POINTER(Joint)),
        ("loops", ctypes.POINTER(Loops)),
        ("springs", ctypes.POINTER(Springs)),
        ("inverse", ctypes.CFUNCTYPE(None, *[DOUBLES] * 7)),
        ("friction", ctypes.CFUNCTYPE(None, *[DOUBLES] * 3)),
    ]


def loaded_model(robot, folder, payload_frame=None, prefix="test_"):
    """The table of the compiled model."""
    header, source = control_model_source(export_control_model(robot, payload_frame), prefix)
    (folder / f"{prefix}control_model.h").write_text(header, encoding="ascii")
    (folder / f"{prefix}control_model.c").write_text(source, encoding="ascii")
    library = folder / "model.so"
    define = "-DROBOT_DYNAMICS_SHARED_MODEL"
    command = [COMPILER, *STRICT, define, "-O0", "-fPIC", "-shared", "-fvisibility=hidden", f"-I{INCLUDE}"]
    command += [f"{prefix}control_model.c", "-o", str(library), "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[:2000]
    function = ctypes.CDLL(str(library)).robot_dynamics_control_model
    function.restype = ctypes.POINTER(Model)
    return function().contents


def pointer(array):
    return array.ctypes.data_as(DOUBLES)


@pytest.mark.parametrize("name", ["panda", "puma560", "free_flying_arm", "four_bar", "delta"])
def test_table_and_functions_are_those_of_the_python_law(name, tmp_path):
    robot = shipped_robot(name)
    frame = robot.frames[-1].name
    model = loaded_model(robot, tmp_path, frame)
    dynamics = Dynamics(robot)
    n = len(dynamics.joint_names)
    assert (model.abi, model.size, model.robot.decode()) == (2, ctypes.sizeof(Model), robot.name)
    assert (model.joint_count, model.position_count) == (n, len(dynamics.all_joint_names) if robot.loops else n)
    assert (bool(model.moving_base), model.payload_size) == (robot.moving_base, 10)
    assert model.payload_frame.decode() == frame and list(model.gravity) == list(robot.gravity)
    for index, joint_name in enumerate(dynamics.joint_names):
        joint, row = robot.joints[robot.joint_numbers[joint_name]], model.joints[index]
        limits = joint.limits
        assert row.name.decode() == joint_name and bool(row.prismatic) == joint.prismatic
        assert (row.lower, row.upper, row.velocity, row.effort) == (
            *(limits.lower, limits.upper, limits.velocity, limits.effort),
        )
        assert row.load_friction == joint.load_friction and row.actuated == joint.actuated

    payload = Inertia.about_centre_of_mass(2.0, np.diag([0.01, 0.02, 0.03]), np.array([0.1, 0.05, 0.2]))
    loaded = Dynamics(robot.with_payload(frame, payload))
    rng = np.random.default_rng(0)
    q, qd, qdd = rng.uniform(-0.2, 0.2, (3, n))
    if robot.loops:
        q = dynamics.expand_positions(dynamics.initial_joint_positions)
    base = [rng.normal(size=6), rng.normal(size=3)]
    actuators = find_series_elastic_actuators(loaded, actuated_joint_names(loaded))
    models = LawModels(loaded, actuators, base if robot.moving_base else [])
    expected = models.inverse(q, qd, qdd)
    second_moments = symmetric_entries(payload.second_moments)
    entries = np.array([payload.mass, *payload.first_moments, *second_moments], dtype=float)
    efforts = np.empty(n)
    model.inverse(*map(pointer, (q, qd, qdd, *base, entries, efforts)))
    np.testing.assert_allclose(efforts, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    friction = models.friction(q, qd)
    assert bool(model.friction) == (friction is not None)
    if friction is not None:
        model.friction(*map(pointer, (q, qd, efforts)))
        np.testing.assert_allclose(efforts, friction, rtol=1e-13)


@pytest.mark.parametrize("name", ["four_bar", "delta"])
def test_table_of_loops(name, tmp_path):
    robot = shipped_robot(name)
    dynamics = Dynamics(robot)
    model = loaded_model(robot, tmp_path)
    loops = model.loops.contents
    positions = [loops.positions[k] for k in range(model.position_count)]
    assert [row.name.decode() for row in positions] == list(dynamics.all_joint_names)
    reference = [row.multiplier * loops.reference[row.variable] + row.offset for row in positions]
    np.testing.assert_allclose(dynamics.expand_positions(np.array(reference)), reference, rtol=0, atol=1e-9)
    names = [robot.joints[k].name for k in range(len(robot.joints)) if robot.joints[k].mimic is None]
    independent = [names[loops.independent[k]] for k in range(model.joint_count)]
    dependent = [names[loops.dependent[k]] for k in range(loops.dependent_count)]
    assert independent == list(dynamics.joint_names) and dependent == list(dynamics.dependent_joint_names)
    k = loops.dependent_count
    outputs = [np.empty(size) for size in (loops.row_count, k, k, k, k * k)]
    loops.step(pointer(np.array([loops.reference[i] for i in range(len(names))])), *map(pointer, outputs))
    assert np.abs(outputs[0]).max() < 1e-10  # the loops are closed there
    assert np.linalg.det(outputs[4].reshape(k, k)) > 0


def test_table_of_springs(tmp_path):
    robot = load_robot("manutec_r3")
    model = loaded_model(robot, tmp_path)
    springs = model.springs.contents
    names = [model.joints[index].name.decode() for index in range(model.joint_count)]
    rows = [springs.springs[number] for number in range(springs.count)]
    assert [(names[row.motor], names[row.joint]) for row in rows] == [(f"motor_{k}", f"spring_{k}") for k in (1, 2, 3)]
    for row in rows:
        spring = robot.joints[robot.joint_numbers[names[row.joint]]].spring
        assert (row.stiffness, row.rest, row.damping) == (spring.stiffness, spring.rest, spring.damping)
    assert springs.decoupled == 1 and not model.loops
    (tmp_path / "rigid").mkdir()
    assert not loaded_model(load_robot("panda"), tmp_path / "rigid").springs


def test_names_cannot_leave_their_strings(tmp_path):
    name = '*/ \\ " ??/ %s \n é \u2028'
    robot = load_robot("four_bar")
    joints = [replace(joint, name=name) if joint.name == "crank" else joint for joint in robot.joints]
    hostile = replace(robot, name=name, joints=tuple(joints))
    model = loaded_model(hostile, tmp_path)
    assert model.robot.decode() == name and model.joints[0].name.decode() == name
    assert c_string("a\0b") == '"a\\000b"'


def test_what_the_laws_do_not_support_is_refused():
    with pytest.raises(InvalidInputError, match="closed loops, and motors that drive their links through springs"):
        export_control_model(load_robot(elastic_3rps()))
    with pytest.raises(InvalidInputError, match="no joint carries it"):
        export_control_model(load_robot("panda"), "panda_link0")


@pytest.mark.skipif(CPP_COMPILER is None, reason="no C++ compiler is here")
def test_header_for_cpp(tmp_path):
    arguments = "generate panda --lang cpp --model inverse --model gravity --payload panda_link8 --prefix arm_ --output"
    main([*arguments.split(), str(tmp_path)])
    (tmp_path / "main.cpp").write_text(
        """#include <cstdio>
        #include "arm_models.hpp"
        int main()
        {
            static_assert(arm::joint_count == 7 && arm::joints[3].actuated && !arm::joints[3].prismatic);
            std::array<double, 7> q{0.1, -0.3, 0.2, -2.2, 0.1, 1.9, 0.8}, rest{}, efforts, gravity;
            const std::array<double, 10> payload{2.0, 0.2, 0.1, 0.4};
            arm::inverse(q, rest, rest, payload, efforts);
            arm::gravity(q, payload, gravity);
            for (std::size_t k = 0; k < 7; ++k)
                std::printf("%s %g %g %.17g %.17g\\n", arm::joints[k].name.data(), arm::joints[k].lower,
                            arm::joints[k].effort, efforts[k], gravity[k]);
        }
        """
    )
    flags = "-std=c++17 -Wall -Wextra -Werror -pedantic -Wconversion -Wshadow -O0".split()
    for source in ("arm_inverse", "arm_gravity"):
        subprocess.run([COMPILER, *STRICT, "-c", f"{source}.c"], cwd=tmp_path, check=True, timeout=60)
    command = [CPP_COMPILER, *flags, "main.cpp", "arm_inverse.o", "arm_gravity.o", "-o", "main"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr[:2000]
    lines = subprocess.check_output([str(tmp_path / "main")], text=True).splitlines()
    rows = [line.split() for line in lines]
    robot = load_robot("panda")
    assert [row[0] for row in rows] == [joint.name for joint in robot.joints]
    limits = [[joint.limits.lower, joint.limits.effort] for joint in robot.joints]
    np.testing.assert_allclose(np.array([row[1:3] for row in rows], dtype=float), limits, rtol=1e-5)
    loaded = Dynamics(robot.with_payload("panda_link8", Inertia(2.0, [0.2, 0.1, 0.4])), compiled=False)
    expected = loaded.gravity([0.1, -0.3, 0.2, -2.2, 0.1, 1.9, 0.8])
    for column in (3, 4):
        np.testing.assert_allclose(np.array([row[column] for row in rows], dtype=float), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--control --model gravity", "--control and --model exclude each other"),
        ("--control --lang python", "--lang python does not apply"),
        ("--control --payload panda_link8 --payload panda_link7", "one --payload"),
        ("--control --prefix a-", "--prefix a-: letters"),
        ("--lang cpp --prefix 1a", "--prefix 1a: letters"),
        ("--model regressor --payload panda_link8", "--payload applies to inverse"),
        ("--payload panda_link0", "fixed to the base"),
        ("--payload nothing", "nothing"),
    ],
)
def test_options_that_do_not_fit_are_refused(arguments, message, tmp_path, capsys):
    assert main(["generate", "panda", "--output", str(tmp_path), *arguments.split()]) == 1
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
