"""Formulas as MathML, which browsers draw without a script: pages need no network. docutils translates the LaTeX."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from lxml import etree
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number

if TYPE_CHECKING:
    from sphinx.application import Sphinx

logger = logging.getLogger(__name__)

MATHML = "{http://www.w3.org/1998/Math/MathML}"


def visit_inline(translator: Any, node: nodes.math) -> None:
    """Write a formula within a line."""
    translator.body.append(_convert(node, is_block=False))
    raise nodes.SkipNode


def visit_block(translator: Any, node: nodes.math_block) -> None:
    """Write a formula on lines of its own."""
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    if node.get("number"):
        translator.body.append(f'<span class="eqno">({get_node_equation_number(translator, node)})</span>')
    translator.body.append(_convert(node, is_block=True))
    translator.body.append("</div>\n")
    raise nodes.SkipNode


def _convert(node: nodes.Element, *, is_block: bool) -> str:
    try:
        return to_mathml(node.astext(), is_block=is_block)
    except MathError as error:
        logger.warning("formula %r: %s", node.astext(), error, location=node)
        return ""


def to_mathml(latex: str, *, is_block: bool) -> str:
    """Return a formula as MathML. Raises MathError for LaTeX that docutils does not know."""
    formula = etree.fromstring(str(latex2mathml.tex2mathml(latex, as_block=is_block)))
    for element in formula.findall(f".//{MATHML}munderover"):
        _move_index_beside(element)
    return etree.tostring(formula, encoding="unicode")


def _move_index_beside(element: etree._Element) -> None:
    """Write the index of a symbol with an accent beside it: docutils writes that of ``\\dot q_i`` below the symbol."""
    symbol, index, accent = element
    if accent.tag != f"{MATHML}mo" or accent.get("stretchy") != "false":
        return
    element.tag = f"{MATHML}msub"
    accented = etree.Element(f"{MATHML}mover", accent="true")
    accented.extend([symbol, accent])
    element[:] = [accented, index]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
