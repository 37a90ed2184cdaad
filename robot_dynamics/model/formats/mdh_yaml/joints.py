"""What a YAML description tells of a joint beside its place: role, spring, friction, limits."""

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.joint import Joint, Limits, Spring, check_joint

NUMBER_KEYS = ("rotor_inertia", "viscous_friction", "coulomb_friction", "initial_position")


def read_joint(numbers, told, path, number, **known):
    """The Joint that moves link `number`, of the mapping at a path of the document of YamlNumbers.

    known: what Joint takes and the mapping does not tell under the same name.
    """
    limits = {key: numbers.number(told["limits"], key, (*path, "limits")) for key in told.get("limits", {})}
    plain = {key: numbers.number(told, key, path) for key in NUMBER_KEYS}
    joint = Joint(name=told["joint"], limits=Limits(**limits), brake=told.get("brake", False), **plain, **known)
    try:
        check_joint(number, joint)
    except DescriptionError as error:
        numbers.document.fail(path, str(error))
    return joint


def read_spring(numbers, told, path):
    """The Spring of a mapping at a path."""
    return Spring(*(numbers.number(told, key, path) for key in ("stiffness", "rest", "damping")))


def find_role_conflict(role, spring, follows=False):
    """(role or spring, what is wrong with it) of a role, None where it is not told, and a Spring or None; else None.

    follows: whether the joint follows another one.
    """
    if spring is not None and role is None and not follows:
        return (
            "spring",
            "role missing: elastic (the spring alone holds the joint) or actuated (a motor stands beside it)",
        )
    if role == "elastic" and spring is None:
        return "role", "an elastic joint needs a spring: {stiffness: ...}"
    if role == "passive" and spring is not None:
        return "role", "a passive joint that has a spring is elastic"
    if role is not None and follows:
        return "role", "a joint that follows another one has no role of its own: leave it out"
    return None


def describe_unknown_link(name, known, joints, links):
    """Say that there is no link or frame `name` among the `known`; a joint leads to the link that it moves.

    joints: the Joints; links: names of all links, the base first.
    """
    moved = {joint.name: link for joint, link in zip(joints, links[1:], strict=True)}
    return (
        describe_unknown_name("link", name, known)
        if name not in moved
        else f"{name!r} is a joint: it moves {moved[name]!r}"
    )
