# SPDX-License-Identifier: Apache-2.0
"""CDR of fixed-size messages as numpy records: what a 1 kHz topic costs is a copy.

A Layout computes once, from rclpy's definition of a message and the lengths of its sequences,
where the numbers are (cabols_control.cdr); reading is then a view and writing an assignment,
instead of building Python objects.
"""

from __future__ import annotations

import re
from importlib import import_module
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from cabols_control.cdr import (
    LITTLE_ENDIAN_HEADER,
    SEQUENCE,
    STRING,
    Field,
    LayoutError,
    Places,
    record_type,
)
from cabols_control.stamps import HEADER_STAMP, LAST_S, SECOND_NS, STAMP

_ARRAY = re.compile(r"(?:sequence<)?([\w/]+)(?:>|\[(\d+)\])")


class GivenContent:
    """Lengths and strings that are known beforehand (cdr.Content)."""

    def __init__(self, owner: str, lengths: dict[str, int], strings: dict[str, str]) -> None:
        """Take them by dotted field name; `owner` is for error texts."""
        self._owner = owner
        self._lengths = lengths
        self._strings = strings

    def length(self, name: str, _offset: int, /) -> int:
        """Return the length of a sequence."""
        if name not in self._lengths:
            raise LayoutError(f"{self._owner}.{name}: expected a length for it")
        return self._lengths[name]

    def text(self, name: str, _offset: int, /) -> bytes:
        """Return a string, by default the empty one."""
        return self._strings.get(name, "").encode() + b"\x00"


def fields_of(msg_type: Any) -> tuple[Field, ...]:
    """Translate rclpy's definition of a message class."""
    found = []
    for name, kind in msg_type.get_fields_and_field_types().items():
        array = _ARRAY.fullmatch(kind)
        base = array[1] if array else kind
        count = None if array is None else int(array[2] or SEQUENCE)
        package, slash, nested = base.partition("/")
        inner = fields_of(getattr(import_module(f"{package}.msg"), nested)) if slash else base
        found.append(Field(name, inner, count))
    return tuple(found)


def string_names(fields: tuple[Field, ...], prefix: str = "") -> list[str]:
    """Return the dotted names of all single strings of a message."""
    found = []
    for field in fields:
        if field.base == STRING and field.count is None:
            found.append(prefix + field.name)
        elif isinstance(field.base, tuple) and field.count is None:
            found += string_names(field.base, f"{prefix}{field.name}.")
    return found


class Layout:
    """Byte layout of one message type with fixed lengths.

    Attributes:
        msg_type: the message class.
        dtype: numpy record of the whole serialised message; nested fields as `header.stamp.sec`.
        compiled_dtype: the same with uint8 for boolean, of which numba's records have no arrays.
        size: bytes.
    """

    def __init__(
        self,
        msg_type: type,
        lengths: dict[str, int] | None = None,
        strings: dict[str, str] | None = None,
        joined: dict[str, tuple[str, int]] | None = None,
    ) -> None:
        """Lay out a message.

        Args:
            msg_type: message class; sequences must be of primitives.
            lengths: length of each sequence, by dotted field name.
            strings: value of each string, by dotted field name; default empty.
            joined: other names for runs of equal neighbours, as first field and count, e.g.
                {"wrench": ("wrench.force.x", 6)}.
        """
        self.msg_type = msg_type
        self._lengths = lengths or {}
        self._strings = strings or {}
        fields = fields_of(msg_type)
        self._text_names = string_names(fields)
        content = GivenContent(msg_type.__name__, self._lengths, self._strings)
        places = Places(fields, content)
        stamp_field = f"{HEADER_STAMP}.sec"
        self._stamp_at = dict(zip(places.names, places.offsets, strict=True)).get(stamp_field, 0)
        for name, (first, count) in (joined or {}).items():
            at = places.names.index(first)
            places.names.append(name)
            places.formats.append((places.formats[at], (count,)))
            places.offsets.append(places.offsets[at])
        self.size = end = places.end
        self.dtype = places.dtype(end)
        self.compiled_dtype = _for_compiled_code(self.dtype)
        template = bytearray(end)
        fixed = np.zeros(end, dtype=np.bool_)
        for offset, value in ((0, LITTLE_ENDIAN_HEADER), *places.constants):
            template[offset : offset + len(value)] = value
            fixed[offset : offset + len(value)] = True
        self._template = bytes(template)
        # As integers, a whole message is compared in one go: half the cost of a numpy index.
        self._fixed = int.from_bytes((255 * fixed.astype(np.uint8)).tobytes(), "little")
        self._expected = int.from_bytes(self._template, "little") & self._fixed

    def record(self) -> Record:
        """Return a writable message, all numbers zero."""
        return Record(self, self._template)

    def read(self, raw: bytes) -> Any:
        """View the numbers of a serialised message.

        Args:
            raw: as taken from DDS.

        Returns:
            numpy record, fields by dotted name.

        Raises:
            LayoutError: if a sequence has another length, or the bytes are no such message.
        """
        return np.frombuffer(self.laid_out(raw), self.dtype, 1)[0]

    def laid_out(self, raw: bytes) -> bytes:
        """Return the bytes of a message in this layout: its own, as a rule.

        A message from elsewhere may have other strings or the other byte order: it is then
        deserialised and laid out again.

        Raises:
            LayoutError: if a sequence has another length, or the bytes are no such message.
        """
        if self.matches(raw):
            return raw
        try:
            message = deserialize_message(raw, self.msg_type)
        except Exception as error:
            raise LayoutError(f"{self.msg_type.__name__}: not readable ({error})") from error
        self._check_lengths(message)
        for name in self._text_names:
            owner, _, last = name.rpartition(".")
            target = message
            for part in owner.split(".") if owner else []:
                target = getattr(target, part)
            setattr(target, last, self._strings.get(name, ""))
        return bytes(serialize_message(message))

    def offset_of(self, name: str) -> int:
        """Place of a field from the start of the serialised message [bytes]."""
        return int(self.dtype.fields[name][1])

    def stamp_of(self, laid_out: bytes) -> int:
        """Header's time of a message in this layout [ns]."""
        seconds, nanoseconds = STAMP.unpack_from(laid_out, self._stamp_at)
        return int(seconds) * SECOND_NS + int(nanoseconds)

    def matches(self, raw: bytes) -> bool:
        """Whether a message has just the lengths and strings of this layout."""
        if not 0 <= len(raw) - self.size < 4:
            return False
        return int.from_bytes(raw, "little") & self._fixed == self._expected

    def strings(self, raw: bytes) -> dict[str, str]:
        """Return the message's strings by dotted name, e.g. to check a frame; slow."""
        message = deserialize_message(raw, self.msg_type)
        return {name: _follow(message, name) for name in self._text_names}

    def _check_lengths(self, message: Any) -> None:
        for name, length in self._lengths.items():
            actual = len(_follow(message, name))
            if actual != length:
                raise LayoutError(
                    f"{self.msg_type.__name__}.{name}: expected {length} values, got {actual}"
                )


class Record:
    """A serialised message whose numbers are written in place: `record["tension"][:] = tau`."""

    def __init__(self, layout: Layout, template: bytes) -> None:
        """Copy a template that holds the layout's constants, so that numbers are aligned.

        CDR aligns from the end of its 4-byte header: that place is put on a multiple of 8, as
        compiled code needs for arrays.
        """
        store = np.zeros(len(template) + 16, dtype=np.uint8)
        start = (4 - store.ctypes.data) % 8
        self._bytes = store[start : start + len(template)]
        self._bytes[:] = np.frombuffer(template, np.uint8)
        whole = self._bytes.view(layout.dtype)
        self.compiled = self._bytes.view(layout.compiled_dtype)
        """(1,) record of the whole message, for compiled code."""
        self._views = {name: whole[name][0:1].reshape(-1) for name in layout.dtype.names or ()}

    def __getitem__(self, name: str) -> Any:
        """Return the writable array of one field; scalars have length one."""
        return self._views[name]

    def stamp(self, time_ns: int, prefix: str = HEADER_STAMP) -> None:
        """Write a time; the last one that a stamp holds, if it is later."""
        self._views[prefix + ".sec"][0] = min(time_ns // SECOND_NS, LAST_S)
        self._views[prefix + ".nanosec"][0] = time_ns % SECOND_NS

    def raw(self) -> bytes:
        """Return the bytes to publish."""
        return self._bytes.tobytes()


def _for_compiled_code(dtype: Any) -> Any:
    """Return a record's dtype with uint8 in the place of boolean."""
    formats, offsets = [], []
    for name in dtype.names or ():
        kind, offset = dtype.fields[name][:2]
        base, shape = kind.subdtype or (kind, ())
        formats.append((np.dtype(np.uint8) if base == np.bool_ else base, shape))
        offsets.append(offset)
    return record_type(list(dtype.names or ()), formats, offsets, dtype.itemsize)


def _follow(message: Any, name: str) -> Any:
    for part in name.split("."):
        message = getattr(message, part)
    return message
