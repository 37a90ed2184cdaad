"""Links that bend to the YAML text of an MDH table, which `yaml_beams` reads back."""

from dataclasses import asdict

import numpy as np

from robot_dynamics.model.beam import COINCIDENCE_TOLERANCE
from robot_dynamics.model.formats.expression import format_number
from robot_dynamics.model.inertia import Inertia


class BeamWriter:
    """Texts for the beams of a Robot. Sections and materials have no names in it, and are numbered."""

    def __init__(self, robot):
        self._named = {"section": {}, "material": {}}
        for link in robot.links:
            for beam in _beams(link):
                for kind, known in self._named.items():
                    known.setdefault(getattr(beam, kind), f"{kind}_{len(known) + 1}")

    def definitions(self):
        """Lines of `materials` and `sections`, none where nothing bends."""
        lines = []
        for kind, known in self._named.items():
            lines += [f"\n{kind}s:"] if known else []
            lines += [f"  {name}: {_mapping(asdict(thing))}" for thing, name in known.items()]
        return lines

    def entries(self, link):
        """Entries of the row of a Link: its beams."""
        return ["beams:", *(f"  - {self._beam(beam)}" for beam in _beams(link))] if _beams(link) else []

    def _beam(self, beam):
        told = {"from": _vector(beam.placement[:3, 3]), "to": _vector(beam.end), "y": _vector(beam.placement[:3, 1])}
        told |= {kind: known[getattr(beam, kind)] for kind, known in self._named.items()}
        told |= {"elements": str(beam.elements), "rotary_inertia": str(beam.rotary_inertia).lower()}
        return "{" + ", ".join(f"{key}: {text}" for key, text in told.items()) + "}"


def row_inertia(link):
    """The Inertia that the row of a Link tells: all of a rigid one, of one that bends the bodies at its origin."""
    if link.flexibility is None:
        return link.inertia
    return sum((body.inertia for body in link.flexibility.bodies if not _elsewhere(body)), Inertia())


def bodies_with_own_row(link):
    """The Bodies of a Link that take rows of their own."""
    return [body for body in link.flexibility.bodies if _elsewhere(body)] if link.flexibility is not None else []


def _elsewhere(body):
    return bool(np.any(np.abs(body.point) > COINCIDENCE_TOLERANCE))


def _beams(link):
    return link.flexibility.beams if link.flexibility is not None else ()


def _mapping(numbers):
    return "{" + ", ".join(f"{key}: {format_number(value)}" for key, value in numbers.items()) + "}"


def _vector(values):
    return f"[{', '.join(format_number(float(value)) for value in values)}]"
