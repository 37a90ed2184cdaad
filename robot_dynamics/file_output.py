"""Files that replace others as a whole: an error, a full disk or a signal leaves the file that was there."""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import EBUSY, EPERM, EXDEV
from pathlib import Path
from secrets import token_hex

NEW_FILE_MODE = 0o666  # less the umask, by the operating system


@contextmanager
def replaced_file(path: str | Path) -> Iterator[Path]:
    """Yield the path of a temporary file, to be written in the block, that then takes the place of another one.

    The temporary file is beside the file. After the block it is written to the disk (fsync) and renamed. A process that
    is killed leaves it, with a name that begins with a dot. Pipes and devices, files in folders that cannot be
    written, and files that a container mounts by themselves are written in place: an error may leave a part of them.

    Parameters
    ----------
    path : str or Path
        The file, which need not exist; its folder must. The target of a symbolic link is replaced.

    Raises
    ------
    OSError, ValueError
        The file cannot be written; the file that was there has not changed.
    """
    target = Path(os.path.realpath(path))
    status = target.stat() if target.exists() else None
    if status is not None and not stat.S_ISREG(status.st_mode):
        yield target  # a pipe or a device; opening a folder raises the error
        return
    if status is not None and not os.access(target, os.W_OK):
        target.open("ab").close()  # raises PermissionError: a rename would replace a file that is write-protected
    try:
        # the ending is that of the file, from which writers of pictures take the format
        temporary = target.with_name(f".{target.stem[:40]}.{token_hex(8)}{target.suffix[:20]}")
        descriptor = os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, NEW_FILE_MODE)
    except PermissionError:
        if status is None:
            raise
        yield target
        return
    try:
        if status is not None:
            os.fchmod(descriptor, stat.S_IMODE(status.st_mode))
        os.close(descriptor)
        yield temporary
        _flush_to_disk(temporary)
        _rename(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
    with suppress(OSError):  # not every file system flushes folders
        _flush_to_disk(target.parent)


def _flush_to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _rename(temporary: Path, target: Path) -> None:
    """Rename a file; where a container mounts the target by itself, copy the content."""
    try:
        os.replace(temporary, target)
    except OSError as error:
        if error.errno not in (EBUSY, EPERM, EXDEV):
            raise
        shutil.copyfile(temporary, target)
