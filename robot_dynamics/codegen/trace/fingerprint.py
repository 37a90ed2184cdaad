"""Fingerprints of programs: hashes of everything on which a trace depends, computed without tracing.

These are all numbers and names of the robot, the options of the model, and the source of the recursions, of the trace
and of the code emitters. Values that no program reads, such as limits, count as well: a list of the values that matter
could become wrong, and would then load the program of another robot. A field of a dataclass whose metadata have
`in_fingerprint: False` does not count: what a viewer draws.
"""

import os
import struct
import time
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path

import numpy as np

PACKAGE = Path(__file__).parents[2]

FOLDERS = ("codegen", "constraints", "flexible", "model", "newton_euler", "parallel", "simulation")
"""Folders of the package with all source on which a program of a Robot depends."""

FILES = ("procedures.py",)
"""Further such files."""

IMPORT_TIME = time.time()

NUMERIC_KINDS = "biufc"
"""Kinds of NumPy types whose bytes are the value."""


def fingerprint(*values: object) -> str | None:
    """A text that differs wherever one of the values differs: robots, names, options.

    Parameters
    ----------
    *values : object
        Dataclasses, arrays, numbers, texts, None, and lists, tuples and dicts of them.

    Returns
    -------
    str or None
        None where a number is a symbol or a type is not supported, and where the source cannot be read or has changed
        since this process imported it.
    """
    try:
        return _digest([source_digest(PACKAGE, IMPORT_TIME), np.__version__, *values])
    except (OSError, TypeError):
        return None


def _digest(values: list[object]) -> str:
    return sha256(b"".join(_encode(values))).hexdigest()


@cache
def source_digest(package: Path, imported: float) -> str:
    """A hash of the source in the FOLDERS and FILES of a package.

    Parameters
    ----------
    package : Path
        Folder of the package.
    imported : float
        Time at which the package was imported [s since the epoch].

    Raises
    ------
    OSError
        If there is no source, or if a file changed after `imported`: then this process does not run what the file says.
    """
    texts: list[object] = []
    files = [package / name for name in FILES if (package / name).exists()]
    for path in sorted([*files, *(path for folder in FOLDERS for path in (package / folder).rglob("*.py"))]):
        texts += [str(path.relative_to(package)), path.read_bytes()]
        status = os.stat(path)
        if max(status.st_ctime, status.st_mtime) > imported:
            raise OSError(f"{path} has changed since it was imported")
    if not texts:
        raise OSError(f"no source in {package}")
    return _digest(texts)


def _encode(value: object) -> Iterator[bytes]:
    """Bytes that differ for different values.

    Each piece begins with its kind and size, so that no two sequences of pieces are equal. Raises TypeError for types
    that are not supported.
    """
    if isinstance(value, str):
        yield from _piece(b"text", value.encode("utf-8", "surrogatepass"))
    elif isinstance(value, bytes):
        yield from _piece(b"bytes", value)
    elif value is None or isinstance(value, bool | int):
        yield from _piece(b"exact", repr(value).encode())
    elif type(value) is float:
        yield from _piece(b"float", struct.pack("<d", value))
    elif isinstance(value, np.ndarray | np.generic) and value.dtype.kind in NUMERIC_KINDS:
        yield from _piece(b"array", f"{value.dtype.str}{value.shape}".encode())
        yield from _piece(b"of", value.tobytes())
    elif isinstance(value, list | tuple):
        yield from _piece(b"items", str(len(value)).encode())
        for item in value:
            yield from _encode(item)
    elif isinstance(value, dict):
        yield from _piece(b"names", b"")
        yield from _encode(list(value.items()))
    elif is_dataclass(value) and not isinstance(value, type):
        yield from _piece(b"object", f"{type(value).__module__}.{type(value).__qualname__}".encode())
        yield from _encode([getattr(value, name) for name in _field_names(type(value))])
    else:
        raise TypeError(f"{type(value).__name__} has no fingerprint")


def _piece(kind: bytes, content: bytes) -> Iterable[bytes]:
    return b"%s %d " % (kind, len(content)), content


@cache
def _field_names(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind) if field.metadata.get("in_fingerprint", True))
