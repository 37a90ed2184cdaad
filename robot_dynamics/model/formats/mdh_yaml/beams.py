"""Flexible links of a YAML description: beams of rows, with the sections and materials that they refer to.

    materials: {steel: {youngs_modulus: 210e9, poissons_ratio: 0.3, density: 7850}}
    sections: {bar: {rectangle: {y: 0.01, z: 0.024}}}
    joints:
      - {joint: shoulder, link: arm, beams: [{to: [0.5, 0, 0], section: bar, material: steel, elements: 2}]}

The inertia of a row (mass, ...) is a rigid body at its origin. The mass of its beams is added to it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.beam import Beam, BeamGeometry, Flexibility, Material, RigidBody, Section
from robot_dynamics.model.beam_sections import SECTION_SHAPES

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument, YamlMapping, YamlPath
    from robot_dynamics.model.formats.mdh_yaml.evaluator import YamlEvaluator
    from robot_dynamics.model.inertia import Inertia

SECTION_PROPERTIES = ("area", "second_moment_y", "second_moment_z", "torsion_constant")

T = TypeVar("T")


class FlexibilityReader:
    """Collects the beams and bodies of links, row by row; `flexibility_of` returns the result."""

    def __init__(self) -> None:
        self._beams: dict[int, list[Beam]] = {}
        self._bodies: dict[int, list[RigidBody]] = {}
        self._geometries: dict[int, BeamGeometry] = {}

    def __bool__(self) -> bool:
        """Return whether any link has beams."""
        return bool(self._beams)

    def add(
        self,
        evaluator: YamlEvaluator,
        link: int,
        row: YamlMapping,
        path: YamlPath,
        frame: ScalarArray,
        inertia: Inertia,
    ) -> None:
        """Add the row at a path.

        Parameters
        ----------
        evaluator : YamlEvaluator
            Evaluator of the row.
        link : int
            Number of the link that carries the row.
        row : dict
            The row.
        path : tuple
            Its path.
        frame : (4, 4) array
            Placement of the frame of the row in that of the link.
        inertia : Inertia
            Inertia in the row, about its frame.
        """
        if np.any(inertia.spatial):
            self._bodies.setdefault(link, []).append(RigidBody(frame[:3, 3], inertia.transformed_by(frame)))
        for number, beam in enumerate(row.get("beams", [])):
            beam_path = (*path, "beams", number)
            if link == 0:
                evaluator.document.fail(beam_path, "the base cannot be flexible: put the beam on a row with a joint")
            placed_beam = _read_beam(evaluator, beam, beam_path).transformed_by(frame)
            geometry = self._geometries.setdefault(link, BeamGeometry())
            _construct(evaluator.document, beam_path, partial(geometry.add, placed_beam))
            self._beams.setdefault(link, []).append(placed_beam)

    def flexibility_of(self, link: int) -> Flexibility | None:
        """Return the Flexibility of a link by its number, None of a rigid one."""
        if link not in self._beams:
            return None
        return Flexibility(tuple(self._beams[link]), tuple(self._bodies.get(link, ())))


def _read_beam(evaluator: YamlEvaluator, mapping: YamlMapping, path: YamlPath) -> Beam:
    """Return the beam in the mapping at a path."""
    section = _resolve(evaluator, mapping, "section", path, _read_section)
    material = _resolve(evaluator, mapping, "material", path, _read_material)
    start = evaluator.vector(mapping, "from", path)
    end = evaluator.vector(mapping, "to", path)
    y = evaluator.vector(mapping, "y", path) if "y" in mapping else None
    options = {key: mapping[key] for key in ("elements", "rotary_inertia") if key in mapping}
    return _construct(evaluator.document, path, lambda: Beam.between(start, end, section, material, y, **options))


def _resolve(
    evaluator: YamlEvaluator,
    mapping: YamlMapping,
    key: str,
    path: YamlPath,
    read: Callable[[YamlEvaluator, YamlMapping, YamlPath], T],
) -> T:
    """Return the section or material to which a beam refers by name."""
    definitions = evaluator.document.data.get(f"{key}s", {})
    name = mapping[key]
    if name not in definitions:
        evaluator.document.fail((*path, key), describe_unknown_name(f"{key} of a beam", name, definitions))
    return read(evaluator, definitions[name], (f"{key}s", name))


def _read_material(evaluator: YamlEvaluator, mapping: YamlMapping, path: YamlPath) -> Material:
    """Return the material in the mapping at a path."""
    if ("shear_modulus" in mapping) == ("poissons_ratio" in mapping):
        evaluator.document.fail(path, "shear_modulus or poissons_ratio is needed, one of the two")
    youngs_modulus = evaluator.number(mapping, "youngs_modulus", path)
    density = evaluator.number(mapping, "density", path)
    if "shear_modulus" in mapping:
        shear_modulus = evaluator.number(mapping, "shear_modulus", path)
        return _construct(evaluator.document, path, lambda: Material(youngs_modulus, shear_modulus, density))
    ratio = evaluator.number(mapping, "poissons_ratio", path)
    return _construct(evaluator.document, path, lambda: Material.isotropic(youngs_modulus, ratio, density))


def _read_section(evaluator: YamlEvaluator, mapping: YamlMapping, path: YamlPath) -> Section:
    """Return the section in the mapping at a path: a shape with dimensions, or its properties."""
    document = evaluator.document
    shapes = [name for name in SECTION_SHAPES if name in mapping]
    if len(shapes) > 1 or (shapes and len(mapping) > 1):
        last = next(reversed(mapping))
        document.fail((*path, last), f"{shapes[0]} defines the section completely: omit the other keys")
    if shapes:
        make_section, dimensions = SECTION_SHAPES[shapes[0]]
        shape_path = (*path, shapes[0])
        sizes = [evaluator.number(mapping[shapes[0]], dimension, shape_path) for dimension in dimensions]
        return _construct(document, shape_path, lambda: make_section(*sizes))
    for key in SECTION_PROPERTIES:
        if key not in mapping:
            alternatives = f"{', '.join(SECTION_PROPERTIES)}, or one of {', '.join(SECTION_SHAPES)}"
            document.fail(path, f"{key} missing: {alternatives}")
    keys = [key for key in (*SECTION_PROPERTIES, "polar_moment") if key in mapping]
    values = {key: evaluator.number(mapping, key, path) for key in keys}
    return _construct(document, path, lambda: Section(**values))


def _construct(document: YamlDocument, path: YamlPath, make: Callable[[], T]) -> T:
    """Return the result of a constructor; its errors get the line and column of a path."""
    try:
        return make()
    except DescriptionError as error:
        document.fail(path, str(error))
