"""References to Python objects: names in docstrings and short names of types in signatures.

Role `py:known` is the default role: a name in a docstring links to its documentation if there is one, and is plain code
elsewhere. A type in a signature may be written without its module, as in the source: it links to the documented object
that ends in this name.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, cast

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.domains.python import PythonDomain, PyXRefRole
from sphinx.util.nodes import make_refnode

if TYPE_CHECKING:
    from docutils.nodes import Element
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment

PUBLIC_PREFIX = re.compile(r"^robot_dynamics\.(?=[A-Z]|[a-z_]+(\(\))?$)")
"""What comes before a public name, and its members; names with a longer path keep it."""


class KnownNameRole(PyXRefRole):
    """A reference to any Python object that is no error if the object is not documented."""

    def process_link(
        self, env: BuildEnvironment, refnode: Element, has_explicit_title: bool, title: str, target: str
    ) -> tuple[str, str]:
        """Make it a reference of role `py:obj`, with a mark."""
        title, target = super().process_link(env, refnode, has_explicit_title, title, target)
        refnode["reftype"] = "obj"
        refnode["may_be_unknown"] = True
        return title, target


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, contnode: Element) -> Element | None:
    """Return the link of a type without its module, or the text of a reference that may be unknown."""
    if node.get("may_be_unknown"):
        return contnode
    if node.get("refdomain") != "py" or node.get("reftype") != "class":
        return None
    objects = cast(PythonDomain, env.get_domain("py")).objects
    name = node["reftarget"].rpartition(".")[2]
    matches = [full_name for full_name in objects if full_name.rpartition(".")[2] == name and name[0].isupper()]
    if len(matches) != 1:
        return None
    entry = objects[matches[0]]
    return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, contnode, matches[0])


def shorten_references(app: Sphinx, doctree: nodes.document) -> None:
    """Show `Dynamics.inverse()`, not `robot_dynamics.Dynamics.inverse()`, in references to public names."""
    for reference in doctree.findall(pending_xref):
        if reference.get("refdomain") != "py" or reference.get("refexplicit"):
            continue
        for text in list(reference.findall(nodes.Text)):
            if PUBLIC_PREFIX.match(text):
                text.parent.replace(text, nodes.Text(PUBLIC_PREFIX.sub("", text)))


def shorten_aliases(
    app: Sphinx, kind: str, name: str, member: object, options: Any, signature: str | None, result: str | None
) -> tuple[str | None, str | None]:
    """Write types as the source does: `ArrayLike`, not its definition or a reference to it."""
    return _shorten(signature), _shorten(result)


def _shorten(text: str | None) -> str | None:
    return text and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)


def skip_fields(app: Sphinx, kind: str, name: str, member: object, is_skipped: bool, options: Any) -> bool | None:
    """Skip the fields of named tuples: the class lists them with a description."""
    return True if type(member).__name__ == "_tuplegetter" else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the role and the resolvers."""
    app.add_role_to_domain("py", "known", KnownNameRole())
    app.connect("missing-reference", resolve)
    app.connect("doctree-read", shorten_references)
    app.connect("autodoc-process-signature", shorten_aliases)
    app.connect("autodoc-skip-member", skip_fields)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
