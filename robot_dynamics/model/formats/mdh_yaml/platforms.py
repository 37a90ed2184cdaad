"""Platforms in a YAML description. A platform is a body that only legs and loops hold,

    platform: {link: platform, mass: 5, central_inertia: {...}, free: [x, y, z], initial: {xyz: [0, 0, -0.5]}}

or, where the description has rows for all joints, a link at the end of six joints:

    platform: {link: platform, coordinates: [platform_x, ..., platform_roll], free: [x, y, z]}

Where parallel modules stand on each other, each has its own platform, with the link or fixed row on which it stands:

    platforms: [{link: lower, ...}, {link: upper, base: lower, ...}]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.mdh_yaml.document import YamlPart
from robot_dynamics.model.formats.mdh_yaml.joints import describe_unknown_link, read_limits
from robot_dynamics.model.joint import check_joint
from robot_dynamics.model.placement import roll_pitch_yaw
from robot_dynamics.model.platform import COORDINATES, Platform, make_coordinate_joints

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument, YamlMapping, YamlPath
    from robot_dynamics.model.formats.mdh_yaml.evaluator import YamlEvaluator
    from robot_dynamics.model.inertia import Inertia
    from robot_dynamics.model.joint import Joint

BODY_KEYS = ("mass", "first_moments", "inertia", "centre_of_mass", "central_inertia", "initial", "limits")


def list_platforms(document: YamlDocument) -> list[YamlPart]:
    """Return the mappings of the platforms of a document, in their order."""
    single = document.data.get("platform")
    several = document.data.get("platforms", [])
    if single is None:
        return [YamlPart(mapping, ("platforms", number)) for number, mapping in enumerate(several)]
    if several:
        document.fail(("platform",), "platform and platforms exclude each other: add this one to platforms")
    return [YamlPart(single, ("platform",))]


def read_coordinate_joints(
    evaluator: YamlEvaluator, mapping: YamlMapping, path: YamlPath, first: int, base: tuple[int, ScalarArray]
) -> list[Joint]:
    """Return the six joints of a platform that the mapping at a path describes as a body.

    first, base: as for `make_coordinate_joints`.
    """
    initial = evaluator.read_placement(mapping.get("initial", {}), (*path, "initial"))
    start = [*map(float, initial[:3, 3]), *reversed(roll_pitch_yaw(initial[:3, :3]))]
    joints: list[Joint] = []
    for coordinate, joint in zip(COORDINATES, make_coordinate_joints(mapping["link"], first, start, base), strict=True):
        limits = mapping.get("limits", {}).get(coordinate, {})
        limits_path = (*path, "limits", coordinate)
        joints.append(replace(joint, limits=read_limits(evaluator, limits, limits_path)))
        try:
            check_joint(first + len(joints) - 1, joints[-1])
        except DescriptionError as error:
            evaluator.document.fail(limits_path, str(error))
    return joints


def read_platforms(
    document: YamlDocument,
    joints: Sequence[Joint],
    links: Sequence[str],
    inertias: Sequence[Inertia],
    has_beams: bool = False,
) -> tuple[Platform, ...]:
    """Return the platforms of a document.

    Parameters
    ----------
    document : YamlDocument
        The document.
    joints : sequence of Joint
        Joints of the tree.
    links : sequence of str
        Names of all links, the base first.
    inertias : sequence of Inertia
        Inertias of the links.
    has_beams : bool
        Whether links have beams. A platform may then be a point without mass, to which the beams are welded.
    """
    platforms = []
    for mapping, path in list_platforms(document):
        name = mapping["link"]
        if name not in links[1:]:
            document.fail((*path, "link"), describe_unknown_link(name, links[1:], joints, links))
        link = links.index(name)
        if not (has_beams or inertias[link].mass > 0):
            document.fail(path, f"platform {name!r} has no inertia: mass missing, and an inertia where it turns")
        base = mapping.get("base", links[0])
        coordinates = _coordinate_numbers(document, mapping, path, joints)
        free = tuple(mapping.get("free", COORDINATES))
        platforms.append(Platform(link, coordinates, free, None if base == links[0] else base))
    return tuple(platforms)


def _coordinate_numbers(
    document: YamlDocument, mapping: YamlMapping, path: YamlPath, joints: Sequence[Joint]
) -> tuple[int, ...]:
    """Return the numbers of the joints that are the coordinates of a platform."""
    numbers = {joint.name: number for number, joint in enumerate(joints)}
    if "coordinates" not in mapping:
        return tuple(numbers[f"{mapping['link']}_{coordinate}"] for coordinate in COORDINATES)
    for key in BODY_KEYS:
        if key in mapping:
            document.fail((*path, key), f"{key} belongs to the rows of the coordinate joints: omit it here")
    for index, name in enumerate(mapping["coordinates"]):
        if name not in numbers:
            document.fail((*path, "coordinates", index), describe_unknown_name("joint", name, numbers))
    return tuple(numbers[name] for name in mapping["coordinates"])
