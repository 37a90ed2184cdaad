"""Where a node gets its robot from, and how it gets another while it runs."""

from dataclasses import dataclass

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor, ParameterType, SetParametersResult
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import DescriptionError, QuestionError, RobotDynamicsError
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.library import find_description
from robot_dynamics.model.robot import EARTH, Robot
from robot_dynamics.model.urdf import read_urdf

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BASES = {"": None, "fixed": False, "moving": True}

# name: (default, type, what it is)
PARAMETERS = {
    "robot_description": ("", ParameterType.PARAMETER_STRING, "text of a URDF; comes before robot_file"),
    "robot_file": (
        "",
        ParameterType.PARAMETER_STRING,
        "path of a URDF, or the name of a robot that ships. "
        "Where this and robot_description are empty, the topic robot_description is listened to",
    ),
    "base": ("", ParameterType.PARAMETER_STRING, "fixed or moving; empty: as the description says"),
    "gravity": (list(EARTH), ParameterType.PARAMETER_DOUBLE_ARRAY, "x, y, z in the world [m/s^2]"),
    "strict": (False, ParameterType.PARAMETER_BOOL, "refuse inertias that no real body has, instead of warning"),
    "payload.link": ("", ParameterType.PARAMETER_STRING, "link that carries the payload, in whose frame it is given"),
    "payload.mass": (0.0, ParameterType.PARAMETER_DOUBLE, "[kg]"),
    "payload.first_moments": ([0.0] * 3, ParameterType.PARAMETER_DOUBLE_ARRAY, "mass times its centre x, y, z [kg m]"),
    "payload.inertia": (
        [0.0] * 6,
        ParameterType.PARAMETER_DOUBLE_ARRAY,
        "xx, xy, xz, yy, yz, zz about the origin of the link frame [kg m^2]",
    ),
}


@dataclass(frozen=True, eq=False)
class Loaded:
    """A robot as it was loaded: from where, without payload, and the dynamics of it with its payload."""

    key: tuple
    robot: Robot
    dynamics: Dynamics


class RobotSource:
    """The robot of a node, from its parameters or from the latched topic robot_description.

    A change is tried first: what cannot be loaded is refused with a reason, and the robot before it stays.
    """

    def __init__(self, node):
        self._node = node
        self._loaded = self._candidate = None
        self._published = None  # the last text on the topic that was a robot
        self.refusal = (
            "neither robot_description nor robot_file is set, and nothing came on the topic robot_description"
        )
        for name, (default, kind, description) in PARAMETERS.items():
            node.declare_parameter(name, default, ParameterDescriptor(type=kind, description=description))
        try:
            self._adopt(self._load(self._settings(), None))
        except RobotDynamicsError as error:
            self._refuse(error)
        node.add_on_set_parameters_callback(self._before_change)
        node.add_post_set_parameters_callback(self._after_change)
        self._subscription = node.create_subscription(String, "robot_description", self._on_description, LATCHED)

    @property
    def dynamics(self):
        """The Dynamics of the robot. Raises DescriptionError where none is loaded yet, saying why."""
        if self._loaded is None:
            raise DescriptionError(f"no robot is loaded: {self.refusal}")
        return self._loaded.dynamics

    @property
    def name(self):
        """Name of the robot, empty where none is loaded."""
        return self._loaded.robot.name if self._loaded else ""

    def _settings(self):
        return {name: self._node.get_parameter(name).value for name in PARAMETERS}

    def _load(self, settings, published):
        """What the settings and the text of the topic say, or None where they name no robot."""
        description = settings["robot_description"] or settings["robot_file"] or published
        if not description:
            if self._loaded is not None:
                raise DescriptionError("the description would be empty: set robot_description or robot_file to another")
            return None
        if settings["base"] not in BASES:
            raise DescriptionError(f"parameter base is {settings['base']!r}: fixed, moving or nothing is right")
        key = (description, settings["base"], *settings["gravity"])
        if self._loaded is not None and self._loaded.key == key:
            robot = self._loaded.robot
        else:
            text, source = find_description(description)
            robot = read_urdf(text, source=source, moving_base=BASES[settings["base"]], gravity=settings["gravity"])
        carrying = with_payload(robot, settings)
        if settings["strict"]:
            carrying.refuse_doubtful()
        return Loaded(key, robot, Dynamics(carrying))

    def _adopt(self, loaded):
        self._loaded, logger = loaded, self._node.get_logger()
        if loaded is None:
            return
        self.refusal = ""
        robot = loaded.dynamics.robot
        base = "moving" if robot.moving_base else "fixed"
        logger.info(f"robot {robot.name!r}: {len(loaded.dynamics.joint_names)} joints, {base} base")
        for warning in robot.warnings:
            logger.warning(f"robot {robot.name!r}: {warning}")

    def _refuse(self, error):
        self.refusal = str(error)
        kept = f"; the robot {self.name!r} stays loaded" if self._loaded else ""
        self._node.get_logger().error(f"robot refused: {error}{kept}")

    def _before_change(self, parameters):
        changes = {parameter.name: parameter.value for parameter in parameters if parameter.name in PARAMETERS}
        if changes:
            try:
                self._candidate = self._load({**self._settings(), **changes}, self._published)
            except RobotDynamicsError as error:
                self._refuse(error)
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _after_change(self, parameters):
        if any(parameter.name in PARAMETERS for parameter in parameters):
            self._adopt(self._candidate)

    def _on_description(self, message):
        try:
            loaded = self._load(self._settings(), message.data or " ")
        except RobotDynamicsError as error:
            self._refuse(error)
            return
        self._published = message.data
        if self._loaded is None or loaded.key != self._loaded.key:
            self._adopt(loaded)


def with_payload(robot, settings):
    """The robot with the payload that the parameters describe."""
    for name in ("payload.first_moments", "payload.inertia"):
        if len(settings[name]) != len(PARAMETERS[name][0]):
            raise QuestionError(
                f"parameter {name} has {len(settings[name])} values, {len(PARAMETERS[name][0])} are needed: "
                f"{PARAMETERS[name][2]}"
            )
    xx, xy, xz, yy, yz, zz = settings["payload.inertia"]
    payload = Inertia(
        settings["payload.mass"], settings["payload.first_moments"], [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    )
    link = settings["payload.link"]
    if link:
        return robot.with_payload(link, payload)
    if np.any(payload.spatial):
        raise QuestionError("the payload has a mass or moments, but parameter payload.link names no link to carry it")
    return robot
