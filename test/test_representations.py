"""What an interpreter or a notebook prints for an object: one line that says what it is."""

import pytest

from robot_dynamics import Dynamics, InvalidInputError, load_robot
from robot_dynamics.codegen.jit.python_program import PythonProgram

MAST = """
robot: mast
joints:
  - {joint: turn, link: pole, mdh: {alpha: 0}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
"""


@pytest.fixture(scope="module")
def hexapod():
    return Dynamics(load_robot("gough_stewart"))


def test_models_name_their_robot(hexapod):
    assert repr(hexapod) == "Dynamics(Robot('gough_stewart', 24 joints, fixed base))"
    assert repr(hexapod.platform) == "PlatformDynamics(Robot('gough_stewart', 24 joints, fixed base), 'platform')"
    assert repr(Dynamics(load_robot(MAST)).robot) == "Robot('mast', 1 joints, fixed base)"


def test_models_that_a_robot_has_not_are_no_attributes(hexapod):
    arm = Dynamics(load_robot("rx90"))
    assert hasattr(hexapod, "platform") and not hasattr(arm, "platform")
    assert hasattr(arm, "flexible_arm") and not hasattr(hexapod, "flexible_arm")
    with pytest.raises(InvalidInputError, match="has no platform: use the joints"):
        _ = arm.platform


def test_programs_name_their_inputs_and_operations():
    pytest.importorskip("llvmlite")
    program = Dynamics(load_robot("panda")).compile("inverse")
    assert repr(program) == "CompiledProgram(q, qd, qdd: 262 × / 258 + / 12 sin/cos)"
    assert repr(PythonProgram(program.program)) == "PythonProgram(q, qd, qdd: 262 × / 258 + / 12 sin/cos)"
