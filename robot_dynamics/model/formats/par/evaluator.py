"""Values of the entries of a SYMORO+ .par: expressions of names, some of which are joint variables."""

from __future__ import annotations

import math
import re
from collections.abc import Container, Mapping
from typing import TYPE_CHECKING

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.expression import CONSTANTS, MAX_EXPRESSION_LENGTH, ExpressionBudget, evaluate

if TYPE_CHECKING:
    from robot_dynamics.model.formats.par.document import Entry, ParDocument

PI = {**CONSTANTS, "Pi": math.pi}
PROBES = (0.3, 1.0, -1.7, 13.1, -41.9)  # values of a joint variable

_TOKEN = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[A-Za-z_]\w*\s*\(|([A-Za-z_]\w*)", re.ASCII)
_PLAIN_NUMBER = re.compile(r"-?(\d{1,30}\.?\d{0,30}|\.\d{1,30})([eE][-+]?\d{1,2})?", re.ASCII)


class ParEvaluator:
    """Evaluates the entries of a document.

    Parameters
    ----------
    document : ParDocument
        The document.
    values : mapping of str to float or str
        Numbers or expressions of pi for names in the document.

    Attributes
    ----------
    missing : dict of str to (int or None)
        Names without value where a value is needed, and the line that needs them first.
    """

    def __init__(self, document: ParDocument, values: Mapping[str, float | str]) -> None:
        self._document = document
        self.missing: dict[str, int | None] = {}
        self._cache: dict[tuple[str, float], float] = {}
        self._budget = ExpressionBudget()
        self._values = self._evaluate_values(values)

    def _evaluate_values(self, values: Mapping[str, float | str]) -> dict[str, float]:
        """Return the numbers of the values, whose names must occur in the document."""
        if not hasattr(values, "items"):
            raise DescriptionError(f"values are {values!r:.60}: {{name: number, ...}} is needed")
        names: dict[str, None] = {}
        for entries in self._document.lists.values() if values else ():
            for entry in entries:
                names.update(dict.fromkeys(self._names(entry)))
        numbers = {}
        for name, value in values.items():
            if name not in names:
                unknown = describe_unknown_name("name", name, list(names)[:5000])
                self._document.fail(None, f"value given for {unknown}")
            try:
                numbers[name] = evaluate(value, PI)
            except DescriptionError as error:
                self._document.fail(None, f"value given for {name!r}: {error}")
        return numbers

    def _names(self, entry: Entry) -> dict[str, None]:
        """Return the names in an entry, in order, from its tokens alone; evaluation shows whether it is valid."""
        if len(entry.text) > MAX_EXPRESSION_LENGTH:
            self._document.fail(
                entry.line, f"an entry has {len(entry.text)} characters: the maximum is {MAX_EXPRESSION_LENGTH}"
            )
        return dict.fromkeys(name for name in _TOKEN.findall(entry.text) if name and name not in PI)

    def unbound_names(self, entry: Entry) -> list[str]:
        """Return the names in an entry that have no value."""
        return [name for name in self._names(entry) if name not in self._values]

    def entry(self, key: str, number: int) -> Entry | None:
        """Return an entry of a list by its number, from 0; None where the list does not exist."""
        return self._document.lists[key][number] if key in self._document.lists else None

    def number(self, entry: Entry | None) -> float:
        """Return the value of an entry; zero where it does not exist, or has names without value, which are noted."""
        if entry is None:
            return 0.0
        unbound = self.unbound_names(entry)
        for name in unbound:
            self.missing.setdefault(name, entry.line)
        return 0.0 if unbound else self.evaluate_entry(entry)

    def evaluate_entry(self, entry: Entry, variable: str | None = None, value: float = 0.0) -> float:
        """Return the value of an entry; variable: a name in it without value, which takes the value here."""
        if _PLAIN_NUMBER.fullmatch(entry.text):
            return float(entry.text)
        if entry.text in self._values:
            return self._values[entry.text]
        key = (entry.text, value)
        if key not in self._cache:
            bound = {name: self._values[name] for name in self._names(entry) if name != variable}
            names = PI | bound
            if variable is not None:
                names[variable] = value
            try:
                self._budget.spend(entry.text)
                self._cache[key] = evaluate(entry.text, names)
            except DescriptionError as error:
                self._document.fail(entry.line, str(error))
        return self._cache[key]

    def choice(self, entry: Entry, quantity: str, choices: Container[int], requirement: str) -> int:
        """Return a whole number, one of the choices; quantity and requirement: for the error message."""
        number = None if self.unbound_names(entry) else self.evaluate_entry(entry)
        if number is None or number not in choices:
            self._document.fail(entry.line, f"{quantity} is {entry.text[:40]!r}: {requirement} is needed")
        return int(number)

    def split_joint_variable(self, entry: Entry, quantity: str) -> tuple[str | None, float]:
        """Return (variable, constant) of an entry `variable + constant`; (None, value) if all its names have values."""
        unbound = self.unbound_names(entry)
        if not unbound:
            return None, self.evaluate_entry(entry)
        if len(unbound) > 1:
            self._document.fail(
                entry.line,
                f"{quantity} is {entry.text[:60]!r} and may have one joint variable, but {', '.join(unbound[:40])} "
                "have no value: give values for all of them but the variable",
            )
        name = unbound[0]
        constant = self.evaluate_entry(entry, name, 0.0)
        scale = max(1.0, abs(constant))  # so that a large constant does not hide the variable
        for step in (scale * probe for probe in PROBES):
            if not abs(self._increase(entry, name, step, constant) - step) <= 1e-9 * abs(step):
                self._document.fail(
                    entry.line,
                    f"{quantity} is {entry.text[:60]!r} and does not increase by as much as {name}: {name} plus or "
                    f"minus a constant is needed, or a value for {name} where it is no joint variable",
                )
        return name, constant

    def _increase(self, entry: Entry, name: str, step: float, constant: float) -> float:
        """Return the increase of an entry over `constant` at name = step; NaN where it has no value there."""
        try:
            return self.evaluate_entry(entry, name, step) - constant
        except DescriptionError:
            if self._budget.is_spent:
                raise
            return math.nan
