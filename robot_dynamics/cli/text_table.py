"""Tables as text: numbers short and aligned at their point."""

import math

from tabulate import tabulate


def print_table(head, rows, title=None):
    """Print rows, lists of texts and numbers, under a head; columns in which nothing stands are left out."""
    print(format_table(head, rows, title))


def format_table(head, rows, title=None):
    """What `print_table` prints."""
    texts = [[format_cell(cell) for cell in row] for row in rows]
    kept = [k for k in range(len(head)) if any(row[k] for row in texts)]
    table = tabulate(
        [[row[k] for k in kept] for row in texts],
        [head[k] for k in kept],
        tablefmt="simple",
        disable_numparse=True,
        colalign=["right" if all(is_number(row[k]) for row in rows) else "left" for k in kept],
    )
    return f"\n{title}\n{table}" if title else table


def is_number(cell):
    return cell is None or isinstance(cell, int | float)


def format_cell(cell):
    """A number to six digits; nothing for None and what is infinite."""
    if cell is None or (isinstance(cell, float) and math.isinf(cell)):
        return ""
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)
