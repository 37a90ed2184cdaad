"""The HTML of an object, by its class."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

from robot_dynamics.notebook.check_summary import check_html
from robot_dynamics.notebook.map_tables import frequency_map_html, pose_map_html
from robot_dynamics.notebook.markup import to_text
from robot_dynamics.notebook.result_tables import (
    base_parameters_html,
    dynamics_result_html,
    equilibrium_html,
    flexible_result_html,
    motion_html,
    natural_frequencies_html,
    rollouts_html,
)
from robot_dynamics.notebook.robot_tables import dynamics_html, robot_html

if TYPE_CHECKING:
    from collections.abc import Callable

    from lxml.html import HtmlElement

logger = logging.getLogger(__name__)

FORMATTERS: dict[str, Callable[[Any], HtmlElement]] = {
    "checking.check.CheckResult": check_html,
    "dynamics.Dynamics": dynamics_html,
    "flexible.elastodynamics.NaturalFrequencies": natural_frequencies_html,
    "flexible.flexible_arm.FlexibleDynamicsResult": flexible_result_html,
    "flexible.frequency_map.FrequencyMap": frequency_map_html,
    "identification.base_parameters.BaseParameters": base_parameters_html,
    "model.robot.Robot": robot_html,
    "parallel.pose_map.PoseMap": pose_map_html,
    "results.DynamicsResult": dynamics_result_html,
    "results.Equilibrium": equilibrium_html,
    "results.JointMotion": motion_html,
    "simulation.rollouts.Rollouts": rollouts_html,
}
"""By the name of the class in this package: a class is imported where there is an object of it, and not for a table."""


def format_html(value: object) -> str | None:
    """Return the HTML of an object; None, so that a notebook shows its text, where it has none or cannot be formatted.

    It never raises: an error here would hide the object that the notebook shows.
    """
    package = __name__.partition(".")[0]
    for cls in type(value).__mro__:
        formatter = FORMATTERS.get(f"{cls.__module__}.{cls.__qualname__}".removeprefix(f"{package}."))
        if formatter is not None:
            try:
                return to_text(formatter(value))
            except Exception:
                logger.warning("%s has no HTML", cls.__name__, exc_info=True)
                return None
    return None
