"""Count the operations that the models of a robot take as straight-line code.

Every binary addition, subtraction, multiplication and division counts, squares and doublings too; unary minus does not.
"""

from robot_dynamics.commands.robot_arguments import add_robot_arguments, robot_of
from robot_dynamics.commands.text_table import print_table
from robot_dynamics.symbolic.compiled_models import models_of

NAME = "count"


def add_arguments(parser):
    add_robot_arguments(parser)


def run(told):
    robot = robot_of(told)
    rows = []
    for name, model in models_of(robot).items():
        operations = model(robot).operations
        others = operations.trigonometric, operations.square_roots, operations.signs
        rows.append([name, operations.multiplications, operations.additions, operations.divisions, *others])
    print_table(["model", "×", "+ -", "÷", "sin cos", "√", "sign"], rows, f"Operations of a call, robot {robot.name!r}")
