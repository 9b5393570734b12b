"""CDR of fixed-size messages as numpy records: what a 1 kHz topic costs is a copy.

A message whose sequences and strings have known lengths always has the same bytes but for its
numbers. A Layout computes where they are, once, from the message's own definition; reading is
then a view and writing an assignment, instead of building Python objects (OMG DDS-XTypes, CDR
version 1, little endian: primitives align to their size from the end of the 4-byte header).
"""

from __future__ import annotations

import re
from importlib import import_module
from struct import Struct
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

STAMP, STAMP_FIELD = Struct("<iI"), "header.stamp.sec"
HEADER = b"\x00\x01\x00\x00"
PRIMITIVES = {
    "boolean": "?",
    "octet": "u1",
    "uint8": "u1",
    "int8": "i1",
    "uint16": "<u2",
    "int16": "<i2",
    "uint32": "<u4",
    "int32": "<i4",
    "uint64": "<u8",
    "int64": "<i8",
    "float": "<f4",
    "double": "<f8",
}


class LayoutError(ValueError):
    """A message does not have the lengths that its layout is for."""


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
        self._names: list[str] = []
        self._formats: list[Any] = []
        self._offsets: list[int] = []
        self._constants: list[tuple[int, bytes]] = [(0, HEADER)]
        end = self._walk(msg_type, "", 4)
        for name, (first, count) in (joined or {}).items():
            at = self._names.index(first)
            self._names.append(name)
            self._formats.append((self._formats[at], (count,)))
            self._offsets.append(self._offsets[at])
        self.size = end
        self.dtype = np.dtype(
            {
                "names": self._names,
                "formats": self._formats,
                "offsets": self._offsets,
                "itemsize": end,
            }
        )
        self._stamp_at = dict(zip(self._names, self._offsets, strict=True)).get(STAMP_FIELD, 0)
        self.compiled_dtype = _for_compiled_code(self.dtype)
        template = bytearray(end)
        fixed = np.zeros(end, dtype=np.bool_)
        for offset, value in self._constants:
            template[offset : offset + len(value)] = value
            fixed[offset : offset + len(value)] = True
        self._template = bytes(template)
        # As integers, a whole message is compared in one go: half the cost of a numpy index.
        self._fixed = int.from_bytes((255 * fixed.astype(np.uint8)).tobytes(), "little")
        self._expected = int.from_bytes(self._template, "little") & self._fixed

    def _walk(self, msg_type: Any, prefix: str, offset: int) -> int:
        for name, kind in msg_type.get_fields_and_field_types().items():
            offset = self._field(prefix + name, kind, offset)
        return offset

    def _field(self, name: str, kind: str, offset: int) -> int:
        if kind in PRIMITIVES:
            return self._numbers(name, PRIMITIVES[kind], None, offset)
        if kind == "string":
            text = self._strings.get(name, "").encode() + b"\x00"
            offset = self._constant(np.uint32(len(text)), offset)
            self._constants.append((offset, text))
            return offset + len(text)
        fixed = re.fullmatch(r"(\w+)\[(\d+)\]", kind)
        if fixed:
            return self._numbers(name, PRIMITIVES[fixed[1]], int(fixed[2]), offset)
        sequence = re.fullmatch(r"sequence<(\w+)>", kind)
        if sequence:
            if name not in self._lengths:
                raise LayoutError(f"{self.msg_type.__name__}.{name}: expected a length for it")
            offset = self._constant(np.uint32(self._lengths[name]), offset)
            return self._numbers(name, PRIMITIVES[sequence[1]], self._lengths[name], offset)
        package, _, nested = kind.partition("/")
        return self._walk(getattr(import_module(f"{package}.msg"), nested), name + ".", offset)

    def _constant(self, value: np.uint32, offset: int) -> int:
        offset = _align(offset, 4)
        self._constants.append((offset, value.astype("<u4").tobytes()))
        return offset + 4

    def _numbers(self, name: str, code: str, count: int | None, offset: int) -> int:
        size = np.dtype(code).itemsize
        if count == 0:
            return offset
        offset = _align(offset, size)
        self._names.append(name)
        self._formats.append(code if count is None else (code, (count,)))
        self._offsets.append(offset)
        return offset + size * (count or 1)

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
        deserialised and laid out anew.

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
        for name in self._string_names():
            owner, _, last = name.rpartition(".")
            target = message
            for part in owner.split(".") if owner else []:
                target = getattr(target, part)
            setattr(target, last, self._strings.get(name, ""))
        return bytes(serialize_message(message))

    def stamp_of(self, laid_out: bytes) -> int:
        """Header's time of a message in this layout [ns]."""
        seconds, nanoseconds = STAMP.unpack_from(laid_out, self._stamp_at)
        return int(seconds) * 1_000_000_000 + int(nanoseconds)

    def matches(self, raw: bytes) -> bool:
        """Whether a message has just the lengths and strings of this layout."""
        if not 0 <= len(raw) - self.size < 4:
            return False
        return int.from_bytes(raw, "little") & self._fixed == self._expected

    def strings(self, raw: bytes) -> dict[str, str]:
        """Return the message's strings by dotted name, e.g. to check a frame; slow."""
        message = deserialize_message(raw, self.msg_type)
        return {name: _follow(message, name) for name in self._string_names()}

    def _check_lengths(self, message: Any) -> None:
        for name, length in self._lengths.items():
            actual = len(_follow(message, name))
            if actual != length:
                raise LayoutError(
                    f"{self.msg_type.__name__}.{name}: expected {length} values, got {actual}"
                )

    def _string_names(self, msg_type: Any = None, prefix: str = "") -> list[str]:
        found = []
        for name, kind in (msg_type or self.msg_type).get_fields_and_field_types().items():
            if kind == "string":
                found.append(prefix + name)
            elif "/" in kind and "<" not in kind and "[" not in kind:
                package, _, nested = kind.partition("/")
                inner = getattr(import_module(f"{package}.msg"), nested)
                found += self._string_names(inner, f"{prefix}{name}.")
        return found


class Record:
    """A serialised message whose numbers are written in place: `record["tension"][:] = tau`."""

    def __init__(self, layout: Layout, template: bytes) -> None:
        """Copy a template that holds the layout's constants, so that numbers are aligned.

        CDR aligns from the end of its 4-byte header: that place is put on a multiple of 8, as
        compiled code wants arrays.
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

    def stamp(self, time_ns: int, prefix: str = "header.stamp") -> None:
        """Write a time."""
        self._views[prefix + ".sec"][0] = time_ns // 1_000_000_000
        self._views[prefix + ".nanosec"][0] = time_ns % 1_000_000_000

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
    return np.dtype(
        {
            "names": list(dtype.names or ()),
            "formats": formats,
            "offsets": offsets,
            "itemsize": dtype.itemsize,
        }
    )


def _align(offset: int, size: int) -> int:
    """Next multiple of size, counted from the end of the 4-byte CDR header."""
    return 4 + -(-(offset - 4) // size) * size


def _follow(message: Any, name: str) -> Any:
    for part in name.split("."):
        message = getattr(message, part)
    return message
