"""Bags whose files or messages are compressed (`ros2 bag record --compression-mode file` or `message`).

A small file may unpack to any size. Files are unpacked piece by piece, and the bag is refused where their size exceeds
`MAX_RATIO` times that of the compressed files, or where the folder for temporary files becomes full. Messages stay
packed: `rosbags`, which unpacks them without a limit, reads links to the files in a folder whose metadata does not
mention the compression.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path, PurePath
from typing import Any, NamedTuple

import yaml

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.decompression import MAX_RATIO, import_zstd

METADATA = "metadata.yaml"
INFORMATION = "rosbag2_bagfile_information"
MAX_METADATA_SIZE = 10 * 1024 * 1024
MIN_LIMIT = 64 * 1024 * 1024  # [bytes] that any bag may unpack to
MIN_FREE_SPACE = 256 * 1024 * 1024  # [bytes] left in the folder for temporary files
PIECE_SIZE = 4 * 1024 * 1024  # [bytes]


class UnpackedBag(NamedTuple):
    """A bag in a temporary folder.

    Attributes
    ----------
    folder : of the bag, of the same name as the original one.
    has_packed_messages : whether each message is compressed.
    temporary : removes the folder when it is collected.
    """

    folder: Path
    has_packed_messages: bool
    temporary: tempfile.TemporaryDirectory[str]


def unpack_bag(folder: Path, note: Callable[[str], None]) -> UnpackedBag | None:
    """Unpack the files of a bag into a temporary folder, or link them where their messages are compressed.

    Parameters
    ----------
    folder : of the bag.
    note : called with a sentence on each file that is damaged.

    Returns
    -------
    UnpackedBag or None
        None where nothing is compressed, but for chunks, or the metadata cannot be read.

    Raises
    ------
    RecordingError
        Where the files unpack to too much, nothing can be unpacked, or the folder for temporary files is full.
    """
    metadata = _read_metadata(folder / METADATA)
    if metadata is None:
        return None
    has_packed_messages = metadata["compression_mode"].lower() == "message"
    paths = [folder / PurePath(name).name for name in metadata.pop("relative_file_paths")]
    temporary = tempfile.TemporaryDirectory(prefix="robot_dynamics.")
    try:
        target = Path(temporary.name, folder.name)
        target.mkdir()
        names = _link_files(paths, target) if has_packed_messages else _unpack_files(folder, paths, target, note)
        information = {**metadata, "compression_mode": "", "compression_format": "", "relative_file_paths": names}
        (target / METADATA).write_text(yaml.safe_dump({INFORMATION: information}), encoding="utf-8")
    except BaseException as error:
        temporary.cleanup()
        if isinstance(error, OSError):
            raise RecordingError(f"{folder} cannot be unpacked: {error.strerror or error}") from None
        raise
    return UnpackedBag(target, has_packed_messages, temporary)


def _read_metadata(path: Path) -> dict[str, Any] | None:
    """The metadata of a bag whose files or messages are compressed by zstd, and whose files exist; else None."""
    try:
        if path.stat().st_size > MAX_METADATA_SIZE:
            return None
        metadata = yaml.safe_load(path.read_text(encoding="utf-8"))[INFORMATION]
        is_compressed = metadata["compression_mode"].lower() in ("file", "message")
        is_zstd = metadata["compression_format"] == "zstd"
        names = metadata["relative_file_paths"]
        # a name of another type, as nested aliases of YAML, may have any length as text
        if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
            return None
        is_complete = all((path.parent / PurePath(name).name).is_file() for name in names)
    except (OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError, yaml.YAMLError):
        return None  # `rosbags` reports the reason
    return metadata if is_compressed and is_zstd and is_complete else None


def _link_files(paths: list[Path], target: Path) -> list[str]:
    """Link files, and write-ahead logs beside them, in a folder. Returns their names, without those of logs."""
    for path in paths:
        for file in (path, *(Path(f"{path}{suffix}") for suffix in ("-wal", "-shm"))):
            if file.is_file():
                (target / file.name).symlink_to(file.absolute())
    return [path.name for path in paths]


def _unpack_files(folder: Path, paths: list[Path], target: Path, note: Callable[[str], None]) -> list[str]:
    """Unpack files into a folder. Returns the names of those that have any content. Raises RecordingError."""
    files = {path.stem: path for path in paths}
    limit = _SizeLimit(folder, sum(file.stat().st_size for file in files.values()))
    stems = [stem for stem, file in files.items() if _unpack_file(file, target / stem, limit, note)]
    if not stems:
        names = ", ".join(file.name for file in files.values())
        raise RecordingError(f"{folder}: nothing can be unpacked of {names[:200]}: the files are damaged")
    return stems


class _SizeLimit:
    """The largest size of all unpacked files of a bag together, whose compressed files have a size [bytes]."""

    def __init__(self, folder: Path, packed_size: int) -> None:
        self._folder = folder
        self._packed_size = packed_size
        self._limit = max(MIN_LIMIT, MAX_RATIO * packed_size)
        self._size = 0

    def add(self, size: int) -> None:
        """Count a piece. Raises RecordingError where the bag becomes too large, or the temporary folder full."""
        self._size += size
        if self._size > self._limit:
            raise RecordingError(
                f"{self._folder} unpacks to more than {self._limit / 1e6:.0f} MB, "
                f"{self._limit / self._packed_size:.0f} times its size: no recording of joints compresses so well. "
                "Unpack its files with zstd -d if it is one"
            )
        if shutil.disk_usage(tempfile.gettempdir()).free < MIN_FREE_SPACE + size:
            raise RecordingError(
                f"{self._folder} cannot be unpacked: less than {MIN_FREE_SPACE / 1e6:.0f} MB are free in "
                f"{tempfile.gettempdir()}. Set TMPDIR to a folder with more space"
            )


def _unpack_file(source: Path, target: Path, limit: _SizeLimit, note: Callable[[str], None]) -> bool:
    """Unpack a file, or as much of it as is not damaged; returns whether there is a file then."""
    zstd = import_zstd()
    with source.open("rb") as packed, target.open("wb") as unpacked:
        try:
            with zstd.open(packed, "rb") as pieces:
                while piece := pieces.read1(PIECE_SIZE):
                    limit.add(len(piece))
                    unpacked.write(piece)
        except (zstd.ZstdError, EOFError) as error:
            reason = " ".join(str(error).split())[:100]
            note(f"{source.name} is damaged: it was unpacked to where it breaks off ({reason})")
    if target.stat().st_size == 0:
        target.unlink()
        return False
    return True
