"""Count the operations of the models of a robot as straight-line code.

Every binary addition, subtraction, multiplication and division counts, squares and doublings included. Unary minus does
not count.
"""

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.cli.text_table import print_table
from robot_dynamics.codegen.jit.compiled_models import available_models

if TYPE_CHECKING:
    from robot_dynamics.cli.text_table import Cell

NAME = "count"
HEADER = ["model", "×", "+ -", "÷", "sin cos", "√", "sign"]


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_robot_arguments(parser)


def run(arguments: Namespace) -> None:
    """Print the number of operations of each model."""
    robot = load_robot_argument(arguments)
    rows: list[list[Cell]] = []
    for name, model in available_models(robot).items():
        operations = model(robot).operations
        rows.append(
            [
                name,
                operations.multiplications,
                operations.additions,
                operations.divisions,
                operations.trigonometric,
                operations.square_roots,
                operations.signs,
            ]
        )
    print_table(HEADER, rows, f"Operations per call, robot {robot.name!r}")
