"""Where a node gets its robot from, and how it gets another while it runs."""

import traceback
from weakref import WeakSet

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from std_msgs.msg import String

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import DescriptionError, InvalidInputError, RobotDynamicsError
from robot_dynamics.model.inertia import Inertia, symmetric_matrix
from robot_dynamics.model.loading import read_description, read_robot
from robot_dynamics.model.robot import MASSLESS_WARNING
from robot_dynamics.nodes.diagnostics import ERROR, OK, WARN
from robot_dynamics.nodes.parameters import convert_parameter, declare_parameters
from robot_dynamics.nodes.qos import LATCHED_QOS

BASES = {"": None, "fixed": False, "moving": True}

# name: (default, what it is)
PARAMETERS = {
    "robot_description": ("", "text of a URDF, an MDH table or a .par; comes before robot_file"),
    "robot_file": (
        "",
        "path of a URDF, an MDH table or a .par, or the name of a robot that ships. "
        "Where this and robot_description are empty, the topic robot_description is listened to",
    ),
    "base": ("", "fixed or moving; empty: as the description says"),
    "gravity": ("", "x, y, z in the world [m/s^2]; empty: as the description says, else the Earth's"),
    "strict": (False, "refuse inertias that no real body has, instead of warning"),
    "payload.link": ("", "link that carries the payload, in whose frame it is given; empty: there is none"),
    "payload.mass": (0.0, "[kg]"),
    "payload.first_moments": ([0.0] * 3, "mass times its centre x, y, z [kg m]"),
    "payload.inertia": ([0.0] * 6, "xx, xy, xz, yy, yz, zz about the origin of the link frame [kg m^2]"),
}


class RobotSource:
    """The robot of a node, from its parameters or from the latched topic robot_description.

    A change is tried first: what cannot be loaded is refused with a reason, and the robot before it stays.

    adopted: called with each new Dynamics. worker: a concurrent.futures.Executor that loads what comes on the topic,
    and calls `adopted` of it, while the node goes on with its other work; None: the node waits for it.
    """

    def __init__(self, node, on_new_robot=None, worker=None):
        self._node, self._adopted, self._worker = node, on_new_robot, worker
        self._bare = None, None  # what was read last, and the robot of it: another payload is no reason to read again
        self._dynamics = self._candidate = None
        self._massless = WeakSet()  # each Dynamics of a description without masses
        self._published = None  # the last text on the topic that was a robot
        self.rejection_reason = (
            "neither robot_description nor robot_file is set, and nothing came on the topic robot_description"
        )
        declare_parameters(node, PARAMETERS)
        refused = self._try(lambda: self._adopt(self._load(self._settings())))
        if not refused and self._dynamics is None:
            topic = node.resolve_topic_name("robot_description")
            node.get_logger().info(
                f"no robot yet: waiting for {topic}, or for parameter robot_file or robot_description"
            )
        node.add_on_set_parameters_callback(self._before_change)
        node.add_post_set_parameters_callback(self._after_change)
        self._subscription = node.create_subscription(String, "robot_description", self._on_description, LATCHED_QOS)

    @property
    def dynamics(self):
        """The Dynamics of the robot. Raises DescriptionError where none is loaded yet, saying why."""
        if self._dynamics is None:
            raise DescriptionError(f"no robot is loaded: {self.rejection_reason}")
        return self._dynamics

    @property
    def name(self):
        """Name of the robot, empty where none is loaded."""
        return self._dynamics.robot.name if self._dynamics else ""

    def is_massless(self, dynamics):
        """Whether the description of a Dynamics from here has no masses. A payload does not make up for them."""
        return dynamics in self._massless

    @property
    def reliability_warning(self):
        """Why results of the robot are not to be relied on: a sentence, empty for most robots."""
        return f"robot {self.name!r}: {MASSLESS_WARNING}" if self.is_massless(self._dynamics) else ""

    def health(self):
        """(level, message) of a DiagnosticStatus: whether a robot is loaded, and whether its last change was."""
        if not self.name:
            return ERROR, f"no robot is loaded: {self.rejection_reason}"
        if self.rejection_reason:
            return WARN, f"last change refused: {self.rejection_reason}"
        if self.reliability_warning:
            return WARN, self.reliability_warning
        return OK, f"serving {self.name!r}"

    def _settings(self, changes=()):
        """The values of PARAMETERS, each in its type, as they are or would be after changes {name: value}."""
        values = {name: self._node.get_parameter(name).value for name in PARAMETERS}
        values.update(changes)
        return {name: convert_robot_parameter(name, value) for name, value in values.items()}

    def _load(self, settings):
        """The Dynamics of the robot that the settings name, else of the one on the topic, else None."""
        if settings["robot_description"]:
            text, source = settings["robot_description"], "parameter robot_description"
        elif settings["robot_file"]:
            text, source = read_description(settings["robot_file"])
        elif self._published is not None:
            text, source = self._published, "topic robot_description"
        elif self._dynamics is None:
            return None
        else:
            raise DescriptionError(
                "the description would be empty: set robot_description or robot_file, or publish it before"
            )
        return self._read(text, source, settings)

    def _read(self, text, source, settings):
        if settings["base"] not in BASES:
            raise DescriptionError(f"parameter base is {settings['base']!r}: fixed, moving or nothing is right")
        told = {"moving_base": BASES[settings["base"]], "gravity": settings["gravity"] or None}
        read, robot = self._bare
        if read != (text, source, told):
            robot = read_robot(text, source=source, **told)
            self._bare = (text, source, told), robot
        loaded = with_payload(robot, settings)
        if settings["strict"]:
            loaded.raise_on_warnings()
        dynamics = Dynamics(loaded)
        if robot.is_massless:
            self._massless.add(dynamics)
        return dynamics

    def _adopt(self, dynamics):
        self._dynamics, logger = dynamics, self._node.get_logger()
        if dynamics is None:
            return
        self.rejection_reason = ""
        robot = dynamics.robot
        link, mass = (self._node.get_parameter(f"payload.{name}").value for name in ("link", "mass"))
        logger.info(f"serving {robot!r}, {f'{mass} kg on {link!r}' if link else 'no payload'}, gravity {robot.gravity}")
        of_description = [MASSLESS_WARNING] if self.is_massless(dynamics) else []
        for warning in dict.fromkeys([*of_description, *robot.warnings]):
            logger.warning(f"robot {robot.name!r}: {warning}")
        if self._adopted is not None:
            self._adopted(dynamics)

    def _try(self, change):
        """Make a change, or tell why it is refused and let the robot stay. Returns the reason, empty if none."""
        try:
            change()
            return ""
        except RobotDynamicsError as error:
            self.rejection_reason = str(error)
        except Exception as error:  # a fault of ours must not take the node, and all that depends on it, down
            self._node.get_logger().error(traceback.format_exc())
            self.rejection_reason = f"internal error, please report it: {error!r}"
        kept = f"; the robot {self.name!r} stays loaded" if self._dynamics else ""
        self._node.get_logger().error(f"robot refused: {self.rejection_reason}{kept}")
        return self.rejection_reason

    def _before_change(self, parameters):
        changes = {parameter.name: parameter.value for parameter in parameters if parameter.name in PARAMETERS}

        def change():
            self._candidate = self._load(self._settings(changes))

        reason = self._try(change) if changes else ""
        return SetParametersResult(successful=not reason, reason=reason)

    def _after_change(self, parameters):
        if any(parameter.name in PARAMETERS for parameter in parameters):
            self._adopt(self._candidate)

    def _on_description(self, message):
        """Take the text of the topic, never a path; use it where no parameter names a robot."""

        def change():
            settings = self._settings()
            dynamics = self._read(message.data, "topic robot_description", settings)
            self._published = message.data
            parameter = next((name for name in ("robot_description", "robot_file") if settings[name]), None)
            if parameter is None:
                self._adopt(dynamics)
            else:
                self._node.get_logger().info(f"robot on the topic robot_description kept aside: {parameter} is set")

        if self._worker is None:
            self._try(change)
        elif message.data != self._published:  # the same once more is no change
            self._worker.submit(self._try, change)


def convert_robot_parameter(name, value):
    """The value of a parameter in the type of its default. Raises QuestionError saying what would be right."""
    if name == "gravity" and np.size(value) == 0:  # an empty list says as little as an empty text
        value = ""
    default = [0.0] * 3 if name == "gravity" and value != "" else PARAMETERS[name][0]
    return convert_parameter(default, name, value, PARAMETERS[name][1])


def with_payload(robot, settings):
    """The robot with the payload that the parameters describe; where payload.link names no link nothing is carried."""
    moments = symmetric_matrix(*settings["payload.inertia"])
    payload = Inertia(settings["payload.mass"], settings["payload.first_moments"], moments)
    try:
        return robot.with_payload(settings["payload.link"], payload) if settings["payload.link"] else robot
    except InvalidInputError as error:
        raise InvalidInputError(f"parameter payload.link: {error}") from None
