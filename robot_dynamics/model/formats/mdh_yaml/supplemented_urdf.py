"""Robot from a URDF and a short YAML beside it, which tells what URDF cannot say: loops, roles, springs, gravity.

urdf: five_bar.urdf     # beside this file, or the text itself
roles: {elbow_left: passive, elbow_right: passive}
loops:
  - {joint: tip, moved: {antecedent: left_tip}, closed_on: {antecedent: right_tip}}
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.decoding import read_file_bytes
from robot_dynamics.model.formats.mdh_yaml.evaluator import YamlEvaluator
from robot_dynamics.model.formats.mdh_yaml.joints import find_role_conflict, read_spring
from robot_dynamics.model.formats.mdh_yaml.loops import list_loops, read_loops
from robot_dynamics.model.formats.urdf.document import MAX_DESCRIPTION_LENGTH
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import check_joint
from robot_dynamics.model.robot import Frame, Link


def read_supplemented_urdf(document, values, moving_base, gravity):
    """The Robot of a validated YamlDocument with the key urdf; the rest as for `read_mdh_yaml`.

    Raises DescriptionError.
    """
    numbers = YamlEvaluator(document, values)
    if gravity is None and "gravity" in document.data:
        gravity = numbers.vector(document.data, "gravity", ())
    text, source = _urdf(document)
    robot = read_urdf(text, source=source, moving_base=moving_base, gravity=gravity)
    joints = _told_joints(numbers, robot)
    names = [link.name for link in robot.links]
    placed = {frame.name: (frame.link, frame.placement) for frame in robot.frames}
    cuts = read_loops(document, list_loops(numbers), joints, names, placed)
    moved = enumerate(cuts.links, start=len(names))
    try:
        return replace(
            robot,
            name=document.data.get("robot", robot.name),
            links=(*robot.links, *(Link(name, Inertia()) for name in cuts.links)),
            joints=(*joints, *cuts.joints),
            frames=(*robot.frames, *(Frame(name, number, np.eye(4)) for number, name in moved)),
            loops=cuts.loops,
        )
    except DescriptionError as error:
        document.fail((), str(error))


def _urdf(document):
    """(the text of the URDF, what to call it): it stands there itself, or in a file.

    A text that came from no file opens none: it may have come from anywhere.
    """
    told, source = document.data["urdf"], document.source
    if re.match(r"\s*<", told.removeprefix("\ufeff")):
        return told, f"{source}, urdf"
    if not isinstance(source, Path):
        document.fail(
            ("urdf",),
            f"{told[:100]!r} is a path, but this text came from no file beside which it could be looked for: put the "
            "text of the URDF there (urdf: | and the text below, indented), or load the YAML from its file",
        )
    path = source.parent / told
    try:
        return read_file_bytes(path, MAX_DESCRIPTION_LENGTH), path
    except DescriptionError as error:
        document.fail(("urdf",), f"{error}. A path from the folder of this file, or the text of a URDF, is needed")


def _told_joints(numbers, robot):
    """The Joints of a Robot with the roles, springs and initial positions that the document tells."""
    document = numbers.document
    told = {key: document.data.get(key, {}) for key in ("roles", "springs", "initial_positions")}
    cut = {loop["joint"] for loop in document.data.get("loops", [])} - robot.joint_numbers.keys()
    for key, mapping in told.items():
        for name in mapping:
            if name in cut:
                document.fail((key, name), f"loop {name!r} is cut at that joint: what it is stands there, in loops")
            if name not in robot.joint_numbers:
                document.fail((key, name), describe_unknown_name("moving joint", name, robot.joint_numbers))
    return [_told_joint(numbers, joint, told) for joint in robot.joints]


def _told_joint(numbers, joint, told):
    name, document = joint.name, numbers.document
    spring, role = told["springs"].get(name), told["roles"].get(name)
    if spring is not None:
        spring = read_spring(numbers, spring, ("springs", name))
    if objection := find_role_conflict(role, spring, joint.mimic is not None):
        document.fail((f"{objection[0]}s", name), f"joint {name!r}: {objection[1]}")
    position = numbers.number(told["initial_positions"], name, ("initial_positions",))
    joint = replace(joint, actuated=role in (None, "actuated"), spring=spring, initial_position=position)
    try:
        check_joint(joint.antecedent + 1, joint)
    except DescriptionError as error:
        document.fail(("springs", name), str(error))
    return joint
