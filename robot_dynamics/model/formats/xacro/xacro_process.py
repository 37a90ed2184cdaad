"""What runs in the process of an expansion: the package xacro, with packages found as those of meshes are."""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.package_folders import (
    PACKAGE_FILE,
    PACKAGE_NAME,
    enclosing_package,
    package_folders,
    source_package,
)
from robot_dynamics.optional_packages import import_optional

UNDEFINED = "Undefined substitution argument"  # in messages of xacro


class _Arguments(dict[str, str]):
    """Arguments of a xacro, which note the names that it asks for."""

    def __init__(self, values: dict[str, str]) -> None:
        super().__init__(values)
        self.requested: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.requested.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.requested.add(name)
        return super().__getitem__(name)


def run(request: dict[str, Any]) -> str:
    """Return the expanded text of request["file"] with request["values"]; at most request["longest"] characters."""
    xacro = import_optional("xacro", "expanding a xacro file")
    path = Path(request["file"])
    _provide_package_search(path.parent)
    arguments = _Arguments(request["values"])
    try:
        document = xacro.process_file(str(path), mappings=arguments)
    except (MemoryError, RecursionError):
        raise
    except Exception as error:  # of any type: expressions raise those of Python
        if isinstance(getattr(error, "exc", None), (MemoryError, RecursionError)):
            raise error.exc from None  # type: ignore[attr-defined]
        raise DescriptionError(f"xacro cannot expand it: {_reason(error)}{_location(xacro)}") from error
    for name in request["values"]:
        if name not in arguments.requested:
            raise DescriptionError(describe_unknown_name("argument of the xacro", name, arguments.requested))
    text: str = document.toprettyxml(indent="  ")
    if len(text) > request["longest"]:
        raise DescriptionError(f"it expands to {len(text)} characters: more than {request['longest']} are not read")
    return text


def _reason(error: Exception) -> str:
    """Return the message of an error in one line, with the remedy for an argument without a value."""
    message = " ".join(str(error).split()) or repr(error)
    if message.startswith(UNDEFINED):
        name = message.removeprefix(UNDEFINED).split()[0] if message != UNDEFINED else "NAME"
        message += f". Give it a value: values={{{name!r}: ...}}, --set {name}=..."
    return message[:1000]


def _location(xacro: ModuleType) -> str:
    """Return the macro and the files in which xacro stopped, in parentheses."""
    printed = io.StringIO()
    with contextlib.redirect_stderr(printed):
        xacro.print_location()
    return f" ({'; '.join(printed.getvalue().split(chr(10))).strip('; ')[:1000]})"


def _provide_package_search(folder: Path) -> None:
    """Let `$(find NAME)` search packages as meshes do, also where ament_index_python is not installed.

    xacro imports one function of that module.
    """

    def get_package_share_directory(name: str) -> str:
        package_folder = next(package_folders(name, folder, {}), None) if PACKAGE_NAME.fullmatch(name) else None
        own = enclosing_package(folder)[-1]
        if package_folder is None and source_package(own / PACKAGE_FILE) == name:
            package_folder = own  # a checkout in a folder of another name
        if package_folder is None:
            raise LookupError(f"no package {name!r} is known: source its workspace, or set ROS_PACKAGE_PATH")
        return str(package_folder)

    package, module = ModuleType("ament_index_python"), ModuleType("ament_index_python.packages")
    module.__dict__["get_package_share_directory"] = get_package_share_directory
    sys.modules.update({package.__name__: package, module.__name__: module})
