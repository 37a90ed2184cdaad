"""Count the operations that the models of a robot take as straight-line code.

Every binary addition, subtraction, multiplication and division counts, squares and doublings too; unary minus does not.
"""

from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.cli.text_table import print_table
from robot_dynamics.codegen.jit.compiled_models import available_models

NAME = "count"


def add_arguments(parser):
    add_robot_arguments(parser)


def run(arguments):
    robot = load_robot_argument(arguments)
    rows = []
    for name, model in available_models(robot).items():
        operations = model(robot).operations
        others = operations.trigonometric, operations.square_roots, operations.signs
        rows.append([name, operations.multiplications, operations.additions, operations.divisions, *others])
    print_table(["model", "×", "+ -", "÷", "sin cos", "√", "sign"], rows, f"Operations of a call, robot {robot.name!r}")
