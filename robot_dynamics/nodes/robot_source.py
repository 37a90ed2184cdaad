"""The robot of a node: from its parameters or from the latched topic robot_description, also while it runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import DescriptionError, InvalidInputError
from robot_dynamics.model.inertia import Inertia, symmetric_matrix
from robot_dynamics.model.loading import read_description, read_robot
from robot_dynamics.model.robot import MASSLESS_WARNING, attach_payload
from robot_dynamics.nodes.diagnostics import ERROR, OK, WARN
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.parameters import (
    ParameterSpec,
    by_name,
    declare_parameters,
)
from robot_dynamics.nodes.qos import LATCHED_QOS

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.nodes.diagnostics import Level
    from robot_dynamics.nodes.parameters import (
        ParameterValues,
    )

BASES = {"": None, "fixed": False, "moving": True}  # value of parameter base: whether the base moves
TOPIC_SOURCE = "topic robot_description"

PARAMETERS = by_name(
    ParameterSpec(
        "robot_description",
        "",
        "text of a URDF, an MDH table or a .par; overrides robot_file",
        read_at="configuration",
    ),
    ParameterSpec(
        "robot_file",
        "",
        "path of a URDF, an MDH table or a .par, or the name of a robot that ships. Where this and "
        "robot_description are empty, the topic robot_description is used",
        read_at="configuration",
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
        "strict",
        False,
        "refuse what the warnings at start name, such as inertias that no real body has",
        read_at="configuration",
    ),
    ParameterSpec(
        "payload.link", "", "link that carries the payload, in whose frame it is given; empty: there is none"
    ),
    ParameterSpec("payload.mass", 0.0, "[kg]", lower_bound=0.0),
    ParameterSpec("payload.first_moments", [0.0] * 3, "mass times its centre x, y, z [kg m]"),
    ParameterSpec("payload.inertia", [0.0] * 6, "xx, xy, xz, yy, yz, zz about the origin of the link frame [kg m^2]"),
)


@dataclass(frozen=True)
class DescriptionKey:
    """All that decides how a description is read; the payload does not."""

    text: str | bytes
    source: str | Path
    moving_base: bool | None
    gravity: tuple[float, ...] | None


class RobotSource:
    """The robot of a node, from its parameters or from the latched topic robot_description.

    A change is tried first: a description that cannot be loaded is refused with a reason, and the loaded robot stays.

    Parameters
    ----------
    on_new_robot : called with each new Dynamics.
    worker : loads descriptions from the topic, and calls `on_new_robot` for them, while the node goes on; None: the
        node waits for it.

    Attributes
    ----------
    rejection_reason : why the last change was refused, or why there is no robot; empty otherwise.
    """

    def __init__(
        self,
        node: Node,
        on_new_robot: Callable[[Dynamics], None] | None = None,
        worker: Executor | None = None,
    ) -> None:
        self._node = node
        self._on_new_robot = on_new_robot
        self._worker = worker
        self._last_read: tuple[DescriptionKey, Robot] | None = None  # reused for another payload
        self._dynamics: Dynamics | None = None
        self._candidate: Dynamics | None = None
        self._massless: WeakSet[Dynamics] = WeakSet()
        self._published_text: str | None = None  # last valid description on the topic
        self.rejection_reason = (
            "neither robot_description nor robot_file is set, and nothing came on the topic robot_description"
        )
        declare_parameters(node, PARAMETERS)
        rejection = self._try_change(lambda: self._adopt(self._load(self._settings())))
        if rejection:
            node.get_logger().info(
                "no robot yet: waiting for another description. Correct the parameter with ros2 param set, or restart "
                "the node"
            )
        elif self._dynamics is None:
            topic = node.resolve_topic_name("robot_description")
            node.get_logger().info(
                f"no robot yet: waiting for {topic}, or for parameter robot_file or robot_description"
            )
        node.add_on_set_parameters_callback(self._before_change)
        node.add_post_set_parameters_callback(self._after_change)
        self._subscription = node.create_subscription(String, "robot_description", self._on_description, LATCHED_QOS)

    @property
    def dynamics(self) -> Dynamics:
        """The Dynamics of the robot. Raises DescriptionError with the reason if no robot is loaded."""
        if self._dynamics is None:
            raise DescriptionError(f"no robot is loaded: {self.rejection_reason}")
        return self._dynamics

    @property
    def name(self) -> str:
        """Name of the robot, empty if none is loaded."""
        return self._dynamics.robot.name if self._dynamics is not None else ""

    def is_massless(self, dynamics: Dynamics) -> bool:
        """Whether the description of a Dynamics from here has no masses; a payload does not count."""
        return dynamics in self._massless

    @property
    def reliability_warning(self) -> str:
        """Why results of the robot are unreliable: a sentence, empty for most robots."""
        if self._dynamics is None:
            return ""
        warnings = [MASSLESS_WARNING] if self.is_massless(self._dynamics) else []
        warnings += self._dynamics.robot.payload_warnings
        return f"robot {self.name!r}: {'; '.join(warnings)}" if warnings else ""

    def health(self) -> tuple[Level, str]:
        """Level and message of a DiagnosticStatus: whether a robot is loaded, and whether the last change succeeded."""
        if not self.name:
            return ERROR, f"no robot is loaded: {self.rejection_reason}"
        if self.rejection_reason:
            return WARN, f"last change refused: {self.rejection_reason}"
        if self.reliability_warning:
            return WARN, self.reliability_warning
        return OK, f"serving {self.name!r}"

    def _settings(self, changes: Mapping[str, object] | None = None) -> ParameterValues:
        """Return the validated parameters, with changes {name: value} if there are any."""
        values = {name: self._node.get_parameter(name).value for name in PARAMETERS}
        values.update(changes or {})
        return {name: PARAMETERS[name].validate(value) for name, value in values.items()}

    def _load(self, settings: ParameterValues) -> Dynamics | None:
        """Return the Dynamics of the robot in the parameters, else of that on the topic, else None."""
        text: str | bytes
        source: str | Path
        if settings["robot_description"]:
            text, source = settings["robot_description"], "parameter robot_description"
        elif settings["robot_file"]:
            text, source = read_description(settings["robot_file"])
        elif self._published_text is not None:
            text, source = self._published_text, TOPIC_SOURCE
        elif self._dynamics is None:
            return None
        else:
            raise DescriptionError(
                "the description would be empty: set robot_description or robot_file, or publish it before"
            )
        return self._read(text, source, settings)

    def _read(self, text: str | bytes, source: str | Path, settings: ParameterValues) -> Dynamics:
        base = settings["base"]
        if base not in BASES:
            raise DescriptionError(f"parameter base is {base!r}: fixed, moving or nothing is right")
        key = DescriptionKey(text, source, BASES[base], tuple(settings["gravity"]) or None)
        if self._last_read is not None and self._last_read[0] == key:
            robot = self._last_read[1]
        else:
            robot = read_robot(text, source=source, moving_base=key.moving_base, gravity=settings["gravity"] or None)
            self._last_read = key, robot
        loaded = with_payload(robot, settings)
        if settings["strict"]:
            loaded.raise_on_warnings()
        dynamics = Dynamics(loaded)
        if robot.is_massless:
            self._massless.add(dynamics)
        return dynamics

    def _adopt(self, dynamics: Dynamics | None) -> None:
        self._dynamics = dynamics
        if dynamics is None:
            return
        self.rejection_reason = ""
        logger = self._node.get_logger()
        robot = dynamics.robot
        link = self._node.get_parameter("payload.link").value
        mass = self._node.get_parameter("payload.mass").value
        payload = f"{mass} kg on {link!r}" if link else "no payload"
        logger.info(f"serving {robot!r}, {payload}, gravity {robot.gravity}")
        warnings = [MASSLESS_WARNING] if self.is_massless(dynamics) else []
        for warning in dict.fromkeys([*warnings, *robot.warnings]):
            logger.warning(f"robot {robot.name!r}: {warning}")
        if self._on_new_robot is not None:
            self._on_new_robot(dynamics)

    def _try_change(self, change: Callable[[], None]) -> str:
        """Make a change, or log why it is refused, and keep the robot. Return the reason, empty if it was made."""
        try:
            change()
        except Exception as error:
            self.rejection_reason = failure_reason(self._node.get_logger(), error)
        else:
            return ""
        kept = f"; the robot {self.name!r} stays loaded" if self._dynamics is not None else ""
        self._node.get_logger().error(f"robot refused: {self.rejection_reason}{kept}")
        return self.rejection_reason

    def _before_change(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        changes: dict[str, Any] = {p.name: p.value for p in parameters if p.name in PARAMETERS}

        def change() -> None:
            self._candidate = self._load(self._settings(changes))

        reason = self._try_change(change) if changes else ""
        return SetParametersResult(successful=not reason, reason=reason)

    def _after_change(self, parameters: Sequence[Parameter]) -> None:
        if any(parameter.name in PARAMETERS for parameter in parameters):
            self._adopt(self._candidate)

    def _on_description(self, message: String) -> None:
        """Load the text on the topic, which is never a path; it is used if no parameter names a robot."""

        def change() -> None:
            settings = self._settings()
            dynamics = self._read(message.data, TOPIC_SOURCE, settings)
            self._published_text = message.data
            parameter = next((name for name in ("robot_description", "robot_file") if settings[name]), None)
            if parameter is None:
                self._adopt(dynamics)
            else:
                self._node.get_logger().info(f"robot on the topic robot_description is not used: {parameter} is set")

        if self._worker is None:
            self._try_change(change)
        elif message.data != self._published_text:  # the same text once more is no change
            self._worker.submit(self._try_change, change)


def with_payload(robot: Robot, settings: ParameterValues) -> Robot:
    """Return the robot with the payload of the parameters; with an empty payload.link, the robot itself."""
    inertia = symmetric_matrix(*settings["payload.inertia"])
    payload = Inertia(settings["payload.mass"], np.array(settings["payload.first_moments"]), inertia)
    if not settings["payload.link"]:
        return robot
    try:
        return attach_payload(robot, settings["payload.link"], payload)
    except InvalidInputError as error:
        raise InvalidInputError(f"parameter payload.link: {error}") from None
