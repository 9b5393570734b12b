# SPDX-License-Identifier: Apache-2.0
"""A topic's messages as columns of one table, the same for every batch of a bag."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from cabols_control.bags.columns import Column
from cabols_control.bags.reader import LOG_TIME, PUBLISH_TIME
from cabols_control.export.units import HEADER, WRENCH, WRENCH_PARTS, column_name, with_unit

STAMP = "stamp_ns"
SEC, NANOSEC = "header.stamp.sec", "header.stamp.nanosec"
TIMES = (LOG_TIME, PUBLISH_TIME)
Values = npt.NDArray[Any]


@dataclass
class FieldShape:
    """What all messages of a bag have in common in one field.

    Attributes:
        dtype: of the numbers; None: text.
        width: elements of an array; 0: a single number or text.
    """

    dtype: np.dtype[Any] | None
    width: int

    def join(self, other: FieldShape) -> FieldShape:
        """Return what both have in common: where they differ, text."""
        if self.dtype is None or other.dtype is None or self.width != other.width:
            return FieldShape(None, 0)
        return FieldShape(np.promote_types(self.dtype, other.dtype), self.width)


@dataclass(frozen=True)
class TableColumn:
    """One column of a table.

    Attributes:
        name: with unit.
        field: dotted name of the message's field; empty: not of the message.
        unit: as it stands in the name; empty: none, or not known.
        dtype: of the numbers; None: text.
        width: elements in each row; 0: one.
    """

    name: str
    field: str
    unit: str
    dtype: np.dtype[Any] | None
    width: int = 0

    def flat(self) -> list[str]:
        """Return the names of the single columns that an array is written as, from 0."""
        if not self.width:
            return [self.name]
        if self.unit == WRENCH and self.width == len(WRENCH_PARTS):
            return [f"{self.name}_{part}" for part in WRENCH_PARTS]
        bare = self.name.removesuffix(f"_{self.unit}") if self.unit else self.name
        return [with_unit(f"{bare}_{k}", self.unit) for k in range(self.width)]


@dataclass
class Table:
    """Columns of one topic.

    Attributes:
        topic: as the bag has it, relative to /cabols.
        type_name: of its messages.
        shapes: by field, of all messages.
        rows: how many there are.
    """

    topic: str
    type_name: str
    shapes: dict[str, FieldShape] = field(default_factory=dict)
    rows: int = 0

    def learn(self, columns: Mapping[str, Column]) -> None:
        """Take a batch into account."""
        self.rows += len(columns[LOG_TIME])
        for name, column in columns.items():
            found = _shape(column)
            known = self.shapes.get(name)
            self.shapes[name] = found if known is None else known.join(found)

    @property
    def stamped(self) -> bool:
        """Whether the messages have a header."""
        return SEC in self.shapes and NANOSEC in self.shapes

    def columns(self) -> list[TableColumn]:
        """Return the columns: times, then the fields in the message's order."""
        found = [TableColumn(name, "", "ns", np.dtype(np.int64)) for name in TIMES]
        if self.stamped:
            found.append(TableColumn(STAMP, "header.stamp", "ns", np.dtype(np.int64)))
        for name, shape in self.shapes.items():
            if name in TIMES or (self.stamped and name in HEADER and HEADER[name] is None):
                continue
            bare, unit = column_name(self.type_name, name)
            column = TableColumn(with_unit(bare, unit), name, unit, shape.dtype, shape.width)
            if shape.width != 0 or shape.dtype is None or shape.dtype.itemsize:
                found.append(column)
        return found

    def values(self, columns: Mapping[str, Column]) -> dict[str, Values | list[str]]:
        """Return a batch by column name: (k,) or (k, width) numbers, or texts."""
        found: dict[str, Values | list[str]] = {}
        for column in self.columns():
            if column.name == STAMP and column.field == "header.stamp":
                found[STAMP] = stamps(columns)
                continue
            given = columns[column.field or column.name]
            if column.dtype is None:
                found[column.name] = [as_text(value) for value in given]
            else:
                found[column.name] = np.asarray(given, column.dtype)
        return found


def stamps(columns: Mapping[str, Column]) -> npt.NDArray[np.int64]:
    """Return header stamps [ns]."""
    seconds, rest = np.asarray(columns[SEC], np.int64), np.asarray(columns[NANOSEC], np.int64)
    return seconds * 1_000_000_000 + rest


def as_text(value: Any) -> str:
    """Return text as it is; what has no fixed number of elements as JSON."""
    return value if isinstance(value, str) else json.dumps(_plain(value))


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, str | int | float | bool) or value is None:
        return value
    if isinstance(value, Iterable):
        return [_plain(item) for item in value]
    # A message of rosbags.
    return {name: _plain(item) for name, item in vars(value).items() if not name.startswith("__")}


def _shape(column: Column) -> FieldShape:
    if isinstance(column, np.ndarray) and column.dtype.kind in "biuf" and column.ndim <= 2:
        width = column.shape[1] if column.ndim == 2 else 0
        if column.ndim == 1 or width:
            return FieldShape(column.dtype, width)
    return FieldShape(None, 0)
