"""Many serialised messages of one type as numpy arrays, without an object per message.

Messages whose strings and sequence lengths are the same differ in their numbers only, which then
lie at the same bytes (OMG DDS-XTypes, CDR version 1: primitives align to their size from the end
of the 4-byte header). So the first message gives the layout of all that agree with it in size and
in those constant bytes; they are joined and viewed as one structured array. What agrees with
nothing is deserialised one by one.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

Column = npt.NDArray[Any] | list[Any]

MAX_LAYOUTS = 64
NUMBERS = {
    "bool": "?",
    "byte": "u1",
    "char": "u1",
    "uint8": "u1",
    "int8": "i1",
    "uint16": "u2",
    "int16": "i2",
    "uint32": "u4",
    "int32": "i4",
    "uint64": "u8",
    "int64": "i8",
    "float32": "f4",
    "float64": "f8",
}


class NoLayoutError(ValueError):
    """A message has no fixed layout, or its bytes are no such message."""


@dataclass
class _Piece:
    """Columns of some of the messages."""

    rows: npt.NDArray[np.intp]
    columns: dict[str, Column]


class _Layout:
    """Where numbers and constants lie in one message."""

    def __init__(self, fields: dict[str, Any], type_name: str, raw: bytes) -> None:
        if len(raw) < 4 or raw[0] != 0 or raw[1] > 1:
            raise NoLayoutError("expected a CDR header")
        self._fields = fields
        self._raw = raw
        self._order = "<" if raw[1] else ">"
        self._formats: dict[str, Any] = {}
        self._offsets: list[int] = []
        self._fixed = np.zeros(len(raw), np.bool_)
        self._fixed[:2] = True
        self.texts: dict[str, Any] = {}
        self.empty: dict[str, npt.NDArray[Any]] = {}
        try:
            end = self._walk(type_name, "", 4)
        except (struct.error, UnicodeDecodeError) as error:
            raise NoLayoutError(str(error)) from error
        if not 0 <= len(raw) - end < 4:
            raise NoLayoutError(f"expected {end} bytes, got {len(raw)}")
        self.dtype = np.dtype(
            {
                "names": list(self._formats),
                "formats": list(self._formats.values()),
                "offsets": self._offsets,
                "itemsize": len(raw),
            }
        )
        self.fixed = np.flatnonzero(self._fixed)
        self.constants = np.frombuffer(raw, np.uint8)[self.fixed]

    def _walk(self, type_name: str, prefix: str, offset: int) -> int:
        for name, (kind, detail) in self._fields[type_name][1]:
            full = prefix + name
            if kind == Nodetype.BASE:
                offset = self._base(full, detail[0], offset)
            elif kind == Nodetype.NAME:
                offset = self._walk(detail, full + ".", offset)
            else:
                (inner_kind, inner), count = detail
                if inner_kind != Nodetype.BASE:
                    raise NoLayoutError(f"{full}: an array of messages")
                if kind == Nodetype.SEQUENCE:
                    count, offset = self._constant(offset)
                offset = self._array(full, inner[0], count, offset)
        return offset

    def _base(self, name: str, base: str, offset: int) -> int:
        if base == "string":
            self.texts[name], offset = self._text(offset)
            return offset
        return self._numbers(name, base, None, offset)

    def _array(self, name: str, base: str, count: int, offset: int) -> int:
        if base == "string":
            texts = []
            for _ in range(count):
                text, offset = self._text(offset)
                texts.append(text)
            self.texts[name] = texts
            return offset
        return self._numbers(name, base, count, offset)

    def _numbers(self, name: str, base: str, count: int | None, offset: int) -> int:
        if base not in NUMBERS:
            raise NoLayoutError(f"{name}: a {base}")
        code = np.dtype(NUMBERS[base]).newbyteorder(self._order)  # type: ignore[arg-type]
        if count == 0:
            self.empty[name] = np.zeros(0, NUMBERS[base])
            return offset
        offset = _align(offset, code.itemsize)
        self._formats[name] = code if count is None else (code, (count,))
        self._offsets.append(offset)
        return offset + code.itemsize * (count or 1)

    def _text(self, offset: int) -> tuple[str, int]:
        size, offset = self._constant(offset)
        end = offset + size
        if end > len(self._raw):
            raise NoLayoutError("a string beyond the end")
        self._fixed[offset:end] = True
        return self._raw[offset:end].rstrip(b"\x00").decode(), end

    def _constant(self, offset: int) -> tuple[int, int]:
        offset = _align(offset, 4)
        (value,) = struct.unpack_from(self._order + "I", self._raw, offset)
        if value > len(self._raw):
            raise NoLayoutError("a length beyond the end")
        self._fixed[offset : offset + 4] = True
        return int(value), offset + 4

    def columns(self, block: npt.NDArray[np.uint8]) -> dict[str, Column]:
        """Columns of the messages in a (k, size) block."""
        count = len(block)
        records = np.ascontiguousarray(block).view(self.dtype)[:, 0]
        found: dict[str, Column] = {}
        for name in self.dtype.names or ():
            column = records[name]
            found[name] = column.astype(column.dtype.newbyteorder("="))
        for name, value in self.empty.items():
            found[name] = np.zeros((count, 0), value.dtype)
        for name, text in self.texts.items():
            found[name] = [text] * count
        return found


def decode(raws: list[bytes], type_name: str, store: Typestore) -> dict[str, Column]:
    """Decode all messages of one topic.

    Args:
        raws: serialised messages.
        type_name: their type.
        store: that knows the type.

    Returns:
        By dotted field name: (k,) or (k, n) array for numbers; a list of strings for text; a list
        of arrays where the length changes from message to message; a list of lists of rosbags'
        message objects for arrays of messages.

    Raises:
        SerdeError: rosbags', if a message cannot be deserialised.
    """
    pieces: list[_Piece] = []
    rest: list[npt.NDArray[np.intp]] = []
    sizes = np.array([len(raw) for raw in raws])
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        joined = b"".join(raws) if rows.size == len(raws) else b"".join(raws[i] for i in rows)
        block = np.frombuffer(joined, np.uint8).reshape(rows.size, size)
        while rows.size:
            try:
                if len(pieces) >= MAX_LAYOUTS:
                    raise NoLayoutError("too many layouts")
                layout = _Layout(store.fielddefs, type_name, raws[rows[0]])
            except NoLayoutError:
                rest.append(rows)
                break
            same = (block[:, layout.fixed] == layout.constants).all(axis=1)
            pieces.append(_Piece(rows[same], layout.columns(block if same.all() else block[same])))
            rows, block = rows[~same], block[~same]
    if rest:
        rows = np.sort(np.concatenate(rest))
        pieces.append(_Piece(rows, _deserialise([raws[i] for i in rows], type_name, store)))
    return _merge(pieces, len(raws))


def _deserialise(raws: list[bytes], type_name: str, store: Typestore) -> dict[str, Column]:
    found: dict[str, list[Any]] = {}
    numeric: dict[str, str] = {}
    for raw in raws:
        message = store.deserialize_cdr(raw, type_name)
        _flatten(message, type_name, "", store, found, numeric)
    return {
        name: _stack(values, numeric[name]) if name in numeric else values
        for name, values in found.items()
    }


def _flatten(
    message: Any,
    type_name: str,
    prefix: str,
    store: Typestore,
    found: dict[str, list[Any]],
    numeric: dict[str, str],
) -> None:
    for name, (kind, detail) in store.fielddefs[type_name][1]:
        value = getattr(message, name)
        full = prefix + name
        if kind == Nodetype.NAME:
            _flatten(value, str(detail), full + ".", store, found, numeric)
            continue
        found.setdefault(full, []).append(value)
        base: Any = detail if kind == Nodetype.BASE else detail[0][1]
        if isinstance(base, tuple) and base[0] in NUMBERS:
            numeric[full] = NUMBERS[base[0]]


def _stack(values: list[Any], code: str) -> Column:
    arrays = [np.asarray(value, code) for value in values]
    if len({array.shape for array in arrays}) == 1:
        return np.stack(arrays)
    return arrays


def _merge(pieces: list[_Piece], count: int) -> dict[str, Column]:
    """Put the columns of all pieces in the order of the messages."""
    if len(pieces) == 1:
        return pieces[0].columns
    return {
        name: _merge_column([(p.rows, p.columns[name]) for p in pieces], count)
        for name in pieces[0].columns
    }


def _merge_column(parts: list[tuple[npt.NDArray[np.intp], Column]], count: int) -> Column:
    arrays = [(rows, part) for rows, part in parts if isinstance(part, np.ndarray)]
    if len(arrays) == len(parts) and len({part.shape[1:] for _, part in arrays}) == 1:
        first = arrays[0][1]
        whole = np.empty((count, *first.shape[1:]), first.dtype)
        for rows, part in arrays:
            whole[rows] = part
        return whole
    merged: list[Any] = [None] * count
    for rows, column in parts:
        for row, value in zip(rows.tolist(), column, strict=True):
            merged[row] = value
    return merged


def _align(offset: int, size: int) -> int:
    """Next multiple of size, counted from the end of the 4-byte CDR header."""
    return 4 + -(-(offset - 4) // size) * size
