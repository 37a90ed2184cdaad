"""The platform of a parallel robot in a YAML description: a body that hangs on nothing but legs and loops,

    platform: {link: platform, mass: 5, central_inertia: {...}, free: [x, y, z], initial: {xyz: [0, 0, -0.5]}}

or, as descriptions are written that tell every joint, a link at the end of six joints that have rows:

    platform: {link: platform, coordinates: [platform_x, ..., platform_roll], free: [x, y, z]}
"""

from dataclasses import replace

from robot_dynamics.errors import DescriptionError, unknown_name
from robot_dynamics.model.formats.yaml_joints import unknown_link
from robot_dynamics.model.joint import Limits, check_joint
from robot_dynamics.model.placement import roll_pitch_yaw
from robot_dynamics.model.platform import COORDINATES, Platform, coordinate_joints

OF_A_BODY = ("mass", "first_moments", "inertia", "centre_of_mass", "central_inertia", "initial", "limits")


def described_joints(numbers):
    """The six Joints of a platform that is described as a body, of the document of YamlNumbers; none if there is none.

    Raises DescriptionError.
    """
    told, path = numbers.document.data.get("platform"), ("platform",)
    if told is None or "coordinates" in told:
        return []
    initial = numbers.place(told.get("initial", {}), (*path, "initial"))
    start = [*map(float, initial[:3, 3]), *reversed(roll_pitch_yaw(initial[:3, :3]))]
    joints = coordinate_joints(told["link"], 1, start)
    for number, (coordinate, joint) in enumerate(zip(COORDINATES, joints, strict=True), start=1):
        limits, here = told.get("limits", {}).get(coordinate, {}), (*path, "limits", coordinate)
        limits = Limits(**{key: numbers.number(limits, key, here) for key in limits})
        joints[number - 1] = replace(joint, limits=limits)
        try:
            check_joint(number, joints[number - 1])
        except DescriptionError as error:
            numbers.document.fail(here, str(error))
    return joints


def platform_told(document, joints, links, inertias):
    """The Platform of a document, None if it has none.

    joints, links, inertias: the Joints of the tree, the names of all links, the base first, and their Inertias. Raises
    DescriptionError.
    """
    told = document.data.get("platform")
    if told is None:
        return None
    name = told["link"]
    if name not in links[1:]:
        document.fail(("platform", "link"), unknown_link(name, links[1:], joints, links))
    link = links.index(name)
    if not inertias[link].mass > 0:
        document.fail(("platform",), f"platform {name!r} has no inertia: mass missing, and what resists where it turns")
    return Platform(link, _coordinates(document, told, joints), tuple(told.get("free", COORDINATES)))


def _coordinates(document, told, joints):
    """Numbers of the joints that are the coordinates of the platform."""
    if "coordinates" not in told:
        return tuple(range(len(COORDINATES)))
    for key in OF_A_BODY:
        if key in told:
            document.fail(
                ("platform", key), f"the rows of the joints that are its coordinates tell {key}: leave it out"
            )
    numbers = {joint.name: number for number, joint in enumerate(joints)}
    for place, name in enumerate(told["coordinates"]):
        if name not in numbers:
            document.fail(("platform", "coordinates", place), unknown_name("joint", name, numbers))
    return tuple(numbers[name] for name in told["coordinates"])
