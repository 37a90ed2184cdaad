"""Calls of functions in a process of their own, with limits on memory and time.

Libraries that interpret descriptions may loop, use all memory, end the process, print, and keep state. In a process of
their own none of this concerns the caller, who gets a result or an error.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import subprocess
import sys
import tempfile
from importlib import import_module
from typing import TYPE_CHECKING, Any

from robot_dynamics.errors import DescriptionError, MissingPackageError

if TYPE_CHECKING:
    from collections.abc import Mapping

TIME_LIMIT = 60.0
"""Most seconds of a call; large robots take one or two."""

MEMORY_LIMIT = 4 * 1024**3
"""Most bytes that the process of a call may map."""

# the process of the call finds modules where this one does; its first line of input says where
PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.stdin.buffer.readline()); "
    "from robot_dynamics.model.formats.isolated_call import serve_call; serve_call()"
)


def call_isolated(
    module: str, arguments: Mapping[str, Any], source: object, task: str, writes_files: bool = False
) -> Any:
    """Return the result of a function `run(arguments)` of a module of this package, called in another process.

    Parameters
    ----------
    module : str
        Name of the module.
    arguments : mapping
        Argument of the function; it and the result must have a form in JSON.
    source : object
        Name of the description in error messages.
    task : str
        What the function does, for error messages, such as ``"xacro"``.
    writes_files : bool
        Whether the library writes files where it runs, such as a log: it then runs in a temporary folder.

    Raises
    ------
    DescriptionError
        If the function raises an error, needs more than TIME_LIMIT or MEMORY_LIMIT, or ends its process.
    MissingPackageError
        If a package is not installed.
    """
    search_path = [os.path.abspath(entry) for entry in sys.path]
    request = "\n".join(json.dumps(part) for part in (search_path, [module, dict(arguments)]))
    try:
        with tempfile.TemporaryDirectory() if writes_files else contextlib.nullcontext() as folder:
            process = subprocess.run(
                [sys.executable, "-c", PROGRAM],
                input=request.encode(),
                capture_output=True,
                timeout=TIME_LIMIT,
                cwd=folder,
                env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"},
            )
    except subprocess.TimeoutExpired:
        raise DescriptionError(f"{source}: {task} takes more than {TIME_LIMIT:g} s. The text may loop") from None
    except OSError as error:
        raise DescriptionError(f"{source}: {task} needs a process of its own, which does not start: {error}") from None
    try:
        response = json.loads(process.stdout)
    except ValueError:
        *_, reason = (process.stderr.decode(errors="replace").strip() or f"status {process.returncode}").splitlines()
        raise DescriptionError(f"{source}: {task} ended without a result ({reason[:300]})") from None
    if "missing" in response:
        raise MissingPackageError(response["missing"], name=response["package"])
    if "error" in response:
        raise DescriptionError(f"{source}: {response['error']}")
    return response["result"]


def serve_call() -> None:
    """Run in the process of a call: read its second line of input, call the function, write the response."""
    _limit_memory()
    module, arguments = json.loads(sys.stdin.buffer.readline())
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no response
    printed = io.StringIO()
    response: dict[str, Any]
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        try:
            response = {"result": import_module(module).run(arguments)}
        except MissingPackageError as error:
            response = {"missing": str(error), "package": error.name}
        except DescriptionError as error:
            response = {"error": str(error)}
        except MemoryError:
            response = {"error": f"it needs more than {MEMORY_LIMIT // 1024**2} MB of memory"}
        except RecursionError:
            response = {"error": "its elements or macros are nested too deeply"}
    with output:
        output.write(json.dumps(response).encode())


def _limit_memory() -> None:
    """Limit the memory and the processor time of this process, where the system can."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
        seconds = int(TIME_LIMIT) + 1  # also where the caller has died
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
