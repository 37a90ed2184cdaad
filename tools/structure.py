"""Measure the structure of the package: words, annotations, public names, imports, file names.

Run ``python tools/structure.py`` to print the table of ``docs/explanation/structure.md`` for this checkout, or
``python tools/structure.py FOLDER`` for another one.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PACKAGE = "robot_dynamics"
VAGUE_WORDS = frozenset("told found asked everyone answer answers question questions".split())
"""Words that name no quantity of the field; identifiers are counted that contain one of them."""

SHARED_FILE_NAMES = frozenset(
    f"{name}.py"
    for name in "__init__ __main__ node parameters inputs outputs health reader writer document evaluator".split()
)
"""Names that several folders may use, because the folder says of what."""


class Package:
    """The modules of a checkout as syntax trees."""

    def __init__(self, root: Path) -> None:
        self.trees = {
            self._module_name(path.relative_to(root)): ast.parse(path.read_text(encoding="utf-8"))
            for path in sorted((root / PACKAGE).rglob("*.py"))
        }
        self.file_names = Counter(path.name for path in (root / PACKAGE).rglob("*.py"))

    @staticmethod
    def _module_name(path: Path) -> str:
        return ".".join(path.with_suffix("").parts).removesuffix(".__init__")

    def bound_identifiers(self) -> Iterator[str]:
        """Names that are bound: variables, parameters, attributes, functions, and classes."""
        for tree in self.trees.values():
            for node in ast.walk(tree):
                if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
                    yield node.id if isinstance(node, ast.Name) else node.attr
                elif isinstance(node, ast.arg):
                    yield node.arg
                elif isinstance(node, ast.FunctionDef | ast.ClassDef):
                    yield node.name

    def vague_identifiers(self) -> list[str]:
        """Bound identifiers with one of VAGUE_WORDS in them."""
        return [name for name in self.bound_identifiers() if VAGUE_WORDS & set(name.lower().split("_"))]

    def functions(self) -> Iterator[tuple[str, ast.FunctionDef]]:
        """(module, definition) of every public function and method, and of special methods such as ``__init__``."""
        for module, tree in self.trees.items():
            for node in ast.walk(tree):
                if isinstance(node, ast.FunctionDef) and re.match(r"[^_]|__\w+__$", node.name):
                    yield module, node

    def unannotated_functions(self) -> list[str]:
        """``module.function`` of the public functions of which an argument or the result has no type."""
        return [f"{module}.{node.name}" for module, node in self.functions() if not _is_annotated(node)]

    def imports(self, module: str) -> set[str]:
        """Modules of the package that a module imports when it is imported; imports for types alone are left out."""
        targets = set()
        for statement in _executed_statements(self.trees[module].body):
            if isinstance(statement, ast.ImportFrom) and (statement.module or "").startswith(PACKAGE):
                for alias in statement.names:
                    submodule = f"{statement.module}.{alias.name}"
                    targets.add(submodule if submodule in self.trees else statement.module)
            elif isinstance(statement, ast.Import):
                targets.update(alias.name for alias in statement.names)
        return {target for target in targets if target in self.trees and target != module}

    def longest_import_chain(self) -> tuple[str, ...]:
        """The longest chain of modules of which each imports the next one."""
        imports = {module: self.imports(module) for module in self.trees}

        @cache
        def chain(module: str) -> tuple[str, ...]:
            return max(((module, *chain(target)) for target in sorted(imports[module])), key=len, default=(module,))

        return max((chain(module) for module in imports if not module.endswith("__main__")), key=len)

    def public_names(self) -> list[str]:
        """``__all__`` of the package."""
        for statement in self.trees[PACKAGE].body:
            if isinstance(statement, ast.Assign | ast.AnnAssign):
                target = statement.target if isinstance(statement, ast.AnnAssign) else statement.targets[0]
                if isinstance(target, ast.Name) and target.id == "__all__" and statement.value is not None:
                    names: list[str] = ast.literal_eval(statement.value)
                    return names
        raise ValueError(f"{PACKAGE}/__init__.py has no literal __all__")

    def repeated_file_names(self) -> dict[str, int]:
        """{file name: count} of the names that more than one folder uses, SHARED_FILE_NAMES left out."""
        return {name: count for name, count in self.file_names.items() if count > 1 and name not in SHARED_FILE_NAMES}


def _is_annotated(function: ast.FunctionDef) -> bool:
    arguments = function.args
    named = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, arguments.vararg, arguments.kwarg]
    needed = [argument for argument in named if argument is not None and argument.arg not in ("self", "cls")]
    return function.returns is not None and all(argument.annotation is not None for argument in needed)


def _executed_statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements that run when a module is imported, those in ``try`` and ``if`` blocks too."""
    for statement in body:
        if isinstance(statement, ast.If):
            if "TYPE_CHECKING" not in ast.unparse(statement.test):
                yield from _executed_statements(statement.body)
            yield from _executed_statements(statement.orelse)
        elif isinstance(statement, ast.Try):
            yield from _executed_statements(statement.body)
            for handler in statement.handlers:
                yield from _executed_statements(handler.body)
        else:
            yield statement


def table(package: Package) -> str:
    """The figures as rows of a Markdown table."""
    functions = list(package.functions())
    annotated = len(functions) - len(package.unannotated_functions())
    chain = package.longest_import_chain()
    rows = [
        (
            "identifiers with a vague word (told, found, asked, everyone, answer, question)",
            len(package.vague_identifiers()),
        ),
        (
            "public functions and methods with types",
            "all" if annotated == len(functions) else f"{annotated} of {len(functions)}",
        ),
        ("public names", len(package.public_names())),
        ("longest chain of imports (modules)", len(chain)),
        ("file names that several folders use", len(package.repeated_file_names())),
    ]
    return "\n".join(f"| {name} | {value} |" for name, value in rows)


if __name__ == "__main__":
    measured = Package(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1])
    print(table(measured))
    print(" -> ".join(measured.longest_import_chain()))
