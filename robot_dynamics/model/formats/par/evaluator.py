"""What the entries of a SYMORO+ .par come to: expressions of names, of which some are joint variables."""

import math
import re

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.expression import CONSTANTS, MAX_EXPRESSION_LENGTH, evaluate

PI = {**CONSTANTS, "Pi": math.pi}
MAX_EVALUATED_LENGTH = 500_000  # characters of expressions, those of a joint variable six times; takes some seconds
PROBES = (0.3, 1.0, -1.7, 13.1, -41.9)  # values of a joint variable

_TOKEN = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[A-Za-z_]\w*\s*\(|([A-Za-z_]\w*)", re.ASCII)
_PLAIN_NUMBER = re.compile(r"-?(\d{1,30}\.?\d{0,30}|\.\d{1,30})([eE][-+]?\d{1,2})?", re.ASCII)


class ParEvaluator:
    """What the entries of a document come to, and which names have no value though one is needed."""

    def __init__(self, document, values):
        self.document, self.missing = document, {}  # names without value, and the line that needs them first
        self.cache, self.budget = {}, MAX_EVALUATED_LENGTH
        self.values = self._values(values)

    def _values(self, told):
        if not hasattr(told, "items"):
            raise DescriptionError(f"values are {told!r:.60}: {{name: number, ...}} is needed")
        names, values = {}, {}
        for entries in self.document.lists.values() if told else ():
            for entry in entries:
                names.update(dict.fromkeys(self._names(entry)))
        for name, value in told.items():
            if name not in names:
                self.document.fail(None, f"value given for {describe_unknown_name('name', name, list(names)[:5000])}")
            try:
                values[name] = evaluate(value, PI)
            except DescriptionError as error:
                self.document.fail(None, f"value given for {name!r}: {error}")
        return values

    def _names(self, entry):
        """The names in an entry, by its tokens alone: whether it has a meaning is seen when it is evaluated."""
        if len(entry.text) > MAX_EXPRESSION_LENGTH:
            self.document.fail(
                entry.line, f"an entry has {len(entry.text)} characters: {MAX_EXPRESSION_LENGTH} at most are read"
            )
        return dict.fromkeys(name for name in _TOKEN.findall(entry.text) if name and name not in PI)

    def unbound(self, entry):
        """The names in an entry that have no value."""
        return [name for name in self._names(entry) if name not in self.values]

    def entry(self, key, number):
        """An Entry of a list by its number, from 0; None where the list is not there."""
        return self.document.lists[key][number] if key in self.document.lists else None

    def number(self, entry):
        """The number that an entry comes to; zero where it is not there, or is noted as missing."""
        if entry is None:
            return 0.0
        unbound = self.unbound(entry)
        for name in unbound:
            self.missing.setdefault(name, entry.line)
        return 0.0 if unbound else self.evaluate_entry(entry)

    def evaluate_entry(self, entry, variable=None, value=0.0):
        """The number that an entry comes to where `variable`, a name that it leaves open, has the value."""
        if _PLAIN_NUMBER.fullmatch(entry.text):
            return float(entry.text)
        if entry.text in self.values:
            return self.values[entry.text]
        key = (entry.text, value)
        if key not in self.cache:
            self.budget -= len(entry.text)
            if self.budget < 0:
                self.document.fail(entry.line, "the expressions up to here are too many: write numbers instead")
            bound = {name: self.values[name] for name in self._names(entry) if name != variable}
            names = PI | bound if variable is None else PI | bound | {variable: value}
            try:
                self.cache[key] = evaluate(entry.text, names)
            except DescriptionError as error:
                self.document.fail(entry.line, str(error))
        return self.cache[key]

    def choice(self, entry, what, choices, needed):
        """A whole number, one of the `choices`."""
        number = None if self.unbound(entry) else self.evaluate_entry(entry)
        if number not in choices:
            self.document.fail(entry.line, f"{what} is {entry.text[:40]!r}: {needed} is needed")
        return int(number)

    def split_joint_variable(self, entry, what):
        """(joint variable, constant) of an entry `variable + constant`; variable None where every name has a value."""
        unbound = self.unbound(entry)
        if not unbound:
            return None, self.evaluate_entry(entry)
        if len(unbound) > 1:
            self.document.fail(
                entry.line,
                f"{what} is {entry.text[:60]!r} and may have one joint variable, but {', '.join(unbound[:40])} "
                "have no value: give values for all of them but the variable",
            )
        name, constant = unbound[0], self.evaluate_entry(entry, unbound[0], 0.0)
        scale = max(1.0, abs(constant))  # so that a large constant does not hide the variable
        for step in (scale * probe for probe in PROBES):
            if not abs(self._grown(entry, name, step, constant) - step) <= 1e-9 * abs(step):
                self.document.fail(
                    entry.line,
                    f"{what} is {entry.text[:60]!r} and does not grow as {name} does: {name} plus or minus a constant "
                    f"is needed, or a value for {name} where it is no joint variable",
                )
        return name, constant

    def _grown(self, entry, name, step, constant):
        """By how much an entry is more than `constant` at name = step; nan where it has no value there."""
        try:
            return self.evaluate_entry(entry, name, step) - constant
        except DescriptionError:
            if self.budget < 0:
                raise
            return math.nan
