"""The tree of links that the joints of an SDF span from a base, and the joints that close loops."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from robot_dynamics.model.formats.sdf.joint_axes import Motion
    from robot_dynamics.model.formats.sdf.scopes import Node


class JointEdge(NamedTuple):
    """A joint between two links.

    Attributes
    ----------
    node : Node
        The joint.
    kind : str
        Its type.
    parent, child : Node
        The links; the parent may be the world.
    motions : list of Motion
        Its motions from the parent to the child.
    """

    node: Node
    kind: str
    parent: Node
    child: Node
    motions: list[Motion]

    @property
    def is_driven(self) -> bool:
        """Whether a motor drives a motion, or it is no joint that a loop is cut at first."""
        return self.kind == "fixed" or any(motion.actuated for motion in self.motions)


class Step(NamedTuple):
    """A joint of the tree, and whether it leads from its child to its parent."""

    edge: JointEdge
    is_reversed: bool


class SpanningTree(NamedTuple):
    """The joints of the tree, each after that of the link that carries it, the joints of loops, and unreached links."""

    steps: list[Step]
    cuts: list[JointEdge]
    unreached: list[Node]


def span_tree(root: Node, links: list[Node], edges: list[JointEdge]) -> SpanningTree:
    """Return the tree from a root, depth first, the joints of a link in the order of the document.

    Of the joints to one child that with a motor belongs to the tree, else the first one. A joint leads from its child
    to its parent only where the parent is not reached in another way. Ball joints close loops where they can.
    """
    preferred: dict[Node, JointEdge] = {}
    for edge in sorted((edge for edge in edges if edge.kind != "ball"), key=lambda edge: not edge.is_driven):
        preferred.setdefault(edge.child, edge)
    reached = {root}
    steps: list[Step] = []
    _descend(root, edges, preferred, reached, steps)
    while (step := _next_step(edges, reached)) is not None:
        link = step.edge.parent if step.is_reversed else step.edge.child
        reached.add(link)
        steps.append(step)
        _descend(link, edges, preferred, reached, steps)
    used = {step.edge.node for step in steps}
    cuts = [edge for edge in edges if edge.node not in used and edge.child in reached and edge.parent in reached]
    return SpanningTree(steps, cuts, [link for link in links if link not in reached])


def _descend(
    link: Node, edges: list[JointEdge], preferred: dict[Node, JointEdge], reached: set[Node], steps: list[Step]
) -> None:
    """Add the steps from a link along the preferred joints to all children."""
    carried: dict[Node, list[JointEdge]] = {}
    for edge in edges:
        if preferred.get(edge.child) is edge:
            carried.setdefault(edge.parent, []).append(edge)
    stack = list(reversed(carried.get(link, [])))
    while stack:
        edge = stack.pop()
        if edge.child not in reached:
            reached.add(edge.child)
            steps.append(Step(edge, False))
            stack += reversed(carried.get(edge.child, []))


def _next_step(edges: list[JointEdge], reached: set[Node]) -> Step | None:
    """Return the first joint with one reached link, forwards where possible, a ball joint if there is no other."""
    candidates = [edge for edge in edges if (edge.parent in reached) != (edge.child in reached)]
    candidates = [edge for edge in candidates if edge.kind != "ball"] or candidates
    forwards = next((edge for edge in candidates if edge.parent in reached), None)
    if forwards is not None:
        return Step(forwards, False)
    return Step(candidates[0], True) if candidates else None
