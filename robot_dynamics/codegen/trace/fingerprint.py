"""Which program a model of a robot is, told without tracing it: a hash of all that the trace depends on.

These are every number and name of the robot, what is asked of it, and the source of the recursions, of the trace and of
the writers. Limits and such have no part in a program and count all the same: to tell what has would be a second list
to keep right, and one that is wrong would give another robot's efforts.
"""

import os
import struct
import time
from dataclasses import fields, is_dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path

import numpy as np

PACKAGE = Path(__file__).parents[2]
FOLDERS = ("codegen", "constraints", "flexible", "model", "newton_euler")
"""Of the package, where all lies that a program of a Robot depends on."""
IMPORT_TIME = time.time()
NUMERIC_KINDS = "biufc"  # kinds of NumPy's types of which the bytes are the value


def fingerprint(*things):
    """A text that is another one wherever any of the things is: robots, names, options. None where none can be told.

    That is where a number is a symbol, and where the source cannot be read or has changed since this process began.
    """
    try:
        return _digest([source_digest(PACKAGE, IMPORT_TIME), np.__version__, *things])
    except (OSError, TypeError):
        return None


def _digest(things):
    return sha256(b"".join(_pieces(things))).hexdigest()


@cache
def source_digest(package, imported):
    """A hash of the source in the FOLDERS of the package's folder.

    Raises OSError where there is none, and where a file changed after `imported` [s]: then what runs in this process is
    not what the files say.
    """
    texts = []
    for path in sorted(path for folder in FOLDERS for path in (package / folder).rglob("*.py")):
        texts += [str(path.relative_to(package)), path.read_bytes()]
        status = os.stat(path)
        if max(status.st_ctime, status.st_mtime) > imported:
            raise OSError(f"{path} has changed since it was imported")
    if not texts:
        raise OSError(f"no source in {package}")
    return _digest(texts)


def _pieces(thing):
    """Bytes for a thing: others for another one. Each piece begins with its kind and its size, so none runs into the
    next. Raises TypeError for what is not known here."""
    if isinstance(thing, str):
        yield from _piece(b"text", thing.encode("utf-8", "surrogatepass"))
    elif isinstance(thing, bytes):
        yield from _piece(b"bytes", thing)
    elif thing is None or isinstance(thing, bool | int):
        yield from _piece(b"exact", repr(thing).encode())
    elif type(thing) is float:
        yield from _piece(b"float", struct.pack("<d", thing))
    elif isinstance(thing, np.ndarray | np.generic) and thing.dtype.kind in NUMERIC_KINDS:
        yield from _piece(b"array", f"{thing.dtype.str}{thing.shape}".encode())
        yield from _piece(b"of", thing.tobytes())
    elif isinstance(thing, list | tuple):
        yield from _piece(b"items", str(len(thing)).encode())
        for item in thing:
            yield from _pieces(item)
    elif isinstance(thing, dict):
        yield from _piece(b"names", b"")
        yield from _pieces(list(thing.items()))
    elif is_dataclass(thing) and not isinstance(thing, type):
        yield from _piece(b"object", f"{type(thing).__module__}.{type(thing).__qualname__}".encode())
        yield from _pieces([getattr(thing, name) for name in _fields(type(thing))])
    else:
        raise TypeError(f"{type(thing).__name__} has no fingerprint")


def _piece(kind, content):
    return b"%s %d " % (kind, len(content)), content


@cache
def _fields(kind):
    return tuple(field.name for field in fields(kind))
