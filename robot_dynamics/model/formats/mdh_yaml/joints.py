"""Joints of a YAML description: role, spring, friction and limits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.joint import NON_NEGATIVE, Joint, Limits, Spring, check_joint
from robot_dynamics.model.joint_friction import FRICTION_FIELDS, find_friction_conflict

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.formats.mdh_yaml.document import YamlMapping, YamlPath
    from robot_dynamics.model.formats.mdh_yaml.evaluator import YamlEvaluator
    from robot_dynamics.model.joint import Mimic

CUT_JOINT_FRICTION_KEYS = tuple(field for field in FRICTION_FIELDS if field != "load_friction")
"""Keys of the friction of a joint at which a loop is cut."""


class RoleConflict(NamedTuple):
    """A contradiction between the role and the spring of a joint: the key of the entry that is wrong, and a message."""

    key: str
    message: str


def read_joint(
    evaluator: YamlEvaluator,
    mapping: YamlMapping,
    path: YamlPath,
    number: int,
    *,
    antecedent: int,
    prismatic: bool,
    placement: ScalarArray,
    actuated: bool,
    spring: Spring | None,
    mimic: Mimic | None = None,
) -> Joint:
    """Return the joint that moves link `number`, from the mapping at a path; the keywords are attributes of Joint."""
    joint = Joint(
        name=mapping["joint"],
        antecedent=antecedent,
        prismatic=prismatic,
        placement=placement,
        rotor_inertia=evaluator.number(mapping, "rotor_inertia", path),
        **{field: evaluator.number(mapping, field, path) for field in FRICTION_FIELDS},
        limits=read_limits(evaluator, mapping.get("limits", {}), (*path, "limits")),
        mimic=mimic,
        actuated=actuated,
        spring=spring,
        initial_position=evaluator.number(mapping, "initial_position", path),
        brake=mapping.get("brake", False),
    )
    negative = [key for key in NON_NEGATIVE if key in mapping and getattr(joint, key) < 0]
    conflict = None if negative else find_friction_conflict(joint)
    try:
        check_joint(number, joint)
    except DescriptionError as error:
        keys = [conflict.field] if conflict else negative[:1]
        evaluator.document.fail((*path, *keys), str(error))
    return joint


def read_limits(evaluator: YamlEvaluator, mapping: YamlMapping, path: YamlPath) -> Limits:
    """Return the limits in the mapping at a path."""
    return Limits(**{key: evaluator.number(mapping, key, path) for key in mapping})


def read_spring(evaluator: YamlEvaluator, mapping: YamlMapping, path: YamlPath) -> Spring:
    """Return the spring in the mapping at a path."""
    return Spring(*(evaluator.number(mapping, key, path) for key in ("stiffness", "rest", "damping")))


def find_role_conflict(role: str | None, spring: Spring | None, is_mimic: bool = False) -> RoleConflict | None:
    """Return the contradiction between the role of a joint, None where it is absent, and its spring; None if none."""
    if spring is not None and role is None and not is_mimic:
        return RoleConflict(
            "spring",
            "role missing: elastic (the spring alone holds the joint) or actuated (a motor acts in parallel)",
        )
    if role == "elastic" and spring is None:
        return RoleConflict("role", "an elastic joint needs a spring: {stiffness: ...}")
    if role == "passive" and spring is not None:
        return RoleConflict("role", "a passive joint with a spring is elastic")
    if role is not None and is_mimic:
        return RoleConflict("role", "a mimic joint has no role of its own: omit role")
    return None


def describe_unknown_link(name: str, known: Iterable[str], joints: Sequence[Joint], links: Sequence[str]) -> str:
    """Return a message that no link or frame has this name; the name of a joint leads to the link that it moves.

    known: valid names; joints: the joints; links: names of all links, the base first.
    """
    moved = {joint.name: link for joint, link in zip(joints, links[1:], strict=True)}
    if name in moved:
        return f"{name!r} is a joint: it moves {moved[name]!r}"
    return describe_unknown_name("link", name, known)
