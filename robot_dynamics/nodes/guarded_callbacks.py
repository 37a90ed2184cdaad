"""The handling of exceptions in callbacks of the nodes: each becomes a reason, and the node goes on."""

import traceback

from rclpy.impl.rcutils_logger import RcutilsLogger

from robot_dynamics.errors import RobotDynamicsError


def failure_reason(logger: RcutilsLogger, error: Exception) -> str:
    """Return the reason that an exception in a callback is reported with.

    It is the message of a RobotDynamicsError. Any other exception is a defect of this package: it must not end the
    node, on which a robot may depend, so its traceback is logged as an error, at most once a second.
    """
    if isinstance(error, RobotDynamicsError):
        return str(error)
    logger.error("".join(traceback.format_exception(error)), throttle_duration_sec=1.0)
    return f"internal error, please report it: {error!r}"


def refusal_reason(logger: RcutilsLogger, topic: str, error: Exception) -> str:
    """Return the reason why a message on a topic is refused: it begins with the topic."""
    reason = failure_reason(logger, error)
    return reason if reason.startswith(topic) else f"{topic}: {reason}"
