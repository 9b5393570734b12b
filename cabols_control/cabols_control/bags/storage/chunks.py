# SPDX-License-Identifier: Apache-2.0
"""Chunks of MCAP files: consistent heads, whole ones by checksum, beginnings of cut ones."""

from __future__ import annotations

import struct
from io import BytesIO
from zlib import crc32

import lz4.frame
import zstandard

HEAD = struct.Struct("<QQQII")
"""First and last time, size and checksum of the records in it, length of the compression's name."""
SIZE = struct.Struct("<Q")
HEAD_MAX = HEAD.size + 4 + SIZE.size
"""Longest head: that of a compression of four letters [bytes]."""
LARGEST = 1 << 28
"""Most records of a chunk that are looked for without a size [bytes]."""
COMPRESSIONS = (b"", b"lz4", b"zstd")


class ChunkError(ValueError):
    """A chunk's records cannot be had."""


def content_size(head: bytes) -> int | None:
    """Size of a chunk's content as its own fields say; None if they are none of a chunk.

    Args:
        head: first HEAD_MAX bytes of the content, or more.
    """
    if len(head) < HEAD.size + SIZE.size:
        return None
    _, _, plain_size, _, name_size = HEAD.unpack_from(head)
    start = HEAD.size + name_size
    name = head[HEAD.size : start]
    if name not in COMPRESSIONS or len(name) < name_size or start + SIZE.size > len(head):
        return None
    (size,) = SIZE.unpack_from(head, start)
    if not name and size != plain_size:
        return None
    return int(start + SIZE.size + size)


def records(content: bytes) -> bytes:
    """Records of a whole chunk.

    Raises:
        ChunkError: if their size or their checksum is not as the chunk says.
    """
    if content_size(content) != len(content):
        raise ChunkError("its sizes disagree")
    _, _, size, checksum, name_size = HEAD.unpack_from(content)
    start = HEAD.size + name_size
    found = _decompress(content[HEAD.size : start], content[start + SIZE.size :], size)
    if len(found) != size:
        raise ChunkError(f"expected {size} bytes of records, got {len(found)}")
    if checksum and crc32(found) != checksum:
        raise ChunkError("its checksum does not hold")
    return found


def records_by_checksum(content: bytes) -> bytes:
    """Records of a chunk whose size is announced wrongly, but whose checksum holds.

    Args:
        content: of the chunk.

    Returns:
        The records; empty if no checksum proves them.
    """
    if content_size(content) != len(content) or not checked(content):
        return b""
    _, _, _, checksum, name_size = HEAD.unpack_from(content)
    start = HEAD.size + name_size
    try:
        found = _decompress(content[HEAD.size : start], content[start + SIZE.size :], LARGEST)
    except ChunkError:
        return b""
    return found if len(found) <= LARGEST and crc32(found) == checksum else b""


def checked(content: bytes) -> bool:
    """Whether a chunk has a checksum at all."""
    _, _, _, checksum, _ = HEAD.unpack_from(content)
    return bool(checksum)


def beginning(content: bytes) -> bytes:
    """Records at the beginning of a chunk whose end is missing; empty if there are none."""
    if content_size(content) is None:
        return b""
    _, _, size, _, name_size = HEAD.unpack_from(content)
    start = HEAD.size + name_size
    try:
        found = _decompress(content[HEAD.size : start], content[start + SIZE.size :], size)
    except ChunkError:
        return b""
    return found[:size]


def _decompress(name: bytes, body: bytes, size: int) -> bytes:
    """Decompress; several frames and a frame without its end are as valid as one."""
    try:
        if name == b"zstd":
            return _frames(body, size)
        if name == b"lz4":
            return _lz4(body, size)
    except (zstandard.ZstdError, RuntimeError, ValueError, MemoryError, EOFError) as error:
        raise ChunkError(str(error)) from error
    return body


def _frames(body: bytes, size: int) -> bytes:
    found = bytearray()
    with zstandard.ZstdDecompressor().stream_reader(BytesIO(body), read_across_frames=True) as end:
        while len(found) <= size and (part := end.read(min(size + 1 - len(found), 1 << 20))):
            found += part
    return bytes(found)


def _lz4(body: bytes, size: int) -> bytes:
    found = bytearray()
    while body and len(found) <= size:
        frame = lz4.frame.LZ4FrameDecompressor()
        found += frame.decompress(body, max_length=size + 1 - len(found))
        body = frame.unused_data or b""
    return bytes(found)
