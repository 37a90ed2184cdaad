"""Object code, and what is to be known of it, kept on disk by a hash of all that it was made from.

The directory is $ROBOT_DYNAMICS_CACHE (set and empty: nothing is kept), else robot_dynamics in $XDG_CACHE_HOME or in
~/.cache. What lies there is run as code: the directory must belong to this user and nobody else may write there, or it
is left alone. Whatever goes wrong with it costs time and nothing else.
"""

import contextlib
import os
import stat
import tempfile
from hashlib import sha256
from pathlib import Path

MAGIC = b"robot_dynamics object code 1\n"
MAX_FILES = 400
SUFFIX = ".object"


def load(key):
    """What was stored for a key (text), or None."""
    try:
        return _unpacked(_read(_file(key)))
    except (OSError, RuntimeError, ValueError):
        return None


def store(key, image):
    """Keep object code (bytes) for a key (text), if it can be kept. Other processes see all of it or nothing."""
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        path = _file(key)
        _make_room(path.parent)
        descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".new")
        try:
            with open(descriptor, "wb") as file:
                file.write(MAGIC + sha256(image).digest() + image)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise


def cache_directory():
    """Where object code is kept. Raises OSError or RuntimeError if it can be kept nowhere."""
    told = os.environ.get("ROBOT_DYNAMICS_CACHE")
    if told == "":
        raise OSError("nothing is to be kept")
    if told is not None:
        path = Path(told).expanduser()
    else:
        base = os.environ.get("XDG_CACHE_HOME", "")
        path = (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "robot_dynamics"
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    _refuse_strangers(path.stat(), stat.S_ISDIR)
    return path


def _refuse_strangers(status, kind):
    if not kind(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise OSError("another user may write to the cache")


def _file(key):
    return cache_directory() / (sha256(key.encode()).hexdigest() + SUFFIX)


def _read(path):
    with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC), "rb") as file:
        _refuse_strangers(os.fstat(file.fileno()), stat.S_ISREG)
        return file.read()


def _unpacked(content):
    """The object code of a file. Raises ValueError if it is not whole."""
    start = len(MAGIC) + sha256().digest_size
    image = content[start:]
    if content[:start] != MAGIC + sha256(image).digest():
        raise ValueError("not a whole file of object code")
    return image


def _make_room(path):
    """Once there are too many files, remove the older half."""
    files = [entry for entry in os.scandir(path) if entry.name.endswith(SUFFIX)]
    if len(files) >= MAX_FILES:
        files.sort(key=lambda entry: entry.stat(follow_symlinks=False).st_mtime)
        for entry in files[: MAX_FILES // 2]:
            with contextlib.suppress(OSError):
                os.unlink(entry.path)
