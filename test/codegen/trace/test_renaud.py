"""Operation counts of Renaud's table, for his robot with six revolute joints and symbolic parameters.

The counted program agrees with the Newton-Euler recursion.
"""

import numpy as np
import pytest

from robot_dynamics import Robot
from robot_dynamics.codegen.jit.python_functions import python_function
from robot_dynamics.codegen.trace.parameter_grouping import group_inertial_parameters
from robot_dynamics.codegen.trace.program import build_program, count_operations
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.robot import Frame, Link
from robot_dynamics.newton_euler import augmented, inverse
from robot_dynamics.newton_euler.kinematics import run_forward_pass

QUARTERS = (0, 1, 0, 1, -1, 1)  # α of each joint, in right angles
LENGTHS = {3: ("a2", None), 4: (None, "r4")}  # d and r that are not zero
CENTRES = {1: "  z", 2: "x  ", 3: " y ", 4: "  z", 5: " y ", 6: "  z"}  # the axis on which each centre of mass lies


def renauds_robot(value):
    """The robot of Renaud's example; `value(name)` returns the symbol or number of a name (`a2`, `m3`, `x2`, `b5`)."""
    links, joints, frames = [Link("mount", Inertia())], [], [Frame("mount", 0, np.eye(4))]
    for j, quarter in enumerate(QUARTERS, start=1):
        d, r = (value(name) if name else 0 for name in LENGTHS.get(j, (None, None)))
        placed = np.array(
            [
                [1, 0, 0, d],
                [0, 1 - abs(quarter), -quarter, -quarter * r],
                [0, quarter, 1 - abs(quarter), (1 - abs(quarter)) * r],
                [0, 0, 0, 1],
            ]
        )
        first = np.array([0 if axis == " " else value(f"{axis}{j}") for axis in CENTRES[j]])
        second = np.diag(np.array([value(f"{axis}{j}") for axis in "abc"]))
        joints.append(Joint(f"joint_{j}", j - 1, False, placed))
        links.append(Link(f"link_{j}", Inertia(value(f"m{j}"), first, second)))
        frames.append(Frame(f"link_{j}", j, np.eye(4)))
    return Robot("renaud", tuple(links), tuple(joints), tuple(frames))


def recorded(group_parameters):
    """(trace, arguments of the recursion) with symbols for all parameters, gravity included."""
    trace = Trace()
    robot = renauds_robot(trace.parameter)
    q, qd, qdd = (trace.input(name, 6) for name in ("q", "qd", "qdd"))
    at_rest = np.array([0, 0, trace.parameter("g"), 0, 0, 0], dtype=object)
    return trace, (
        group_inertial_parameters(robot) if group_parameters else robot,
        q,
        qd,
        qdd,
        np.zeros(6, dtype=int),
        at_rest,
    )


def program_for(trace, outputs):
    return build_program(trace, "inverse", dict.fromkeys(("q", "qd", "qdd"), 6), outputs)


def traced(group_parameters):
    """The Program of the inverse model."""
    trace, arguments = recorded(group_parameters)
    forces, _ = augmented.inverse_dynamics(*arguments, {})
    return program_for(trace, {"efforts": forces})


def counted_by_step(group_parameters):
    """({step of the paper: OperationCount}, total); each statement counts in the first step that needs it."""
    trace, arguments = recorded(group_parameters)
    motions = augmented.link_motions(*arguments)
    forces, _ = augmented.inverse_dynamics(*arguments, {})
    whole = program_for(trace, {"efforts": forces}).statements
    angular = [motion.angular for motion in motions]
    stages = {
        "1a and 1b": [motion.omega for motion in angular],
        "2 to 4": [motion.B for motion in angular],
        "6a, 6b and 6c": [motion.alpha for motion in motions],
        "7 to 10": [forces],
    }
    steps, done = {}, set()
    for step, arrays in stages.items():
        entries = np.concatenate([np.ravel(np.array(array, dtype=object)) for array in arrays])
        reached = {statement.number for statement in program_for(trace, {"all": entries}).statements}
        new = [statement for statement in whole if statement.number in reached - done]
        steps[step] = count_operations(new)
        done |= reached
    return steps, count_operations(whole)


PAPER = {
    "1a and 1b": (18, 12),
    "2 to 4": (25 + 28 + 0, 0 + 22 + 15),
    "6a, 6b and 6c": (22, 12),
    "7 to 10": (26 + 62, 16 + 50),
}


def test_operations_of_each_step_do_not_exceed_the_paper():
    """Print the counts beside the table of the paper, with steps 2 to 4 and 7 to 10 in one each."""
    steps, whole = counted_by_step(group_parameters=False)
    print("step            here     paper")
    for step, operations in steps.items():
        ours = f"{operations.multiplications:>3} {operations.additions:>3}"
        print(f"{step:<14} {ours}   {PAPER[step][0]:>4} {PAPER[step][1]:>3}")
    print(f"total          {whole.multiplications:>3} {whole.additions:>3}    181 127")
    assert sum(multiplications for multiplications, _ in PAPER.values()) == 181
    assert sum(additions for _, additions in PAPER.values()) == 127
    assert whole.multiplications <= 181 and whole.additions <= 127
    for step, (multiplications, additions) in PAPER.items():
        assert steps[step].multiplications + steps[step].additions <= multiplications + additions


@pytest.mark.parametrize(
    ("group_parameters", "multiplications", "additions"),
    [(False, 181, 127), (True, 164, 115)],
    ids=["augmented", "gathered"],
)
def test_inverse_model_operations_do_not_exceed_the_paper(group_parameters, multiplications, additions):
    """Table of the example: 181 × and 127 +; with grouped parameters 164 × and 115 +."""
    operations = traced(group_parameters).operations
    print(
        f"Renaud's 6R, {'grouped' if group_parameters else 'augmented'}: {operations}; "
        f"paper {multiplications} / {additions}"
    )
    assert operations.multiplications <= multiplications and operations.additions <= additions
    assert operations.divisions == operations.square_roots == operations.signs == 0


@pytest.mark.parametrize("group_parameters", [False, True], ids=["augmented", "gathered"])
def test_counted_program_agrees_with_the_newton_euler_model(group_parameters):
    program = traced(group_parameters)
    rng = np.random.default_rng(0)
    for _ in range(20):
        values = {}

        def number(name, values=values):
            return values.setdefault(name, float(rng.uniform(0.2, 2)))

        robot = renauds_robot(number)
        number("g")
        q, qd, qdd = rng.uniform(-3, 3, (3, 6))
        at_rest = np.array([0, 0, values["g"], 0, 0, 0])
        sweep = run_forward_pass(robot, q, qd, np.zeros(6), {})
        expected, _ = inverse.inverse_dynamics(robot, sweep, qdd, at_rest)
        computed = python_function(program, {name: values[name] for name in program.parameters})
        actual = np.array(computed(q, qd, qdd))
        assert np.abs(actual - expected).max() < 1e-12 * np.abs(expected).max()
