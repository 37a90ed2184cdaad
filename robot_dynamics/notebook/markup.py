"""Elements of HTML. Text is escaped by lxml: a name in a description is a text and nothing else."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from typing import TypeAlias

from lxml import html
from lxml.html import HtmlElement, builder

from robot_dynamics.model.formats.expression import format_angle

Cell: TypeAlias = str | float | None

CLASS = "robot-dynamics"
STYLE = f"""
.{CLASS} table {{ border-collapse: collapse; display: block; overflow-x: auto; max-width: 100%; font-size: .9em }}
.{CLASS} th, .{CLASS} td {{ padding: .1em .55em; text-align: right; white-space: nowrap }}
.{CLASS} .text {{ text-align: left }}
.{CLASS} p {{ margin: .25em 0; text-align: left }}
.{CLASS} .row {{ display: flex; flex-wrap: wrap; gap: 1em; align-items: center }}
.{CLASS} img {{ max-width: 100%; height: auto; background: none }}
"""
DECIMALS = 9
"""Decimals of lengths and angles: smaller parts are rounding errors of the text of a URDF."""


def printable(text: str) -> str:
    """Return a text with a space for each character that cannot be printed, which XML does not allow."""
    return "".join(character if character.isprintable() else " " for character in text)


def number_text(value: float) -> str:
    """Return a number with six digits; nothing for one that is infinite or not defined."""
    value = float(value)
    return f"{value:.6g}" if abs(value) < float("inf") else ""


def length_text(value: float) -> str:
    """Return a length [m] without its rounding errors."""
    return number_text(round(float(value), DECIMALS) + 0.0)


def angle_text(value: float) -> str:
    """Return an angle [rad], as a multiple of π where it is one."""
    text = str(format_angle(float(value)))
    return text.replace("*pi", "π").replace("pi", "π") if "pi" in text else length_text(value)


def paragraph(text: str) -> HtmlElement:
    """Return a paragraph."""
    return builder.P(printable(text))


def heading(text: str) -> HtmlElement:
    """Return a line in bold letters: headings would be in the table of contents of a page."""
    return builder.P(builder.B(printable(text)))


def table(header: Sequence[str], rows: Iterable[Sequence[Cell]]) -> HtmlElement:
    """Return a table of texts and numbers, without the columns in which nothing is."""
    texts = [[_cell_text(cell) for cell in row] for row in rows]
    columns = [k for k in range(len(header)) if any(k < len(row) and row[k] for row in texts)]
    lines = [[row[k] if k < len(row) else "" for k in columns] for row in texts]
    is_text = [not all(_is_number(line[k]) for line in lines) for k in range(len(columns))]
    head = builder.TR(*(_cell(builder.TH, header[k], left) for k, left in zip(columns, is_text, strict=True)))
    body = [builder.TR(*(_cell(builder.TD, *pair) for pair in zip(line, is_text, strict=True))) for line in lines]
    return builder.TABLE(builder.THEAD(head), builder.TBODY(*body))


def _cell_text(cell: Cell) -> str:
    return printable(cell) if isinstance(cell, str) else "" if cell is None else number_text(cell)


def _is_number(text: str) -> bool:
    return not text or text.strip("-")[:1] in "0123456789π.…"


def _cell(element: type[HtmlElement], text: str, is_text: bool) -> HtmlElement:
    return element(text, **({"class": "text"} if is_text else {}))


def picture(data: bytes, description: str) -> HtmlElement:
    """Return a PNG picture that is part of the page, with its description for those who do not see it."""
    source = f"data:image/png;base64,{b64encode(data).decode()}"
    return builder.IMG(src=source, alt=printable(description))


def block(*elements: HtmlElement, is_row: bool = False) -> HtmlElement:
    """Return elements below each other, or beside each other where there is room."""
    return builder.DIV(*elements, **({"class": "row"} if is_row else {}))


def to_text(element: HtmlElement) -> str:
    """Return an element as text, with the style of all elements here."""
    page = builder.DIV(builder.STYLE(STYLE), element, **{"class": CLASS})
    return str(html.tostring(page, encoding="unicode"))
