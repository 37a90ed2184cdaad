"""Statements of procedures: their syntax trees, and the names that these assign and read."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

SCOPES = (ast.Lambda, ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp, ast.FunctionDef)
"""Syntax with names of its own."""


class Source(NamedTuple):
    """What a procedure consists of.

    Attributes
    ----------
    statements : list of ast.stmt
        With the numbers of their lines in the file.
    local_names : frozenset of str
        Arguments, and names that the statements assign.
    location : str
        Function and file.
    """

    statements: list[ast.stmt]
    local_names: frozenset[str]
    location: str


@cache
def read_source(function: Callable[..., Any]) -> Source:
    """The source of a function."""
    lines, first_line = inspect.getsourcelines(function)
    definition = ast.parse(textwrap.dedent("".join(lines))).body[0]
    assert isinstance(definition, ast.FunctionDef)
    ast.increment_lineno(definition, first_line - 1)
    path = Path(function.__code__.co_filename)
    local_names = frozenset([*inspect.signature(function).parameters, *assigned_names(definition.body)])
    return Source(definition.body, local_names, f"{function.__qualname__}, {path.name}")


def is_range(node: ast.expr) -> bool:
    """Whether an expression is range(...)."""
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "range"


def assigned_names(statements: Sequence[ast.AST]) -> list[str]:
    """The names that statements assign, each once."""
    return list(dict.fromkeys(name for statement in statements for name in _assigned(statement)))


def _assigned(statement: ast.AST) -> Iterator[str]:
    nodes = deque([statement])
    while nodes:
        node = nodes.popleft()
        if isinstance(node, ast.FunctionDef):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        if not isinstance(node, SCOPES):
            nodes.extend(ast.iter_child_nodes(node))


def read_names(node: ast.AST) -> set[str]:
    """The names whose values an expression, or a function inside a procedure, takes from around it."""
    read: set[str] = set()
    own: set[str] = set()
    for part in ast.walk(node):
        if isinstance(part, ast.Name):
            (read if isinstance(part.ctx, ast.Load) else own).add(part.id)
        elif isinstance(part, ast.arg):
            own.add(part.arg)
    return read - own


def contains(node: ast.AST, *kinds: type[ast.AST]) -> bool:
    """Whether an expression has a part of some kinds."""
    return any(isinstance(part, kinds) for part in ast.walk(node))
