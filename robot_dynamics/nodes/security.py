"""Access control of ROS (SROS2): a node starts with the protection that the user asks for, or not at all."""

from collections.abc import Mapping

from robot_dynamics.errors import InvalidInputError

ENABLE = "ROS_SECURITY_ENABLE"
STRATEGY = "ROS_SECURITY_STRATEGY"
MISSING_LIBRARIES = "doesn't have the security libraries"  # Fast DDS


def check_security_strategy(environment: Mapping[str, str]) -> None:
    """Refuse the strategy with which rcl starts a node without protection where its keys are missing.

    Parameters
    ----------
    environment : variables of the process.

    Raises
    ------
    InvalidInputError
        If security is enabled and its strategy is not Enforce.
    """
    strategy = environment.get(STRATEGY, "")
    if environment.get(ENABLE) == "true" and strategy != "Enforce":
        raise InvalidInputError(
            f"{ENABLE} is true, but {STRATEGY} is {repr(strategy) if strategy else 'not set, which means Permissive'}: "
            f"without keys the node would start without protection. Set {STRATEGY}=Enforce, or unset {ENABLE}"
        )


def security_hint(reason: str) -> str:
    """Return what to do about a failure to start a node, empty if it has another cause than security."""
    if MISSING_LIBRARIES not in reason:
        return ""
    return (
        f". {ENABLE} is true, but the middleware of this Python is built without security, as in the wheels of ROS. "
        f"Use ROS 2 installed with apt, or unset {ENABLE}"
    )
