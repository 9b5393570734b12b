# SPDX-License-Identifier: Apache-2.0
"""Many serialised messages of one type as numpy arrays, without an object per message.

The first message gives the layout (cabols_control.cdr) of all that agree with it in size, strings
and sequence lengths; they are joined and viewed as one structured array. Messages that agree with
no layout are deserialised one by one.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from cabols_control.cdr import HEADER_SIZE, NUMBERS, SEQUENCE, Field, LayoutError, Places

Column = npt.NDArray[Any] | list[Any]

MAX_LAYOUTS = 64


@dataclass
class Piece:
    """Columns of some of the messages.

    Attributes:
        rows: (k,) which messages.
        columns: by dotted field name, of k rows.
    """

    rows: npt.NDArray[np.intp]
    columns: dict[str, Column]


class _FirstMessage:
    """Lengths and strings as one message has them (cdr.Content)."""

    def __init__(self, raw: bytes, order: str) -> None:
        self._raw = raw
        self._size = struct.Struct(order + "I")

    def length(self, name: str, offset: int) -> int:
        if offset + self._size.size > len(self._raw):
            raise LayoutError(f"{name}: a length beyond the end")
        (value,) = self._size.unpack_from(self._raw, offset)
        if value > len(self._raw):
            raise LayoutError(f"{name}: a length of {value} in {len(self._raw)} bytes")
        return int(value)

    def text(self, name: str, offset: int) -> bytes:
        end = offset + self._size.size + self.length(name, offset)
        if end > len(self._raw):
            raise LayoutError(f"{name}: a string beyond the end")
        return self._raw[offset + self._size.size : end]


class _Layout:
    """Where numbers and constants lie in one message."""

    def __init__(self, fields: tuple[Field, ...], raw: bytes) -> None:
        if len(raw) < HEADER_SIZE or raw[0] != 0 or raw[1] > 1:
            raise LayoutError("expected a CDR header")
        order = "<" if raw[1] else ">"
        try:
            places = Places(fields, _FirstMessage(raw, order), order)
        except UnicodeDecodeError as error:
            raise LayoutError(str(error)) from error
        if not 0 <= len(raw) - places.end < 4:
            raise LayoutError(f"expected {places.end} bytes, got {len(raw)}")
        self._texts, self._empty = places.texts, places.empty
        self.dtype = places.dtype(len(raw))
        fixed = np.zeros(len(raw), np.bool_)
        fixed[:2] = True
        for offset, value in places.constants:
            fixed[offset : offset + len(value)] = True
        self.fixed = np.flatnonzero(fixed)
        self.constants = np.frombuffer(raw, np.uint8)[self.fixed]

    def columns(self, block: npt.NDArray[np.uint8]) -> dict[str, Column]:
        """Columns of the messages in a (k, size) block."""
        count = len(block)
        records = np.ascontiguousarray(block).view(self.dtype)[:, 0]
        found: dict[str, Column] = {}
        for name in self.dtype.names or ():
            column = records[name]
            found[name] = column.astype(column.dtype.newbyteorder("="))
        for name, code in self._empty.items():
            found[name] = np.zeros((count, 0), code)
        for name, text in self._texts.items():
            found[name] = [text] * count
        return found


def decode(raws: list[bytes], type_name: str, store: Typestore) -> dict[str, Column]:
    """Decode all messages of one topic.

    Args:
        raws: serialised messages.
        type_name: their type.
        store: type store that holds the type.

    Returns:
        By dotted field name: (k,) or (k, n) array for numbers; a list of strings for text; a list
        of arrays where the length changes from message to message; a list of lists of rosbags'
        message objects for arrays of messages.

    Raises:
        SerdeError: rosbags', if a message cannot be deserialised.
    """
    pieces: list[Piece] = []
    rest: list[npt.NDArray[np.intp]] = []
    sizes = np.array([len(raw) for raw in raws])
    fields = _fields(type_name, store)
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        joined = b"".join(raws) if rows.size == len(raws) else b"".join(raws[i] for i in rows)
        block = np.frombuffer(joined, np.uint8).reshape(rows.size, size)
        while rows.size:
            try:
                if len(pieces) >= MAX_LAYOUTS:
                    raise LayoutError("too many layouts")
                layout = _Layout(fields, raws[rows[0]])
            except LayoutError:
                rest.append(rows)
                break
            same = (block[:, layout.fixed] == layout.constants).all(axis=1)
            pieces.append(Piece(rows[same], layout.columns(block if same.all() else block[same])))
            rows, block = rows[~same], block[~same]
    if rest:
        rows = np.sort(np.concatenate(rest))
        pieces.append(Piece(rows, _deserialise([raws[i] for i in rows], type_name, store)))
    return merge(pieces, len(raws))


def _fields(type_name: str, store: Typestore) -> tuple[Field, ...]:
    """Translate rosbags' definition of a type."""
    found = []
    detail: Any
    for name, (kind, detail) in store.fielddefs[type_name][1]:
        single = kind in (Nodetype.BASE, Nodetype.NAME)
        (base_kind, base), length = ((kind, detail), None) if single else detail
        count = SEQUENCE if kind == Nodetype.SEQUENCE else length
        inner = _fields(base, store) if base_kind == Nodetype.NAME else base[0]
        found.append(Field(name, inner, count))
    return tuple(found)


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


def merge(pieces: list[Piece], count: int) -> dict[str, Column]:
    """Put the columns of all pieces in the order of the messages.

    Args:
        pieces: that together have each message once, and the same fields.
        count: number of all messages.
    """
    if len(pieces) == 1:
        return pieces[0].columns
    return {
        name: _merge_column([(p.rows, p.columns[name]) for p in pieces], count)
        for name in pieces[0].columns
    }


def _merge_column(parts: list[tuple[npt.NDArray[np.intp], Column]], count: int) -> Column:
    arrays = [(rows, part) for rows, part in parts if isinstance(part, np.ndarray)]
    if len(arrays) == len(parts) and len({part.shape[1:] for _, part in arrays}) == 1:
        shape = arrays[0][1].shape[1:]
        whole = np.empty((count, *shape), np.result_type(*(part for _, part in arrays)))
        for rows, part in arrays:
            whole[rows] = part
        return whole
    merged: list[Any] = [None] * count
    for rows, column in parts:
        for row, value in zip(rows.tolist(), column, strict=True):
            merged[row] = value
    return merged
