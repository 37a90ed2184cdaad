"""Robot from a URDF and a short YAML with what URDF cannot represent: loops, roles, springs, gravity.

urdf: five_bar.urdf     # beside this file, or the text itself
roles: {elbow_left: passive, elbow_right: passive}
loops:
  - {joint: tip, moved: {antecedent: left_tip}, closed_on: {antecedent: right_tip}}
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.decoding import MAX_DESCRIPTION_LENGTH, read_file_bytes
from robot_dynamics.model.formats.mdh_yaml.evaluator import YamlEvaluator
from robot_dynamics.model.formats.mdh_yaml.joints import find_role_conflict, read_spring
from robot_dynamics.model.formats.mdh_yaml.loops import list_loops, read_loops
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import check_joint
from robot_dynamics.model.robot import Frame, Link

if TYPE_CHECKING:
    from robot_dynamics.array_types import ArrayLike
    from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot


def read_supplemented_urdf(
    document: YamlDocument,
    values: Mapping[str, float | str],
    moving_base: bool | None,
    gravity: ArrayLike | None,
) -> Robot:
    """Return the robot of a validated document with the key urdf; the other arguments are those of `read_mdh_yaml`."""
    evaluator = YamlEvaluator(document, values)
    if gravity is None and "gravity" in document.data:
        gravity = evaluator.vector(document.data, "gravity", ())
    text, source = _read_urdf_text(document)
    urdf_name = source.name if isinstance(source, Path) else "urdf"
    robot = read_urdf(text, source=source, moving_base=moving_base, gravity=gravity)
    joints = _supplement_joints(evaluator, robot)
    names = [link.name for link in robot.links]
    poses = {frame.name: (frame.link, frame.placement) for frame in robot.frames}
    cuts = read_loops(document, list_loops(evaluator), joints, names, poses)
    cut_frames = [Frame(name, number, np.eye(4)) for number, name in enumerate(cuts.links, start=len(names))]
    try:
        return replace(
            robot,
            name=document.data.get("robot", robot.name),
            links=(*robot.links, *(Link(name, Inertia()) for name in cuts.links)),
            joints=(*joints, *cuts.joints),
            frames=(*robot.frames, *cut_frames),
            loops=cuts.loops,
            reader_warnings=tuple(f"{urdf_name}, {warning}" for warning in robot.reader_warnings),
        )
    except DescriptionError as error:
        document.fail((), str(error))


def _read_urdf_text(document: YamlDocument) -> tuple[str | bytes, str | Path]:
    """Return the URDF of a document, which contains it or the path of its file, and the name of the URDF.

    A document that was not read from a file opens no file, because its author may be unknown.
    """
    entry: str = document.data["urdf"]
    source = document.source
    if re.match(r"\s*<", entry.removeprefix("\ufeff")):
        return entry, f"{source}, urdf"
    if not isinstance(source, Path):
        document.fail(
            ("urdf",),
            f"{entry[:100]!r} is a path, but this text has no file, whose folder would be searched: give the text of "
            "the URDF instead (urdf: | and the text below, indented), or load the YAML from its file",
        )
    path = source.parent / entry
    try:
        return read_file_bytes(path, MAX_DESCRIPTION_LENGTH), path
    except DescriptionError as error:
        document.fail(("urdf",), f"{error}. A path from the folder of this file, or the text of a URDF, is needed")


class _Supplements(NamedTuple):
    """Entries of the document by name of the joint."""

    roles: dict[str, str]
    springs: dict[str, Any]
    initial_positions: dict[str, Any]


def _supplement_joints(evaluator: YamlEvaluator, robot: Robot) -> list[Joint]:
    """Return the joints of a robot with the roles, springs and initial positions of the document."""
    document = evaluator.document
    supplements = _Supplements(**{key: document.data.get(key, {}) for key in _Supplements._fields})
    cut_joints = {loop["joint"] for loop in document.data.get("loops", [])} - robot.joint_numbers.keys()
    for key, mapping in supplements._asdict().items():
        for name in mapping:
            if name in cut_joints:
                document.fail((key, name), f"loop {name!r} is cut at that joint: describe the joint there, in loops")
            if name not in robot.joint_numbers:
                document.fail((key, name), describe_unknown_name("moving joint", name, robot.joint_numbers))
    return [_supplement_joint(evaluator, joint, supplements) for joint in robot.joints]


def _supplement_joint(evaluator: YamlEvaluator, joint: Joint, supplements: _Supplements) -> Joint:
    """Return a joint with the role, spring and initial position of the document."""
    name = joint.name
    document = evaluator.document
    role = supplements.roles.get(name)
    spring = None
    if supplements.springs.get(name) is not None:
        spring = read_spring(evaluator, supplements.springs[name], ("springs", name))
    if conflict := find_role_conflict(role, spring, joint.mimic is not None):
        document.fail((f"{conflict.key}s", name), f"joint {name!r}: {conflict.message}")
    position = evaluator.number(supplements.initial_positions, name, ("initial_positions",))
    joint = replace(joint, actuated=role in (None, "actuated"), spring=spring, initial_position=position)
    try:
        check_joint(joint.antecedent + 1, joint)
    except DescriptionError as error:
        document.fail(("springs", name), str(error))
    return joint
