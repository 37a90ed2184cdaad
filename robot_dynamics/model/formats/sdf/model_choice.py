"""Which model of an SDF is the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.sdf.inclusion import MissingModelError
from robot_dynamics.model.formats.sdf.scopes import ModelSource, included_model

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.formats.sdf.document import SdfDocument

WORLD_GRAVITY = (0.0, 0.0, -9.8)
"""What SDF defines for a world without <gravity> [m/s²]."""


def choose_model(document: SdfDocument) -> tuple[ModelSource, Array | None]:
    """Return the model that is the robot, and the gravity (3,) of its world [m/s²], None where it is in no world.

    In a world it is the only model that is not static, or the only one of these with joints.

    Raises
    ------
    DescriptionError
        If there is no such model, or several.
    """
    root = document.root
    worlds = root.findall("world")
    if len(worlds) > 1:
        document.fail(worlds[1], "a second <world>: one is read")
    holder = worlds[0] if worlds else root
    models, missing = [], None
    for element in holder.iterchildren(etree.Element):
        if element.tag == "model":
            models.append(ModelSource(element, document))
        elif element.tag == "include":
            try:
                models.append(included_model(document, element))
            except MissingModelError as error:
                missing = missing or error
                document.warnings.add(element, f"{str(error).split(': ', 1)[1]}. It is left out", "<include>")
            except DescriptionError:
                if not worlds:
                    raise
        elif element.tag == "joint" and worlds:
            document.fail(element, "a <joint> in <world> connects models: write them as one model")
    candidates = [model for model in models if not model.is_static]
    moving = [model for model in candidates if next(model.element.iter("joint", "include"), None) is not None]
    robots = moving if len(candidates) > 1 and moving else candidates
    if len(robots) > 1:
        names = ", ".join(repr(model.name) for model in robots[:5])
        document.fail(holder, f"models {names} move: one robot is read. Keep one of them in a file of its own")
    if not robots:
        if missing is not None:
            raise missing
        if models:
            document.fail(models[0].element, f"model {models[0].name!r} is static, so that nothing moves")
        document.fail(holder, f"<{holder.tag}> has no <model>")
    for model in candidates:
        if model is not robots[0]:
            message = f"model {model.name!r} has no joints and is left out: {robots[0].name!r} is the robot"
            document.warnings.add(model.element, message)
    return robots[0], _gravity(document) if worlds else None


def _gravity(document: SdfDocument) -> Array:
    """Return the gravity (3,) of the world of a document."""
    world = document.root.find("world")
    physics = world.find("physics")
    for holder in (world, physics):
        element = None if holder is None else document.child(holder, "gravity")
        if element is not None:
            return document.vector(element)
    return np.array(WORLD_GRAVITY)
