"""Tables as text, with short numbers aligned at the decimal point."""

import math
from collections.abc import Sequence
from typing import TypeAlias

from tabulate import tabulate

from robot_dynamics.cli.terminal_text import escape_line

Cell: TypeAlias = str | int | float | None


def print_table(header: Sequence[str], rows: Sequence[Sequence[Cell]], title: str | None = None) -> None:
    """Print a table with a header and an optional title, without its empty columns."""
    print(format_table(header, rows, title))


def format_table(header: Sequence[str], rows: Sequence[Sequence[Cell]], title: str | None = None) -> str:
    """Format a table with a header and an optional title, without its empty columns."""
    texts = [[format_cell(cell) for cell in row] for row in rows]
    columns = [k for k in range(len(header)) if any(row[k] for row in texts)]
    table = str(
        tabulate(
            [[row[k] for k in columns] for row in texts],
            [header[k] for k in columns],
            tablefmt="simple",
            disable_numparse=True,
            colalign=["right" if all(is_number(row[k]) for row in rows) else "left" for k in columns],
        )
    )
    return f"\n{title}\n{table}" if title else table


def is_number(cell: Cell) -> bool:
    """Whether a cell is a number or empty."""
    return cell is None or isinstance(cell, int | float)


def format_cell(cell: Cell) -> str:
    """Format a number with six digits; None and infinite numbers are empty."""
    if cell is None or (isinstance(cell, float) and math.isinf(cell)):
        return ""
    return f"{cell:.6g}" if isinstance(cell, float) else escape_line(str(cell))


def round_to_digits(value: float, digits: int) -> float:
    """Round a number to a number of significant digits."""
    return float(f"{value:.{digits}g}")
