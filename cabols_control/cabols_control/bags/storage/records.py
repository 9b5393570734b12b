# SPDX-License-Identifier: Apache-2.0
"""Records of MCAP files (mcap.dev/spec), parsed so that a field never reaches beyond its record."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import NamedTuple
from zlib import crc32

import yaml
from mcap.opcode import Opcode

from cabols_control.bags.names import type_of

MAGIC = b"\x89MCAP0\r\n"
FRAME = struct.Struct("<BQ")
MESSAGE = struct.Struct("<HIQQ")
LAST_OPCODE = 15
PRIVATE = 0x80
"""Opcodes from here on are of other programs; readers skip them."""
SIZES = {int(Opcode.FOOTER): 20, int(Opcode.DATA_END): 4}
"""Of the records that have a fixed one [bytes]."""
QOS, HASH = "offered_qos_profiles", "topic_type_hash"


class RecordError(ValueError):
    """A record's fields do not fit into it."""


@dataclass(frozen=True)
class Schema:
    """A message type as the file has it."""

    number: int
    name: str
    encoding: str
    data: bytes


NO_SCHEMA = Schema(0, "", "", b"")


@dataclass(frozen=True, eq=False)
class ChannelInfo:
    """One channel of a file; compared by identity.

    Attributes:
        topic: absolute name.
        schema: its message type.
        encoding: of its messages.
        metadata: text by key.
    """

    topic: str
    schema: Schema
    encoding: str = "cdr"
    metadata: dict[str, str] = field(default_factory=dict)

    @property
    def type_name(self) -> str:
        """Type with its middle part: `geometry_msgs/Wrench` is `geometry_msgs/msg/Wrench`."""
        return type_of(self.schema.name)

    @property
    def type_hash(self) -> str:
        """RIHS01 hash of the type; empty: not recorded."""
        return self.metadata.get(HASH, "")

    @property
    def qos_text(self) -> str:
        """YAML list of the publishers' profiles, empty if the recorded text is none."""
        text = self.metadata.get(QOS, "")
        try:
            profiles = yaml.safe_load(text)
        except (yaml.YAMLError, ValueError):
            return "[]"
        return text if isinstance(profiles, list) else "[]"

    def same(self, other: ChannelInfo) -> bool:
        """Whether another channel has the same content."""
        return (self.topic, self.schema, self.encoding, self.metadata) == (
            other.topic,
            other.schema,
            other.encoding,
            other.metadata,
        )


class Message(NamedTuple):
    """One message; its channel is None where the record that describes it is lost; times in ns."""

    channel: ChannelInfo | None
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes


class Attachment(NamedTuple):
    """A file inside a file."""

    log_time_ns: int
    create_time_ns: int
    name: str
    media_type: str
    data: bytes


class Metadata(NamedTuple):
    """A metadata record."""

    name: str
    content: dict[str, str]


class Private(NamedTuple):
    """Another program's record."""

    opcode: int
    content: bytes


class Fields:
    """Takes fields from a record, one after the other."""

    def __init__(self, content: bytes) -> None:
        """Start at the first byte."""
        self._content = content
        self.position = 0

    def numbers(self, code: str) -> tuple[int, ...]:
        """Take numbers by struct's code.

        Raises:
            RecordError: if they lie beyond the record's end.
        """
        size = struct.calcsize("<" + code)
        found = struct.unpack("<" + code, self.take(size))
        return tuple(int(value) for value in found)

    def take(self, size: int) -> bytes:
        """Take bytes.

        Raises:
            RecordError: if they lie beyond the record's end.
        """
        end = self.position + size
        if end > len(self._content):
            raise RecordError(f"expected {size} bytes at {self.position} of {len(self._content)}")
        found = self._content[self.position : end]
        self.position = end
        return found

    def sized(self, code: str = "I") -> bytes:
        """Take bytes behind their number."""
        (size,) = self.numbers(code)
        return self.take(size)

    def text(self) -> str:
        """Take a string.

        Raises:
            RecordError: if it is no UTF-8.
        """
        try:
            return self.sized().decode()
        except UnicodeDecodeError as error:
            raise RecordError(str(error)) from error

    def texts(self) -> dict[str, str]:
        """Take a table of strings."""
        inner = Fields(self.sized())
        found = {}
        while inner.left:
            key = inner.text()
            found[key] = inner.text()
        return found

    @property
    def left(self) -> int:
        """Number of bytes that are not taken."""
        return len(self._content) - self.position


def schema_of(content: bytes) -> Schema:
    """Parse a Schema record.

    Raises:
        RecordError: if it is none.
    """
    fields = Fields(content)
    (number,) = fields.numbers("H")
    return Schema(number, fields.text(), fields.text(), fields.sized())


def channel_of(content: bytes, schemas: dict[int, Schema]) -> tuple[int, ChannelInfo]:
    """Parse a Channel record.

    Args:
        content: of the record.
        schemas: by number.

    Returns:
        Its number and content; a channel whose schema is lost has none.

    Raises:
        RecordError: if it is none.
    """
    fields = Fields(content)
    number, schema = fields.numbers("HH")
    topic, encoding = fields.text(), fields.text()
    return number, ChannelInfo(topic, schemas.get(schema, NO_SCHEMA), encoding, fields.texts())


def attachment_of(content: bytes) -> Attachment:
    """Parse an Attachment record; its own checksum must hold.

    Raises:
        RecordError: if it is none or damaged.
    """
    fields = Fields(content)
    log_time, create_time = fields.numbers("QQ")
    found = Attachment(log_time, create_time, fields.text(), fields.text(), fields.sized("Q"))
    end = fields.position
    (checksum,) = fields.numbers("I")
    if checksum and crc32(content[:end]) != checksum:
        raise RecordError("the attachment's checksum does not hold")
    return found


def metadata_of(content: bytes) -> Metadata:
    """Parse a Metadata record.

    Raises:
        RecordError: if it is none.
    """
    fields = Fields(content)
    return Metadata(fields.text(), fields.texts())


def allowed(opcode: int, size: int) -> bool:
    """Whether a record may have this kind and size.

    Args:
        opcode: its kind.
        size: of its content [bytes].
    """
    if opcode in SIZES:
        return size == SIZES[opcode]
    return 0 < opcode <= LAST_OPCODE or opcode >= PRIVATE


def fills(opcode: int, content: bytes) -> bool:
    """Whether the fields of a record fill it to the last byte, which damage seldom leaves so.

    Args:
        opcode: its kind; only those whose fields have lengths of their own can tell.
        content: of the record.
    """
    fields = Fields(content)
    try:
        if opcode == Opcode.SCHEMA:
            fields.numbers("H")
            name, _, _ = fields.text(), fields.text(), fields.sized()
            filled = bool(name)
        elif opcode == Opcode.CHANNEL:
            fields.numbers("HH")
            topic, _, _ = fields.text(), fields.text(), fields.texts()
            filled = bool(topic)
        elif opcode == Opcode.METADATA:
            name, _ = fields.text(), fields.texts()
            filled = bool(name)
        elif opcode == Opcode.ATTACHMENT:
            attachment_of(content)
            filled = bool(content[-4:] != bytes(4))
            fields.take(len(content))
        else:
            return False
    except RecordError:
        return False
    return filled and not fields.left
