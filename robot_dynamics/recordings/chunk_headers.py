"""Chunks of MCAP files whose header differs from the index at the end of the file.

`rosbags` reads chunks as the index states, other readers as the header of each chunk states: where both differ, readers
find other messages without a word.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterable
from typing import Any, BinaryIO

CHUNK = 0x06  # opcode
SIZES = struct.Struct("<BQQQQII")  # opcode, length of the record, first and last time, size, CRC, length of a name
LENGTH_SIZE = struct.Struct("<Q")
FIXED_SIZE = 40  # [bytes] of a record without the name of the compression and the data


def differing_chunks(file: BinaryIO, chunks: Iterable[Any]) -> list[int]:
    """Offsets [bytes] of the chunks whose header differs from the index.

    Parameters
    ----------
    file : MCAP file; its position changes.
    chunks : entries of the index, as `rosbags` reads them.
    """
    end = file.seek(0, os.SEEK_END)
    return [
        chunk.chunk_start_offset
        for chunk in chunks
        if chunk.chunk_start_offset >= end or not _header_agrees(file, chunk)
    ]


def _header_agrees(file: BinaryIO, chunk: Any) -> bool:
    """Whether the header of a chunk states what its entry in the index states, and its length is that of its parts."""
    compression = chunk.compression.encode()
    file.seek(chunk.chunk_start_offset)
    header = file.read(SIZES.size + len(compression) + LENGTH_SIZE.size)
    if len(header) < SIZES.size + len(compression) + LENGTH_SIZE.size:
        return False
    opcode, length, start_time, end_time, size, _crc, name_length = SIZES.unpack_from(header)
    (packed_size,) = LENGTH_SIZE.unpack_from(header, SIZES.size + len(compression))
    return (
        opcode == CHUNK
        and name_length == len(compression)
        and header[SIZES.size : SIZES.size + len(compression)] == compression
        and (start_time, end_time) == (chunk.message_start_time, chunk.message_end_time)
        and (size, packed_size) == (chunk.uncompressed_size, chunk.compressed_size)
        and length == FIXED_SIZE + len(compression) + packed_size
    )
