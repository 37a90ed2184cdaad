"""The platform of a parallel robot in a YAML description: a body that hangs on nothing but legs and loops,

    platform: {link: platform, mass: 5, central_inertia: {...}, free: [x, y, z], initial: {xyz: [0, 0, -0.5]}}

or, as descriptions are written that tell every joint, a link at the end of six joints that have rows:

    platform: {link: platform, coordinates: [platform_x, ..., platform_roll], free: [x, y, z]}

Where parallel modules stand on each other each has its own, and says on which link or fixed row it stands:

    platforms: [{link: lower, ...}, {link: upper, base: lower, ...}]
"""

from dataclasses import replace

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.mdh_yaml.joints import describe_unknown_link
from robot_dynamics.model.joint import Limits, check_joint
from robot_dynamics.model.placement import roll_pitch_yaw
from robot_dynamics.model.platform import COORDINATES, Platform, make_coordinate_joints

BODY_KEYS = ("mass", "first_moments", "inertia", "centre_of_mass", "central_inertia", "initial", "limits")


def list_platforms(document):
    """(mapping, path) of each platform of a document, in their order. Raises DescriptionError."""
    one, many = document.data.get("platform"), document.data.get("platforms", [])
    if one is None:
        return [(told, ("platforms", number)) for number, told in enumerate(many)]
    if many:
        document.fail(("platform",), "platforms are told in one list: put this one among platforms")
    return [(one, ("platform",))]


def read_coordinate_joints(numbers, told, path, first, base):
    """The six Joints of a platform that is described as a body, by the mapping at a path of the document of
    YamlNumbers. first, base: as `coordinate_joints` takes them.

    Raises DescriptionError.
    """
    initial = numbers.read_placement(told.get("initial", {}), (*path, "initial"))
    start = [*map(float, initial[:3, 3]), *reversed(roll_pitch_yaw(initial[:3, :3]))]
    joints = []
    for joint in make_coordinate_joints(told["link"], first, start, base):
        coordinate = COORDINATES[len(joints)]
        limits, here = told.get("limits", {}).get(coordinate, {}), (*path, "limits", coordinate)
        limits = Limits(**{key: numbers.number(limits, key, here) for key in limits})
        joints.append(replace(joint, limits=limits))
        try:
            check_joint(first + len(joints) - 1, joints[-1])
        except DescriptionError as error:
            numbers.document.fail(here, str(error))
    return joints


def read_platforms(document, joints, links, inertias, bends=False):
    """The Platforms of a document.

    joints, links, inertias: the Joints of the tree, the names of all links, the base first, and their Inertias; bends:
    whether links bend: a platform may then be a point at which they are welded, without mass. Raises DescriptionError.
    """
    found = []
    for told, path in list_platforms(document):
        name = told["link"]
        if name not in links[1:]:
            document.fail((*path, "link"), describe_unknown_link(name, links[1:], joints, links))
        link = links.index(name)
        if not (bends or inertias[link].mass > 0):
            document.fail(path, f"platform {name!r} has no inertia: mass missing, and what resists where it turns")
        base = told.get("base", links[0])
        coordinates = _coordinates(document, told, path, joints)
        free = tuple(told.get("free", COORDINATES))
        found.append(Platform(link, coordinates, free, None if base == links[0] else base))
    return tuple(found)


def _coordinates(document, told, path, joints):
    """Numbers of the joints that are the coordinates of a platform."""
    numbers = {joint.name: number for number, joint in enumerate(joints)}
    if "coordinates" not in told:
        return tuple(numbers[f"{told['link']}_{coordinate}"] for coordinate in COORDINATES)
    for key in BODY_KEYS:
        if key in told:
            document.fail((*path, key), f"the rows of the joints that are its coordinates tell {key}: leave it out")
    for place, name in enumerate(told["coordinates"]):
        if name not in numbers:
            document.fail((*path, "coordinates", place), describe_unknown_name("joint", name, numbers))
    return tuple(numbers[name] for name in told["coordinates"])
