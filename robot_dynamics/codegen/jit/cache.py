"""Object code and interfaces of programs on disk, named by a hash of everything they were made from.

The directory is $ROBOT_DYNAMICS_CACHE (set and empty: no cache), else robot_dynamics in $XDG_CACHE_HOME or in ~/.cache.
Its files run as code: the directory must belong to this user and nobody else may write to it, or it is not used. Errors
of the cache cost time and nothing else.
"""

import contextlib
import os
import stat
import tempfile
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

MAGIC = b"robot_dynamics object code 1\n"
MAX_FILES = 400
SUFFIX = ".object"


def load(key: str) -> bytes | None:
    """The content stored for a key, or None."""
    try:
        return _unpack(_read(_path(key)))
    except (OSError, RuntimeError, ValueError):
        return None


def store(key: str, image: bytes) -> None:
    """Store content for a key, if there is a cache. Other processes see the whole file or none."""
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        path = _path(key)
        _remove_old_files(path.parent)
        descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".new")
        try:
            with open(descriptor, "wb") as file:
                file.write(MAGIC + sha256(image).digest() + image)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise


def cache_directory() -> Path:
    """The directory of the cache, created if needed. Raises OSError or RuntimeError if there is none."""
    setting = os.environ.get("ROBOT_DYNAMICS_CACHE")
    if setting == "":
        raise OSError("the cache is switched off")
    if setting is not None:
        path = Path(setting).expanduser()
    else:
        base = os.environ.get("XDG_CACHE_HOME", "")
        path = (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "robot_dynamics"
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    _require_private(path.stat(), stat.S_ISDIR)
    return path


def _require_private(status: os.stat_result, is_kind: Callable[[int], bool]) -> None:
    """Raise OSError unless a file or directory is of a kind, belongs to this user and is writable by no other user."""
    is_shared = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    if not is_kind(status.st_mode) or status.st_uid != os.geteuid() or is_shared:
        raise OSError("another user may write to the cache")


def _path(key: str) -> Path:
    return cache_directory() / (sha256(key.encode()).hexdigest() + SUFFIX)


def _read(path: Path) -> bytes:
    with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC), "rb") as file:
        _require_private(os.fstat(file.fileno()), stat.S_ISREG)
        return file.read()


def _unpack(content: bytes) -> bytes:
    """The content without its header. Raises ValueError if it is incomplete or damaged."""
    start = len(MAGIC) + sha256().digest_size
    image = content[start:]
    if content[:start] != MAGIC + sha256(image).digest():
        raise ValueError("the file is incomplete or damaged")
    return image


def _remove_old_files(directory: Path) -> None:
    """Remove the older half of the files once there are MAX_FILES."""
    files = [entry for entry in os.scandir(directory) if entry.name.endswith(SUFFIX)]
    if len(files) >= MAX_FILES:
        files.sort(key=lambda entry: entry.stat(follow_symlinks=False).st_mtime)
        for entry in files[: MAX_FILES // 2]:
            with contextlib.suppress(OSError):
                os.unlink(entry.path)
