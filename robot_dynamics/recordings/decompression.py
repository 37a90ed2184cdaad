"""Compressed parts of bags, unpacked to a bounded size: chunks of MCAP files and single messages.

A few bytes may unpack to any size, and the size that a file states may be false: the limits depend on the packed bytes
alone.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, MutableMapping
from importlib import import_module
from types import ModuleType
from typing import TypeAlias

from robot_dynamics.errors import RecordingError
from robot_dynamics.optional_packages import import_optional

MAX_RATIO = 200  # of the unpacked size to the compressed size; bags of robots at rest reach 50
RATIO_OF_LARGE_PARTS = 10  # beyond LARGE_SIZE
LARGE_SIZE = 128 * 1024 * 1024  # [bytes] unpacked
MIN_CHUNK_LIMIT = 2 * 1024 * 1024  # [bytes] that any chunk may unpack to; recorders write chunks of 1 to 4 MB
PIECE_SIZE = 4 * 1024 * 1024  # [bytes]
MIN_MESSAGE_LIMIT = 1024 * 1024  # [bytes] that any message may unpack to; one of a hundred joints has 5 kB

Decompressor: TypeAlias = Callable[[bytes, int], bytes]  # of compressed bytes and the size that the file states


def import_zstd() -> ModuleType:
    """The module that unpacks zstd, which Python has from 3.14 on. Raises MissingPackageError."""
    if sys.version_info >= (3, 14):
        return import_module("compression.zstd")
    return import_optional("backports.zstd", "reading a compressed bag")


def unpacked_limit(packed_size: int, min_limit: int) -> int:
    """The size [bytes] to which data of a packed size [bytes] may unpack. min_limit: that of data of any size."""
    return max(min_limit, RATIO_OF_LARGE_PARTS * packed_size, min(MAX_RATIO * packed_size, LARGE_SIZE))


def unpack_zstd(packed: bytes, min_limit: int) -> bytes:
    """Unpack all frames of zstd. min_limit: [bytes] to which data of any size may unpack.

    Raises RecordingError where they unpack to too much, EOFError where they end early, ZstdError where they are wrong.
    """
    zstd = import_zstd()
    limit = unpacked_limit(len(packed), min_limit)
    pieces: list[bytes] = []
    size = 0
    remaining = packed
    while remaining:
        decompressor = zstd.ZstdDecompressor()
        piece = decompressor.decompress(remaining, max_length=limit - size + 1)
        size += len(piece)
        _require_size(size, limit, len(packed))
        if not decompressor.eof:
            raise EOFError("compressed data end before the end of their frame")
        pieces.append(piece)
        remaining = decompressor.unused_data
    return b"".join(pieces)


def unpack_lz4(packed: bytes, min_limit: int) -> bytes:
    """Unpack a frame of lz4, as `unpack_zstd` does. Raises RecordingError, EOFError, RuntimeError."""
    limit = unpacked_limit(len(packed), min_limit)
    decompressor = import_optional("lz4.frame", "reading a compressed bag").LZ4FrameDecompressor()
    pieces: list[bytes] = []
    size = 0
    remaining = packed
    while not decompressor.eof:
        piece = decompressor.decompress(remaining, max_length=PIECE_SIZE)
        size += len(piece)
        _require_size(size, limit, len(packed))
        pieces.append(piece)
        remaining = b""
        if decompressor.needs_input and not decompressor.eof:
            raise EOFError("compressed data end before the end of their frame")
    return b"".join(pieces)


def _require_size(size: int, limit: int, packed_size: int) -> None:
    if size > limit:
        raise RecordingError(
            f"{packed_size} bytes unpack to more than {limit / 1e6:.0f} MB: no recording of joints compresses so well"
        )


CHUNK_DECOMPRESSORS: dict[str, Decompressor] = {
    "": lambda packed, _: packed,
    "lz4": lambda packed, _: unpack_lz4(packed, MIN_CHUNK_LIMIT),
    "zstd": lambda packed, _: unpack_zstd(packed, MIN_CHUNK_LIMIT),
}
"""The decompressors of chunks by the name that MCAP has for their compression."""


def bound_chunks() -> None:
    """Replace the decompressors of `rosbags`, which have no limit. Raises MissingPackageError."""
    storage = import_optional("rosbags.rosbag2.storage_mcap", "reading or writing a bag")
    table: MutableMapping[str, Decompressor] = storage.DECOMPRESSORS
    table.update(CHUNK_DECOMPRESSORS)
