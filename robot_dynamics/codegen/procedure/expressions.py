"""Expressions of procedures while they are staged: Python evaluates them, with symbols for what is not known yet."""

from __future__ import annotations

import ast
import builtins
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import reduce
from typing import TYPE_CHECKING, Any

from robot_dynamics.codegen.procedure.procedure_errors import LanesError, ProcedureError
from robot_dynamics.codegen.procedure.statements import contains, read_names, read_source
from robot_dynamics.codegen.procedure.symbols import Condition
from robot_dynamics.procedures import is_finite, largest, magnitude, rounded, select

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.function_text import FunctionText

PURE_FUNCTIONS = (largest, magnitude, rounded, select, is_finite)
"""Functions that assign nothing."""

SIDE = "__side__"
"""Name of the right side of `and` and `or`, while it is computed in a branch."""


class Expressions(ABC):
    """The names of a procedure, their values, and expressions of them."""

    def __init__(self, text: FunctionText, function: Callable[..., Any], values: dict[str, Any]) -> None:
        self._text = text
        self._function = function
        self._source = read_source(function)
        closure = inspect.getclosurevars(function)
        self._globals = {**function.__globals__, **closure.nonlocals, "__builtins__": builtins}
        self._values = values

    @abstractmethod
    def _branch(self, statement: ast.If, condition: Condition) -> None:
        """One of the branches of `if`, as a condition says when the code runs."""

    @contextmanager
    def _located(self, statement: ast.stmt) -> Iterator[None]:
        """Name the function and the line of a statement in errors."""
        before = self._text.location
        location = self._text.location = f"{self._source.location}:{statement.lineno}"
        try:
            yield
        except (ProcedureError, LanesError):
            raise
        except TypeError as error:
            raise ProcedureError(str(error), location) from error
        finally:
            self._text.location = before

    def _evaluate(self, node: ast.expr) -> Any:
        if isinstance(node, ast.BoolOp):
            is_all = isinstance(node.op, ast.And)
            return reduce(
                lambda left, right: self._combine(is_all, left, right), node.values[1:], self._evaluate(node.values[0])
            )
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            value = self._evaluate(node.operand)
            return ~value if isinstance(value, Condition) else not value
        self._require_values(node)
        if contains(node, ast.NamedExpr):
            raise TypeError("a procedure cannot contain `:=`: assign in a statement")
        code = compile(ast.fix_missing_locations(ast.Expression(node)), self._function.__code__.co_filename, "eval")
        return eval(code, {**self._globals, **self._values})

    def _combine(self, is_all: bool, left: Any, node: ast.expr) -> Any:
        """`left and node`, or `left or node`."""
        if not isinstance(left, Condition):
            return self._evaluate(node) if bool(left) == is_all else left
        if not self._may_assign(node):
            right = self._evaluate(node)
            return left & right if is_all else left | right
        # as a branch: what the call assigns to arrays is assigned only where Python makes the call
        self._values[SIDE] = left
        assignment = ast.copy_location(ast.Assign([ast.Name(SIDE, ast.Store())], node), node)
        self._branch(ast.If(test=node, body=[assignment], orelse=[]), left if is_all else ~left)
        return self._values.pop(SIDE)

    def _may_assign(self, node: ast.expr) -> bool:
        """Whether an expression has calls that may assign to entries of arrays."""
        calls = [part for part in ast.walk(node) if isinstance(part, ast.Call)]
        names = self._globals | self._values
        functions = [names.get(call.func.id) if isinstance(call.func, ast.Name) else None for call in calls]
        return not all(function in PURE_FUNCTIONS for function in functions)

    def _require_values(self, node: ast.AST) -> None:
        """Raise TypeError where a name of the procedure has no value, or has one only for some inputs."""
        for name in sorted((read_names(node) & self._source.local_names) - self._values.keys()):
            raise TypeError(
                f"{name!r} has no value here: assign it before a loop, and before a branch or in both of its parts"
            )
