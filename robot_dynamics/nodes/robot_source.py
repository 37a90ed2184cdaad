"""The robot of a node: from its parameters or from the latched topic robot_description, also while it runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias
from weakref import WeakKeyDictionary, WeakSet

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import DescriptionError, RobotDynamicsError
from robot_dynamics.model.loading import read_description, read_robot
from robot_dynamics.model.robot import MASSLESS_WARNING
from robot_dynamics.nodes.diagnostics import ERROR, OK, WARN
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.parameter_requests import ParameterRequests, run_in_executor, yielding_thread
from robot_dynamics.nodes.parameters import declare_parameters, refuse_startup_changes
from robot_dynamics.nodes.qos import LATCHED_QOS
from robot_dynamics.nodes.robot_parameters import (
    BASES,
    PARAMETERS,
    check_folder,
    payload_settings,
    safe_payload,
    with_locked_joints,
    with_payload,
)

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.nodes.diagnostics import Level
    from robot_dynamics.nodes.parameters import ParameterValues

TOPIC_SOURCE = "topic robot_description"
DESCRIPTION_PARAMETERS = ("robot_description", "robot_file", "robot_path", "base", "gravity")  # in DescriptionKey

Outcome: TypeAlias = Dynamics | Exception | None
"""Result of loading a robot: None where nothing describes one."""


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
    While the node runs, a worker loads descriptions, and the executor of the node serves the present robot meanwhile.
    Only parameters that the process of the node itself sets, by `Node.set_parameters`, block it.

    Parameters
    ----------
    on_new_robot : called with each new Dynamics, in the thread of the executor.
    worker : loads descriptions; it must have one thread. None: a worker of its own.
    require_changeable : called with the name of a parameter before its change is prepared; raises InvalidInputError if
        it cannot change in the present state of the node.
    controls : whether the node computes feedback by the model. A payload that no body has is then not used: without
        second moments it is taken for a point mass, and else the payload before stays in force.
    on_loaded : called with each new Dynamics where it is loaded, in the worker while the node runs, before it is used:
        for what the node needs of the robot and takes long.

    Attributes
    ----------
    rejection_reason : why the last change was refused, or why there is no robot; empty otherwise.
    description : how the description of the present robot was read; None without a robot.
    """

    def __init__(
        self,
        node: Node,
        on_new_robot: Callable[[Dynamics], None] | None = None,
        worker: Executor | None = None,
        require_changeable: Callable[[str], None] | None = None,
        on_loaded: Callable[[Dynamics], None] | None = None,
        controls: bool = False,
    ) -> None:
        self._node = node
        self._controls = controls
        # the payload that each has, and why it is not that of the parameters
        self._payloads: WeakKeyDictionary[Dynamics, tuple[ParameterValues, str]] = WeakKeyDictionary()
        self._on_loaded = on_loaded
        self._on_new_robot = on_new_robot
        self._worker = worker or ThreadPoolExecutor(1, thread_name_prefix="robot")
        self._require_changeable = require_changeable
        self._last_read: tuple[DescriptionKey, Robot] | None = None  # reused for another payload
        # of the last description with a payload: clients send requests again that have no response yet
        self._last_outcome: tuple[object, Outcome] | None = None
        self.description: DescriptionKey | None = None
        self._prepared: tuple[object, Outcome] | None = None  # for the change that follows
        self._newest_text = ""  # on the topic
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
        self._requests = ParameterRequests(node, self._prepare_change, self._worker)
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
        warnings += filter(None, [self._payloads[self._dynamics][1]])
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
        outcome_key = key, [repr(settings[name]) for name in PARAMETERS if name not in DESCRIPTION_PARAMETERS]
        if self._last_outcome is None or self._last_outcome[0] != outcome_key:
            self._last_outcome = outcome_key, _try(lambda: self._build(key, settings))
        dynamics = _unwrap(self._last_outcome[1])
        assert dynamics is not None, "a description was given"
        return dynamics

    def _build(self, key: DescriptionKey, settings: ParameterValues) -> Dynamics:
        """Return the Dynamics of a description with the payload of the parameters."""
        if self._last_read is not None and self._last_read[0] == key:
            robot = self._last_read[1]
        else:
            robot = read_robot(key.text, source=key.source, moving_base=key.moving_base, gravity=key.gravity)
            self._last_read = key, robot
        payload, objection = payload_settings(settings), ""
        if self._controls:
            present = self._payloads[self._dynamics][0] if self._dynamics is not None else None
            payload, objection = safe_payload(settings, present)
        loaded = with_payload(with_locked_joints(robot, settings), payload)
        _ = loaded.warnings  # computed here, in the worker; strict and the log need them
        if settings["strict"]:
            loaded.raise_on_warnings()
        dynamics = Dynamics(loaded)
        if robot.is_massless:
            self._massless.add(dynamics)
        self._payloads[dynamics] = payload, objection
        if self._on_loaded is not None:
            self._on_loaded(dynamics)
        return dynamics

    def _adopt(self, dynamics: Dynamics | None) -> None:
        self._dynamics = dynamics
        if dynamics is None:
            return
        if self._last_read is not None:
            self.description = self._last_read[0]
        self.rejection_reason = ""
        logger = self._node.get_logger()
        robot = dynamics.robot
        objection = self._payloads[dynamics][1]
        link = self._node.get_parameter("payload.link").value
        mass = self._node.get_parameter("payload.mass").value
        payload = f"{mass} kg on {link!r}" if link else "no payload"
        payload = "a payload that differs from its parameters" if objection else payload
        logger.info(f"serving {robot!r}, {payload}, gravity {robot.gravity}")
        warnings = [MASSLESS_WARNING] if self.is_massless(dynamics) else []
        warnings += [objection] if objection else []
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

    def _changed_settings(self, parameters: Sequence[Parameter]) -> ParameterValues | None:
        """Return all settings with changes; None if there are none. Raises InvalidInputError or DescriptionError."""
        changes: dict[str, Any] = {p.name: p.value for p in parameters if p.name in PARAMETERS}
        if not changes:
            return None
        refuse_startup_changes(PARAMETERS, parameters)
        settings = self._settings(changes)
        if settings["robot_file"] != self._node.get_parameter("robot_file").value:
            check_folder(settings["robot_file"], settings["robot_path"])
        return settings

    def _state_key(self, settings: ParameterValues) -> object:
        """Return what decides the outcome of a change: equal for equal settings, also with nan."""
        return self._published_text, [value if isinstance(value, str) else repr(value) for value in settings.values()]

    def _prepare_change(self, parameters: Sequence[Parameter]) -> Callable[[], None] | None:
        """Return the work before a change of parameters: to load the robot. `_before_change` takes the outcome."""
        if self._require_changeable is not None:
            for parameter in parameters:
                self._require_changeable(parameter.name)
        settings = self._changed_settings(parameters)
        if settings is None:
            return None

        def work() -> None:
            with yielding_thread():
                self._prepared = self._state_key(settings), _try(lambda: self._load(settings))

        return work

    def _before_change(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        def change() -> None:
            settings = self._changed_settings(parameters)
            if settings is None:
                return
            prepared = self._prepared
            self._prepared = None
            if prepared is not None and prepared[0] == self._state_key(settings):
                self._candidate = _unwrap(prepared[1])
            else:
                self._candidate = self._load(settings)

        has_changes = any(parameter.name in PARAMETERS for parameter in parameters)
        reason = self._try_change(change) if has_changes else ""
        return SetParametersResult(successful=not reason, reason=reason)

    def _after_change(self, parameters: Sequence[Parameter]) -> None:
        if any(parameter.name in PARAMETERS for parameter in parameters):
            self._adopt(self._candidate)

    def _on_description(self, message: String) -> None:
        """Load the text on the topic, which is never a path; it is used if no parameter names a robot."""
        text = message.data
        self._newest_text = text
        if text != self._published_text:  # the same text once more is no change
            self._worker.submit(self._load_published, text)

    def _load_published(self, text: str) -> None:
        """Load a text of the topic, in the worker, unless a newer one has come."""
        if text is not self._newest_text:
            return
        with yielding_thread():
            settings = _try(self._settings)
            outcome = (
                settings if isinstance(settings, Exception) else _try(lambda: self._read(text, TOPIC_SOURCE, settings))
            )
        run_in_executor(self._node, lambda: self._adopt_published(text, settings, outcome))

    def _adopt_published(self, text: str, settings: ParameterValues | Exception, outcome: Outcome) -> None:
        """Use the outcome of loading a text of the topic."""

        def change() -> None:
            dynamics = _unwrap(outcome)
            self._published_text = text
            values = self._settings()
            parameter = next((name for name in ("robot_description", "robot_file") if values[name]), None)
            if parameter is None:
                self._adopt(dynamics)
            else:
                self._node.get_logger().info(f"robot on the topic robot_description is not used: {parameter} is set")

        if isinstance(settings, dict) and self._state_key(settings) != self._state_key(self._settings()):
            self._worker.submit(self._load_published, text)  # parameters have changed meanwhile
        else:
            self._try_change(change)


def _try(compute: Callable[[], Any]) -> Any:
    """Return a result, or the exception that was raised."""
    try:
        return compute()
    except Exception as error:
        return error


def _unwrap(outcome: Outcome) -> Dynamics | None:
    """Return a result of `_try`, or raise its exception."""
    if isinstance(outcome, Exception):
        raise outcome.with_traceback(None if isinstance(outcome, RobotDynamicsError) else outcome.__traceback__)
    return outcome
