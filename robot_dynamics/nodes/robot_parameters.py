"""Parameters that describe the robot of a node, and what they make of a robot."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import DescriptionError, InvalidInputError, RobotDynamicsError, describe_unknown_name
from robot_dynamics.model.inertia import Inertia, symmetric_entries, symmetric_matrix
from robot_dynamics.model.loading import shipped_robots
from robot_dynamics.model.locked_joints import lock_joints, lock_massless_joints
from robot_dynamics.model.payload import find_control_objection, point_mass
from robot_dynamics.model.robot import attach_payload
from robot_dynamics.nodes.parameters import ParameterSpec, by_name

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.nodes.parameters import ParameterValues

BASES = {"": None, "fixed": False, "moving": True}  # value of parameter base: whether the base moves
MAX_PAYLOAD = 1e9  # [kg, kg m, kg m^2] numbers from here on are refused: no robot carries them

PARAMETERS = by_name(
    ParameterSpec(
        "robot_description",
        "",
        "text of a URDF, an SDF, an MJCF, an MDH table or a .par; overrides robot_file",
        read_at="configuration",
    ),
    ParameterSpec(
        "robot_file",
        "",
        "path of a URDF, a xacro, an SDF, an MJCF, an MDH table or a .par, or the name of a robot that ships. Where "
        "this and robot_description are empty, the topic robot_description is used",
        read_at="configuration",
    ),
    ParameterSpec(
        "robot_path",
        "",
        "folders whose files robot_file may name while the node runs, besides the share folders of ROS packages; at "
        "the start it may name any file",
        list_kind="names",
        read_at="startup",
    ),
    ParameterSpec("base", "", "fixed or moving; empty: as in the description", read_at="configuration"),
    ParameterSpec(
        "gravity",
        "",
        "x, y, z in the world [m/s^2]; empty: as in the description, else the Earth's",
        list_kind="numbers",
        size=3,
        read_at="configuration",
    ),
    ParameterSpec(
        "locked_joints",
        "",
        "joints that are locked: the robot is then one without them. Joints that mimic them are locked too",
        list_kind="names",
        read_at="configuration",
    ),
    ParameterSpec(
        "locked_positions",
        "",
        "position of each of locked_joints [rad or m]; empty: all zero",
        list_kind="numbers",
        read_at="configuration",
    ),
    ParameterSpec(
        "lock_massless",
        False,
        "lock the joints outside loops that move nothing with inertia, such as a finger without mass",
        read_at="configuration",
    ),
    ParameterSpec(
        "strict",
        False,
        "refuse what the warnings at start name, such as inertias that no real body has",
        read_at="configuration",
    ),
    ParameterSpec(
        "payload.link", "", "link that carries the payload, in whose frame it is given; empty: there is none"
    ),
    ParameterSpec("payload.mass", 0.0, "[kg]", lower_bound=0.0, upper_bound=MAX_PAYLOAD),
    ParameterSpec("payload.first_moments", [0.0] * 3, "mass times its centre x, y, z [kg m]"),
    ParameterSpec("payload.inertia", [0.0] * 6, "xx, xy, xz, yy, yz, zz about the origin of the link frame [kg m^2]"),
)


def check_folder(name: str, folders: Sequence[str]) -> None:
    """Refuse a file that a running node must not read: whoever may set parameters could read it by error messages.

    Parameters
    ----------
    name : path of a description, or name of a robot that ships.
    folders : from parameter robot_path.

    Raises
    ------
    DescriptionError
        Whether the file exists or not, so that the message does not show which files exist.
    """
    if not name or name in shipped_robots():
        return
    prefixes = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    allowed = [*map(Path, folders), *(Path(prefix) / "share" for prefix in prefixes)]
    path = Path(name).resolve()
    if not any(path.is_relative_to(folder.resolve()) for folder in allowed):
        hint = "" if "/" in name else f" ({describe_unknown_name('robot', name, shipped_robots())})"
        raise DescriptionError(
            f"parameter robot_file is {name!r}{hint}: a running node reads robots that ship, and files in the "
            f"folders of robot_path ({', '.join(folders) or 'empty'}) or of the share folders of ROS packages. Restart "
            "the node with this file, set robot_path at its start, or publish the description on robot_description"
        )


def with_locked_joints(robot: Robot, settings: ParameterValues) -> Robot:
    """Return the robot with the joints of the parameters locked; with an empty locked_joints, the robot itself."""
    names: Sequence[str] = settings["locked_joints"]
    positions: Sequence[float] = settings["locked_positions"]
    if positions and len(positions) != len(names):
        raise InvalidInputError(
            f"parameter locked_positions has {len(positions)} numbers and locked_joints {len(names)} names: one "
            "position for each joint is needed"
        )
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise InvalidInputError(f"parameter locked_joints names {', '.join(map(repr, repeated))} more than once")
    try:
        robot = lock_joints(robot, dict(zip(names, positions or [0.0] * len(names), strict=True)))
    except RobotDynamicsError as error:
        raise InvalidInputError(f"parameter locked_joints: {error}") from None
    return lock_massless_joints(robot) if settings["lock_massless"] else robot


def payload_settings(settings: ParameterValues) -> ParameterValues:
    """Return the parameters of the payload alone."""
    return {name: value for name, value in settings.items() if name.startswith("payload.")}


def payload_inertia(settings: ParameterValues) -> Inertia:
    """Return the inertia of the payload of the parameters, in the frame of its link."""
    for name in ("payload.first_moments", "payload.inertia"):
        if np.abs(settings[name]).max() >= MAX_PAYLOAD:
            raise InvalidInputError(
                f"parameter {name} is {settings[name]}: magnitudes below {MAX_PAYLOAD:g} are needed"
            )
    second_moments = symmetric_matrix(*settings["payload.inertia"])
    return Inertia(settings["payload.mass"], np.array(settings["payload.first_moments"]), second_moments)


def with_payload(robot: Robot, settings: ParameterValues) -> Robot:
    """Return the robot with the payload of the parameters; with an empty payload.link, the robot itself."""
    payload = payload_inertia(settings)
    if not settings["payload.link"]:
        return robot
    try:
        return attach_payload(robot, settings["payload.link"], payload)
    except InvalidInputError as error:
        raise InvalidInputError(f"parameter payload.link: {error}") from None


def safe_payload(settings: ParameterValues, present: ParameterValues | None) -> tuple[ParameterValues, str]:
    """Return parameters of a payload with which feedback by the model is safe.

    Parameters
    ----------
    settings : what was set.
    present : the payload that is in force; None where the node has no robot yet.

    Returns
    -------
    payload : of the settings; a point mass if they have no second moments; or else the one that is in force.
    objection : why it is not that of the settings; empty where it is.

    Raises
    ------
    InvalidInputError
        If the payload of the settings is not safe, and none is in force.
    """
    payload, link = payload_settings(settings), settings["payload.link"]
    inertia = payload_inertia(settings)
    objection = find_control_objection(link, inertia) if link else ""
    if not objection:
        return payload, ""
    if inertia.mass > 0 and not np.any(inertia.second_moments):
        entries = symmetric_entries(point_mass(inertia.mass, inertia.first_moments).second_moments)
        return {**payload, "payload.inertia": entries}, f"{objection}, which are used"
    if present is None:
        raise InvalidInputError(f"parameters payload.*: {objection}")
    return present, f"the payload before stays in force: {objection}"
