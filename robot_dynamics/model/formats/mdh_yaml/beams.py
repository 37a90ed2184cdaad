"""What bends, in a YAML description: beams of rows, and the sections and materials that they name.

    materials: {steel: {youngs_modulus: 210e9, poissons_ratio: 0.3, density: 7850}}
    sections: {bar: {rectangle: {y: 0.01, z: 0.024}}}
    joints:
      - {joint: shoulder, link: arm, beams: [{to: [0.5, 0, 0], section: bar, material: steel, elements: 2}]}

The mass of beams comes to what the row tells besides. What a row tells (mass, ...) is a rigid body at its origin.
"""

import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.beam import Beam, Flexibility, Material, RigidBody, Section
from robot_dynamics.model.beam_sections import SECTION_SHAPES

SECTION_PROPERTIES = ("area", "second_moment_y", "second_moment_z", "torsion_constant")


class FlexibilityReader:
    """Gathers the beams and the bodies of links, row by row; `of` gives the Flexibility of a link."""

    def __init__(self):
        self._beams, self._bodies = {}, {}

    def __bool__(self):
        return bool(self._beams)

    def add(self, numbers, link, row, path, frame, inertia):
        """The row at a path, whose frame `frame` (4, 4) places in that of link `link`; inertia: what it tells.

        numbers: YamlNumbers that know what its expressions come to. Raises DescriptionError.
        """
        if np.any(inertia.spatial):
            self._bodies.setdefault(link, []).append(RigidBody(frame[:3, 3], inertia.transformed_by(frame)))
        for number, told in enumerate(row.get("beams", [])):
            here = (*path, "beams", number)
            if link == 0:
                numbers.document.fail(here, "the base does not bend: hang a row with a joint on it")
            self._beams.setdefault(link, []).append(_beam(numbers, told, here).transformed_by(frame))
            self._check(numbers.document, link, here)

    def _check(self, document, link, path):
        try:
            Flexibility(tuple(self._beams[link]))
        except DescriptionError as error:
            document.fail(path, str(error))

    def flexibility_of(self, link):
        """The Flexibility of a link by its number, None of a rigid one."""
        if link not in self._beams:
            return None
        return Flexibility(tuple(self._beams[link]), tuple(self._bodies.get(link, ())))


def _beam(numbers, told, path):
    section = _named(numbers, told, "section", path, _section)
    material = _named(numbers, told, "material", path, _material)
    ends = (numbers.vector(told, key, path) for key in ("from", "to"))
    options = {key: told[key] for key in ("elements", "rotary_inertia") if key in told}
    y = numbers.vector(told, "y", path) if "y" in told else None
    return _made(numbers, path, lambda: Beam.between(*ends, section, material, y, **options))


def _named(numbers, told, key, path, read):
    """What the document tells under a name that the beam gives."""
    kinds, name = numbers.document.data.get(f"{key}s", {}), told[key]
    if name not in kinds:
        numbers.document.fail((*path, key), describe_unknown_name(f"{key} of a beam", name, kinds))
    return read(numbers, kinds[name], (f"{key}s", name))


def _material(numbers, told, path):
    if ("shear_modulus" in told) == ("poissons_ratio" in told):
        numbers.document.fail(path, "shear_modulus or poissons_ratio is needed, one of the two")
    stiffness, density = (numbers.number(told, key, path) for key in ("youngs_modulus", "density"))
    if "shear_modulus" in told:
        shear = numbers.number(told, "shear_modulus", path)
        return _made(numbers, path, lambda: Material(stiffness, shear, density))
    ratio = numbers.number(told, "poissons_ratio", path)
    return _made(numbers, path, lambda: Material.isotropic(stiffness, ratio, density))


def _section(numbers, told, path):
    outlines = [name for name in SECTION_SHAPES if name in told]
    if len(outlines) > 1 or (outlines and len(told) > 1):
        twice = next(key for key in reversed(told))
        numbers.document.fail((*path, twice), f"{outlines[0]} says all of the section: leave out the rest")
    if outlines:
        outline, sizes = SECTION_SHAPES[outlines[0]]
        here = (*path, outlines[0])
        values = [numbers.number(told[outlines[0]], size, here) for size in sizes]
        return _made(numbers, here, lambda: outline(*values))
    for key in SECTION_PROPERTIES:
        if key not in told:
            numbers.document.fail(
                path, f"{key} missing: {', '.join(SECTION_PROPERTIES)}, or one of {', '.join(SECTION_SHAPES)}"
            )
    values = {key: numbers.number(told, key, path) for key in (*SECTION_PROPERTIES, "polar_moment") if key in told}
    return _made(numbers, path, lambda: Section(**values))


def _made(numbers, path, make):
    try:
        return make()
    except DescriptionError as error:
        numbers.document.fail(path, str(error))
