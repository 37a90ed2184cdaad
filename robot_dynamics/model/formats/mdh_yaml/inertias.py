"""Inertias of a YAML description."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.placement import placement

if TYPE_CHECKING:
    from robot_dynamics.model.formats.mdh_yaml.document import YamlMapping, YamlPath
    from robot_dynamics.model.formats.mdh_yaml.evaluator import YamlEvaluator


def read_inertia(evaluator: YamlEvaluator, body: YamlMapping, path: YamlPath) -> Inertia:
    """Return the inertia about the origin of its frame of the body at a path.

    A body has mass with first_moments and inertia about the origin, or with centre_of_mass and central_inertia.
    """
    document = evaluator.document
    central_keys = {"centre_of_mass", "central_inertia"} & body.keys()
    origin_keys = {"first_moments", "inertia"} & body.keys()
    if central_keys and origin_keys:
        document.fail(
            path,
            f"{central_keys.pop()} and {origin_keys.pop()} exclude each other: give first_moments and inertia "
            "about the origin of the frame, or centre_of_mass and central_inertia",
        )
    if central_keys and "mass" not in body:
        document.fail(path, f"mass missing: {central_keys.pop()} needs it")
    mass = evaluator.number(body, "mass", path)
    if mass < 0:
        document.fail((*path, "mass"), f"mass {mass:g} kg is negative")
    if not central_keys:
        first_moments = evaluator.vector(body, "first_moments", path)
        return Inertia(mass, first_moments, evaluator.matrix(body, "inertia", path))
    centre = placement(translation=evaluator.vector(body, "centre_of_mass", path))
    return Inertia.about_centre_of_mass(mass, evaluator.matrix(body, "central_inertia", path), centre)
