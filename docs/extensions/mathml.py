"""Formulas as MathML, which browsers draw without a script: pages need no network. docutils translates the LaTeX."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.util import logging

if TYPE_CHECKING:
    from sphinx.application import Sphinx

logger = logging.getLogger(__name__)


def visit_inline(translator: Any, node: nodes.math) -> None:
    """Write a formula within a line."""
    translator.body.append(_to_mathml(node, node.astext(), is_block=False))
    raise nodes.SkipNode


def visit_block(translator: Any, node: nodes.math_block) -> None:
    """Write a formula on lines of its own."""
    translator.body.append(translator.starttag(node, "div", CLASS="math"))
    translator.body.append(_to_mathml(node, node.astext(), is_block=True))
    translator.body.append("</div>\n")
    raise nodes.SkipNode


def _to_mathml(node: nodes.Element, latex: str, *, is_block: bool) -> str:
    try:
        return str(latex2mathml.tex2mathml(latex, as_block=is_block))
    except MathError as error:
        logger.warning("formula %r: %s", latex, error, location=node)
        return ""


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
