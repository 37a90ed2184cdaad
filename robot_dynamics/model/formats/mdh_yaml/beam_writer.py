"""Flexible links as YAML text of an MDH table, which `beams` reads back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.model.beam import COINCIDENCE_TOLERANCE
from robot_dynamics.model.formats.expression import format_number
from robot_dynamics.model.inertia import Inertia

if TYPE_CHECKING:
    from robot_dynamics.model.beam import Beam, Material, RigidBody, Section
    from robot_dynamics.model.robot import Link, Robot


class BeamWriter:
    """Writes the beams of a robot. Sections and materials, which have no names in the model, are numbered."""

    def __init__(self, robot: Robot) -> None:
        self._sections: dict[Section, str] = {}
        self._materials: dict[Material, str] = {}
        for link in robot.links:
            for beam in _beams(link):
                self._sections.setdefault(beam.section, f"section_{len(self._sections) + 1}")
                self._materials.setdefault(beam.material, f"material_{len(self._materials) + 1}")

    def definitions(self) -> list[str]:
        """Return the lines of `sections` and `materials`, none for a rigid robot."""
        lines = []
        if self._sections:
            lines.append("\nsections:")
            lines += [f"  {name}: {_mapping(asdict(section))}" for section, name in self._sections.items()]
        if self._materials:
            lines.append("\nmaterials:")
            lines += [f"  {name}: {_mapping(asdict(material))}" for material, name in self._materials.items()]
        return lines

    def entries(self, link: Link) -> list[str]:
        """Return the beams of a link as entries of its row."""
        return ["beams:", *(f"  - {self._beam(beam)}" for beam in _beams(link))] if _beams(link) else []

    def _beam(self, beam: Beam) -> str:
        """Return a beam as a mapping."""
        entries = {
            "from": _vector(beam.placement[:3, 3]),
            "to": _vector(beam.end),
            "y": _vector(beam.placement[:3, 1]),
            "section": self._sections[beam.section],
            "material": self._materials[beam.material],
            "elements": str(beam.elements),
            "rotary_inertia": str(beam.rotary_inertia).lower(),
        }
        return "{" + ", ".join(f"{key}: {text}" for key, text in entries.items()) + "}"


def row_inertia(link: Link) -> Inertia:
    """Return the inertia in the row of a link: the whole one of a rigid link, else that of the bodies at its origin."""
    if link.flexibility is None:
        return link.inertia
    return sum((body.inertia for body in link.flexibility.bodies if not _is_off_origin(body)), Inertia())


def bodies_with_own_row(link: Link) -> list[RigidBody]:
    """Return the bodies of a link that need rows of their own."""
    return [body for body in link.flexibility.bodies if _is_off_origin(body)] if link.flexibility is not None else []


def _is_off_origin(body: RigidBody) -> bool:
    """Return whether a body is fixed to another point than the origin of the link's frame."""
    return bool(np.any(np.abs(body.point) > COINCIDENCE_TOLERANCE))


def _beams(link: Link) -> tuple[Beam, ...]:
    """Return the beams of a link."""
    return link.flexibility.beams if link.flexibility is not None else ()


def _mapping(numbers: Mapping[str, Any]) -> str:
    """Return numbers as a mapping."""
    return "{" + ", ".join(f"{key}: {format_number(value)}" for key, value in numbers.items()) + "}"


def _vector(values: Iterable[float]) -> str:
    """Return numbers as a list."""
    return f"[{', '.join(format_number(float(value)) for value in values)}]"
