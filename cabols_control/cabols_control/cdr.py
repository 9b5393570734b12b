# SPDX-License-Identifier: Apache-2.0
"""Where the numbers of a serialised message lie: one engine for bags and for the live graph.

Messages whose strings and sequence lengths are the same differ in their numbers only, which then
lie at the same bytes (OMG DDS-XTypes, CDR version 1: primitives align to their size from the end
of the 4-byte header). So a message definition together with those lengths and strings gives one
numpy record type for all such messages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

HEADER_SIZE = 4
LITTLE_ENDIAN_HEADER = b"\x00\x01\x00\x00"
SEQUENCE = -1
"""Count of a field whose length stands in the message."""
STRING = "string"
NUMBERS = {
    "bool": "?",
    "boolean": "?",
    "byte": "u1",
    "char": "u1",
    "octet": "u1",
    "uint8": "u1",
    "int8": "i1",
    "uint16": "u2",
    "int16": "i2",
    "uint32": "u4",
    "int32": "i4",
    "uint64": "u8",
    "int64": "i8",
    "float32": "f4",
    "float": "f4",
    "float64": "f8",
    "double": "f8",
}
"""numpy's code of each primitive, by its name in a .msg file and in IDL."""


class LayoutError(ValueError):
    """A message has no fixed layout, or not the one that was expected of it."""


@dataclass(frozen=True)
class Field:
    """One field of a message definition.

    Attributes:
        name: its name.
        base: primitive or "string" by name; the fields of a nested message.
        count: None: a single value; SEQUENCE; otherwise the length of a fixed array.
    """

    name: str
    base: str | tuple[Field, ...]
    count: int | None = None


class Content(Protocol):
    """Source of what is the same in all messages of one layout."""

    def length(self, name: str, offset: int, /) -> int:
        """Return the length of a sequence.

        Args:
            name: dotted name of its field, for messages.
            offset: of the aligned 4-byte length, from the start of the header [bytes].
        """

    def text(self, name: str, offset: int, /) -> bytes:
        """Return a string with its closing zero byte.

        Args:
            name: dotted name of its field, for messages.
            offset: of the aligned 4-byte length before it, from the start of the header [bytes].
        """


def align(offset: int, size: int) -> int:
    """Return the next multiple of size, counted from the end of the 4-byte CDR header.

    Args:
        offset: in the message, from the start of the header, as the answer [bytes].
        size: of the value that is aligned [bytes].
    """
    return HEADER_SIZE - (HEADER_SIZE - offset) // size * size


class Places:
    """Where numbers and constants lie in one message.

    Attributes:
        names: dotted names of the fields that hold numbers.
        formats: numpy's formats of them.
        offsets: their places from the start of the header [bytes].
        constants: lengths and strings, as offset and bytes.
        texts: strings by dotted name; a list of them for an array.
        empty: numpy's code of arrays that have no elements, by dotted name.
        end: size of the message [bytes].
    """

    def __init__(self, fields: Sequence[Field], content: Content, order: str = "<") -> None:
        """Lay out a message.

        Args:
            fields: its definition.
            content: lengths and strings.
            order: "<" for little endian, ">" for big endian.

        Raises:
            LayoutError: for an array of messages, an unknown primitive, or as `content` raises.
        """
        self.names: list[str] = []
        self.formats: list[Any] = []
        self.offsets: list[int] = []
        self.constants: list[tuple[int, bytes]] = []
        self.texts: dict[str, str | list[str]] = {}
        self.empty: dict[str, str] = {}
        self._content = content
        self._order = order
        self.end = self._message(fields, "", HEADER_SIZE)

    def dtype(self, size: int) -> Any:
        """Return the record type of a whole message of that many bytes, header included."""
        return record_type(self.names, self.formats, self.offsets, size)

    def _message(self, fields: Sequence[Field], prefix: str, offset: int) -> int:
        for field in fields:
            offset = self._field(field, prefix + field.name, offset)
        return offset

    def _field(self, field: Field, name: str, offset: int) -> int:
        base, count = field.base, field.count
        if isinstance(base, tuple):
            if count is not None:
                raise LayoutError(f"{name}: an array of messages")
            return self._message(base, name + ".", offset)
        if count == SEQUENCE:
            count = self._content.length(name, align(offset, 4))
            offset = self._size(count, offset)
        if base != STRING:
            return self._numbers(name, base, count, offset)
        if count is None:
            self.texts[name], offset = self._text(name, offset)
            return offset
        texts = []
        for _ in range(count):
            text, offset = self._text(name, offset)
            texts.append(text)
        self.texts[name] = texts
        return offset

    def _text(self, name: str, offset: int) -> tuple[str, int]:
        content = self._content.text(name, align(offset, 4))
        if content[-1:] != b"\x00":
            raise LayoutError(f"{name}: a string without its closing zero byte")
        offset = self._size(len(content), offset)
        self.constants.append((offset, content))
        return content[:-1].decode(), offset + len(content)

    def _size(self, count: int, offset: int) -> int:
        offset = align(offset, 4)
        self.constants.append((offset, np.array(count, self._order + "u4").tobytes()))
        return offset + 4

    def _numbers(self, name: str, base: str, count: int | None, offset: int) -> int:
        if base not in NUMBERS:
            raise LayoutError(f"{name}: a {base}")
        if count == 0:
            self.empty[name] = NUMBERS[base]
            return offset
        code = np.dtype(self._order + NUMBERS[base])
        offset = align(offset, code.itemsize)
        self.names.append(name)
        self.formats.append(code if count is None else (code, (count,)))
        self.offsets.append(offset)
        return offset + code.itemsize * (count or 1)


def record_type(names: list[str], formats: list[Any], offsets: list[int], size: int) -> Any:
    """Return numpy's type of a record of `size` bytes with these fields.

    Args:
        names: of the fields.
        formats: numpy's format of each.
        offsets: of each from the record's start [bytes].
        size: of the whole record [bytes].
    """
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})
