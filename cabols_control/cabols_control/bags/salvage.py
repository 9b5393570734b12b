"""Read MCAP files from front to back, complete or damaged.

The stream reader of mcap accepts a cut record as a whole one and stops at the first exception.
This module therefore reads the frames itself, and parses the records with mcap.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple

import yaml
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream

from cabols_control.bags.definitions import Definition
from cabols_control.bags.errors import BagError

MAGIC = b"\x89MCAP0\r\n"
FRAME = struct.Struct("<BQ")
MESSAGE = struct.Struct("<HIQQ")
CHUNK_HEAD = struct.Struct("<QQQII")


class Message(NamedTuple):
    """One message; `channel` is the number in its file, times in ns."""

    channel: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes


@dataclass(frozen=True)
class ChannelInfo:
    """One channel of a file."""

    topic: str
    definition: Definition
    encoding: str
    qos_text: str


class Salvage:
    """One pass through a file.

    Attributes:
        channels: by number, up to the present position of the pass.
        metadata: records by name, likewise.
        dropped_bytes: bytes of records that are cut or damaged.
        complete: whether the pass has found index, footer and end.
    """

    def __init__(self, path: Path, strict: bool) -> None:
        """Prepare; messages() reads.

        Args:
            path: of the file.
            strict: whether damage is an error, or skipped and counted.
        """
        self._path = path
        self._strict = strict
        self._schemas: dict[int, Schema] = {}
        self.channels: dict[int, ChannelInfo] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.dropped_bytes = 0
        self.complete = False

    def messages(self) -> Iterator[Message]:
        """Yield every readable message in the order of the file.

        Raises:
            BagError: if the file is no MCAP file, or in strict mode not whole.
        """
        try:
            with self._path.open("rb") as stream:
                yield from self._messages(stream)
        except OSError as error:
            raise BagError(
                f"{self._path}: expected a readable MCAP file, got {error.strerror or error}; "
                "check path and permissions"
            ) from error

    def _messages(self, stream: IO[bytes]) -> Iterator[Message]:
        start = stream.read(len(MAGIC))
        if not MAGIC.startswith(start):
            raise BagError(
                f"{self._path}: expected an MCAP file, got one that begins with {start!r}; "
                "name the bag's folder or its .mcap"
            )
        in_data = True
        for opcode, content, size in self._frames(stream):
            if opcode == Opcode.CHUNK:
                yield from self._chunk(content, size)
            elif opcode == Opcode.MESSAGE and len(content) == size:
                yield self._message(content, 0, size)
            elif opcode == Opcode.FOOTER:
                self.complete = stream.read(len(MAGIC)) == MAGIC
                break
            elif opcode == Opcode.DATA_END:
                # The index that follows only repeats the data, without a checksum for each record.
                in_data = False
            elif in_data and len(content) == size:
                self._note(opcode, content)
        if not self.complete:
            self._damage("no end: it was cut or its recorder was killed", 0)

    def _frames(self, stream: IO[bytes]) -> Iterator[tuple[int, bytes, int]]:
        """Yield opcode, content and size that the content should have."""
        while head := stream.read(FRAME.size):
            if len(head) < FRAME.size:
                self._damage("a cut record", len(head))
                return
            opcode, size = FRAME.unpack(head)
            if opcode == 0:
                # A file system may leave zeros after a power cut.
                self._damage("zeros", FRAME.size + _remaining(stream))
                return
            content = stream.read(min(size, _remaining(stream)))
            if len(content) < size:
                self._damage("a cut record", FRAME.size + len(content))
            yield opcode, content, size

    def _chunk(self, content: bytes, size: int) -> Iterator[Message]:
        cut = len(content) < size
        try:
            data = _cut_chunk(content) if _lacks_data(content) else _whole_chunk(content)
        except Exception as error:
            # Damaged bytes may raise any error of zlib, zstd, struct or the text decoder.
            if not cut:
                self._damage(f"a damaged chunk ({error})", FRAME.size + size)
            return
        position, end = 0, len(data)
        while position + FRAME.size <= end:
            opcode, length = FRAME.unpack_from(data, position)
            position += FRAME.size
            if position + length > end:
                return
            if opcode == Opcode.MESSAGE:
                yield self._message(data, position, length)
            else:
                self._note(opcode, data[position : position + length])
            position += length

    def _message(self, data: bytes, position: int, length: int) -> Message:
        channel, sequence, log_time, publish_time = MESSAGE.unpack_from(data, position)
        payload = data[position + MESSAGE.size : position + length]
        return Message(channel, sequence, log_time, publish_time, payload)

    def _note(self, opcode: int, content: bytes) -> None:
        """Store what a record says about the messages."""
        try:
            stream = ReadDataStream(BytesIO(content))
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self._schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                self.channels[channel.id] = self._channel(channel)
            elif opcode == Opcode.METADATA:
                record = Metadata.read(stream)
                self.metadata[record.name] = dict(record.metadata)
        except BagError:
            raise
        except Exception as error:
            self._damage(f"a damaged record ({error})", FRAME.size + len(content))

    def _channel(self, channel: Channel) -> ChannelInfo:
        schema = self._schemas.get(channel.schema_id)
        if schema is None or schema.encoding != "ros2msg" or channel.message_encoding != "cdr":
            came = schema.encoding if schema else "no schema"
            raise BagError(
                f"{channel.topic}: expected CDR messages with a ros2msg definition, got "
                f"{channel.message_encoding} with {came}; record it with cabols or `ros2 bag`"
            )
        type_hash = channel.metadata.get("topic_type_hash", "")
        definition = Definition(schema.name, schema.data.decode(), type_hash)
        qos_text = _readable_qos(channel.metadata.get("offered_qos_profiles", ""))
        return ChannelInfo(channel.topic, definition, channel.message_encoding, qos_text)

    def _damage(self, what: str, size: int) -> None:
        self.dropped_bytes += size
        if self._strict:
            raise BagError(
                f"{self._path}: expected a whole MCAP file, got one with {what}; run "
                f"`ros2 run cabols_control recover {self._path.parent}`"
            )


def _readable_qos(text: str) -> str:
    """Return a YAML list of profiles, empty if the text is none."""
    try:
        profiles = yaml.safe_load(text)
    except yaml.YAMLError:
        return "[]"
    return text if isinstance(profiles, list) else "[]"


def _remaining(stream: IO[bytes]) -> int:
    here = stream.tell()
    end = stream.seek(0, 2)
    stream.seek(here)
    return end - here


def _whole_chunk(content: bytes) -> bytes:
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    data, length = get_chunk_data_stream(chunk, validate_crc=True)
    return data.read(length)


def _lacks_data(content: bytes) -> bool:
    """Whether a chunk's end is missing; if only its frame is damaged, its checksum still holds."""
    name_length = CHUNK_HEAD.unpack_from(content)[-1]
    start = CHUNK_HEAD.size + name_length
    (size,) = struct.unpack_from("<Q", content, start)
    return bool(start + 8 + size > len(content))


def _cut_chunk(content: bytes) -> bytes:
    """Decompress the beginning of a chunk whose end is missing."""
    *_, size, _, name_length = CHUNK_HEAD.unpack_from(content)
    start = CHUNK_HEAD.size
    compression = content[start : start + name_length].decode()
    body = content[start + name_length + 8 :]
    if compression == "zstd":
        body = zstandard.ZstdDecompressor().decompressobj().decompress(body)
    elif compression:
        return b""
    return body[:size]
