"""Values of the numbers in a YAML description: expressions of its parameters, vectors, placements."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.expression import CONSTANTS, ExpressionBudget, evaluate
from robot_dynamics.model.inertia import INERTIA_ENTRIES, symmetric_matrix
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument, YamlMapping, YamlPath


class YamlEvaluator:
    """Evaluates the numbers of a document. All methods raise DescriptionError with line and column.

    Parameters
    ----------
    document : YamlDocument
        The document.
    values : mapping of str to float or str
        Numbers or expressions in place of entries of its `parameters`.
    budget : ExpressionBudget, optional
        Of other evaluators of the same document.
    """

    def __init__(
        self, document: YamlDocument, values: Mapping[str, float | str], budget: ExpressionBudget | None = None
    ) -> None:
        self.document = document
        self._values = values
        self._budget = budget or ExpressionBudget()
        self._names = self._evaluate_parameters(document.data.get("parameters", {}), values)

    def _evaluate_parameters(self, parameters: YamlMapping, values: Mapping[str, float | str]) -> dict[str, float]:
        """Return the number of each parameter; its expression may contain only the parameters above it."""
        numbers: dict[str, float] = {}
        self._check_parameter_names(values, parameters)
        for name, value in parameters.items():
            if name in CONSTANTS:
                self.document.fail(("parameters", name), f"{name} is a constant: choose another name")
            try:
                numbers[name] = self._evaluate_expression(values.get(name, value), numbers)
            except DescriptionError as error:
                if self._budget.is_spent:
                    self.document.fail(("parameters", name), str(error))
                below = [key for key in parameters if key not in numbers and re.search(rf"\b{key}\b", str(value))]
                hint = f". A parameter may refer only to those above it, not to {', '.join(below)}" if below else ""
                self.document.fail(("parameters", name), f"{error}{hint}")
        return numbers

    def _check_parameter_names(self, values: Mapping[str, float | str], parameters: YamlMapping) -> None:
        """Raise DescriptionError where values have names that are not parameters."""
        for name in values:
            if name not in parameters:
                unknown = describe_unknown_name("parameter", name, parameters)
                self.document.fail(("parameters",), f"value given for {unknown}")

    def with_values(self, values: Mapping[str, float | str], path: YamlPath) -> YamlEvaluator:
        """Return an evaluator with other values of some parameters; the values stand at a path of the document."""
        parameters = self.document.data.get("parameters", {})
        for name in values:
            if name not in parameters:
                unknown = describe_unknown_name("parameter", name, parameters)
                self.document.fail((*path, name), f"value given for {unknown}")
        return YamlEvaluator(self.document, {**self._values, **values}, self._budget) if values else self

    def number(self, mapping: YamlMapping, key: str, path: YamlPath, default: float = 0.0) -> float:
        """Return the number under a key of the mapping at a path."""
        return self._evaluate(mapping[key], (*path, key)) if key in mapping else default

    def vector(self, mapping: YamlMapping, key: str, path: YamlPath) -> Array:
        """Return the three numbers (3,) under a key; zeros where it is absent."""
        return np.array([self._evaluate(value, (*path, key, k)) for k, value in enumerate(mapping.get(key, [0, 0, 0]))])

    def matrix(self, mapping: YamlMapping, key: str, path: YamlPath) -> ScalarArray:
        """Return the symmetric matrix (3, 3) under a key, which has the entries xx to zz."""
        entries = mapping.get(key, {})
        return symmetric_matrix(*(self.number(entries, entry, (*path, key)) for entry in INERTIA_ENTRIES))

    def mdh(self, mapping: YamlMapping, path: YamlPath) -> Array:
        """Return the placement (4, 4) of the six parameters under `mdh`."""
        entries = mapping.get("mdh", {})
        entries_path = (*path, "mdh")
        parameters = MDHParameters(*(self.number(entries, key, entries_path) for key in MDHParameters._fields))
        for key in ("gamma", "alpha", "theta"):
            self._check_angle(getattr(parameters, key), entries.get(key), (*entries_path, key))
        return placement_from_mdh(parameters)

    def pose(self, mapping: YamlMapping, path: YamlPath) -> Array:
        """Return the placement (4, 4) of `xyz` [m] and `rpy` [rad], URDF's convention."""
        angles = self.vector(mapping, "rpy", path)
        for k, angle in enumerate(angles):
            self._check_angle(angle, mapping.get("rpy", angles)[k], (*path, "rpy", k))
        return placement(rotation_from_roll_pitch_yaw(*angles), self.vector(mapping, "xyz", path))

    def read_placement(self, mapping: YamlMapping, path: YamlPath) -> Array:
        """Return the placement (4, 4) of a mapping with `mdh`, or with `xyz` and `rpy`."""
        duplicate = next((key for key in ("xyz", "rpy") if key in mapping and "mdh" in mapping), None)
        if duplicate is not None:
            self.document.fail(
                (*path, duplicate), f"mdh and {duplicate} exclude each other: give mdh, or give xyz and rpy"
            )
        return self.mdh(mapping, path) if "mdh" in mapping else self.pose(mapping, path)

    def _check_angle(self, angle: float, expression: object, path: YamlPath) -> None:
        """Raise DescriptionError for an angle [rad] that looks like degrees; its expression has no pi or radians()."""
        is_in_radians = re.search(r"\b(pi|radians)\b", str(expression)) is not None
        if not is_in_radians and abs(angle) > 2 * math.pi + 1e-9:
            self.document.fail(path, f"{angle:g} rad is more than a turn. Angles are in radians: radians({angle:g})")

    def _evaluate(self, value: object, path: YamlPath) -> float:
        """Return the number of an expression at a path."""
        try:
            return self._evaluate_expression(value, self._names)
        except DescriptionError as error:
            self.document.fail(path, str(error))

    def _evaluate_expression(self, value: object, names: Mapping[str, float]) -> float:
        """Return the number of an expression. Raises DescriptionError without a place."""
        if isinstance(value, str):
            self._budget.spend(value)
        return evaluate(value, names)
