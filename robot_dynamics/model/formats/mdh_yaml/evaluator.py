"""What the numbers in a YAML description come to: expressions of its parameters, vectors, placements."""

import math
import re

import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.expression import CONSTANTS, evaluate
from robot_dynamics.model.inertia import INERTIA_ENTRIES, symmetric_matrix
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw


class YamlEvaluator:
    """The numbers of a YamlDocument. All raise DescriptionError, which tells line and column.

    values: {name: number or expression} in the place of entries of its `parameters`.
    """

    def __init__(self, document, values):
        self.document, self.values = document, values
        self.names = self._parameters(document.data.get("parameters", {}), values)

    def _parameters(self, told, values):
        names = {}
        for name in values:
            if name not in told:
                self.document.fail(("parameters",), f"value given for {describe_unknown_name('parameter', name, told)}")
        for name, value in told.items():
            if name in CONSTANTS:
                self.document.fail(("parameters", name), f"{name} is known already: take another name")
            try:
                names[name] = evaluate(values.get(name, value), names)
            except DescriptionError as error:
                later = ", ".join(
                    other for other in told if other not in names and re.search(rf"\b{other}\b", str(value))
                )
                hint = f". A parameter may refer to those above it only, not to {later}" if later else ""
                self.document.fail(("parameters", name), f"{error}{hint}")
        return names

    def with_values(self, values, path):
        """The same with other values, {name: number or expression}, which stand at a path, for some parameters."""
        told = self.document.data.get("parameters", {})
        for name in values:
            if name not in told:
                self.document.fail((*path, name), f"value given for {describe_unknown_name('parameter', name, told)}")
        return YamlEvaluator(self.document, {**self.values, **values}) if values else self

    def number(self, mapping, key, path, default=0.0):
        """The number under a key of the mapping that stands at a path."""
        return self._evaluate(mapping[key], (*path, key)) if key in mapping else default

    def vector(self, mapping, key, path):
        """The three numbers (3,) under a key; zeros where it is left out."""
        return np.array([self._evaluate(value, (*path, key, k)) for k, value in enumerate(mapping.get(key, [0, 0, 0]))])

    def matrix(self, mapping, key, path):
        """The symmetric matrix (3, 3) under a key, told by its entries xx ... zz."""
        told, path = mapping.get(key, {}), (*path, key)
        return symmetric_matrix(*(self.number(told, entry, path) for entry in INERTIA_ENTRIES))

    def mdh(self, mapping, path):
        """The placement (4, 4) that the six parameters under `mdh` stand for."""
        told, path = mapping.get("mdh", {}), (*path, "mdh")
        numbers = MDHParameters(*(self.number(told, key, path) for key in MDHParameters._fields))
        for key in ("gamma", "alpha", "theta"):
            self._check_angle(getattr(numbers, key), told.get(key), (*path, key))
        return placement_from_mdh(numbers)

    def pose(self, mapping, path):
        """The placement (4, 4) that `xyz` [m] and `rpy` [rad] stand for, as URDF means them."""
        angles = self.vector(mapping, "rpy", path)
        for k, angle in enumerate(angles):
            self._check_angle(angle, mapping.get("rpy", angles)[k], (*path, "rpy", k))
        return placement(rotation_from_roll_pitch_yaw(*angles), self.vector(mapping, "xyz", path))

    def read_placement(self, mapping, path):
        """The placement (4, 4) that a mapping tells, by `mdh` or by `xyz` and `rpy`."""
        twice = next((key for key in ("xyz", "rpy") if key in mapping and "mdh" in mapping), None)
        if twice is not None:
            self.document.fail((*path, twice), f"mdh and {twice} say the same twice: mdh is right, or xyz and rpy")
        return self.mdh(mapping, path) if "mdh" in mapping else self.pose(mapping, path)

    def _check_angle(self, angle, told, path):
        """Refuse an angle [rad] that looks like degrees; one that is told by pi, or made radians of, is none."""
        in_radians = re.search(r"\b(pi|radians)\b", str(told)) is not None
        if not in_radians and abs(angle) > 2 * math.pi + 1e-9:
            self.document.fail(path, f"{angle:g} rad is more than a turn. Angles are in radians: radians({angle:g})")

    def _evaluate(self, value, path):
        try:
            return evaluate(value, self.names)
        except DescriptionError as error:
            self.document.fail(path, str(error))
