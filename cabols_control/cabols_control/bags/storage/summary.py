# SPDX-License-Identifier: Apache-2.0
"""What stands at the end of an MCAP file: where its chunks lie, its channels, how many messages."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from zlib import crc32

from mcap.opcode import Opcode

from cabols_control.bags.storage.records import (
    FRAME,
    MAGIC,
    ChannelInfo,
    Fields,
    RecordError,
    Schema,
    channel_of,
    schema_of,
)

FOOTER = struct.Struct("<QQI")
FOOTER_SIZE = FRAME.size + FOOTER.size + len(MAGIC)
SUMMARY_MAX = 1 << 30


@dataclass
class FileSummary:
    """The summary section; empty where a file has none, or a damaged one.

    Attributes:
        channels: by number.
        offsets: of chunks, attachments and metadata, sorted [bytes].
        messages: number of all messages; None: not known.
        start: where the section begins; None: not known [bytes].
    """

    channels: dict[int, ChannelInfo] = field(default_factory=dict)
    offsets: list[int] = field(default_factory=list)
    messages: int | None = None
    start: int | None = None


def read_summary(read: Callable[[int, int], bytes], size: int) -> FileSummary:
    """Read a file's summary.

    Args:
        read: returns bytes from an offset, of a number.
        size: of the file [bytes].
    """
    begin = size - FOOTER_SIZE
    if begin < len(MAGIC):
        return FileSummary()
    end = read(begin, FOOTER_SIZE)
    if end[-len(MAGIC) :] != MAGIC or FRAME.unpack_from(end) != (Opcode.FOOTER, FOOTER.size):
        return FileSummary()
    start, _, checksum = FOOTER.unpack_from(end, FRAME.size)
    if not len(MAGIC) <= start <= begin or begin - start > SUMMARY_MAX:
        return FileSummary()
    content = read(start, begin - start)
    if checksum and crc32(content + end[: FRAME.size + 16]) != checksum:
        return FileSummary()
    try:
        return _parse(content, start)
    except (RecordError, struct.error):
        return FileSummary()


def _parse(content: bytes, start: int) -> FileSummary:
    found = FileSummary(start=start)
    schemas: dict[int, Schema] = {}
    position = 0
    while position + FRAME.size <= len(content):
        opcode, size = FRAME.unpack_from(content, position)
        position += FRAME.size
        record = content[position : position + size]
        if len(record) < size:
            raise RecordError("a record beyond the section's end")
        position += size
        if opcode == Opcode.SCHEMA:
            schema = schema_of(record)
            schemas[schema.number] = schema
        elif opcode == Opcode.CHANNEL:
            number, channel = channel_of(record, schemas)
            found.channels[number] = channel
        elif opcode == Opcode.STATISTICS:
            (found.messages,) = Fields(record).numbers("Q")
        elif opcode == Opcode.CHUNK_INDEX:
            found.offsets.append(Fields(record).numbers("QQQ")[2])
        elif opcode in (Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX):
            found.offsets.append(Fields(record).numbers("Q")[0])
    found.offsets.sort()
    return found
