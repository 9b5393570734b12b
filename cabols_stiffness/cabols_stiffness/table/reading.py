"""Read a CSV table: numbers in SI by role, rows without a load left out."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, IntArray
from cabols_control.files.plain_numbers import LARGEST_SCALED, plain_number
from cabols_stiffness.table.units import JOINT, Meaning, TableError, meaning

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
WHOLE = frozenset({"configuration", "load", "reflector", "group", "branch"})
LARGEST_INDEX = 1e9
NOTHING = frozenset({"", "nan", "na", "n/a", "none", "-", "null"})
"""Cells that hold no number."""


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of a table, in SI.

    Attributes:
        columns: (k,) by role; NaN where a cell is empty.
        joints: (k, n) [rad, m].
        wrench: (k, 6) [N, N m]; a component without a column is zero.
        unread: headers that are none of the known names.
        skipped: lines of rows without joints or wrench, from 1.
    """

    columns: Mapping[str, FloatArray]
    joints: FloatArray
    wrench: FloatArray
    unread: tuple[str, ...]
    skipped: tuple[int, ...]

    def __len__(self) -> int:
        """Number of rows."""
        return int(self.joints.shape[0])

    def index(self, role: str, default: ArrayLike = 0) -> IntArray:
        """(k,) whole numbers of a column.

        Args:
            role: of the column.
            default: where there is none.
        """
        found = self.columns.get(role)
        if found is None:
            return np.broadcast_to(np.asarray(default, dtype=np.int64), (len(self),)).copy()
        return np.asarray(np.round(np.nan_to_num(found)).astype(np.int64))

    def together(self, prefix: str) -> FloatArray | None:
        """(k, 3) columns prefix + x, y, z; NaN where there is none, None if all are missing."""
        parts = [self.columns.get(prefix + axis) for axis in "xyz"]
        if all(part is None for part in parts):
            return None
        nothing = np.full(len(self), np.nan)
        return np.column_stack([nothing if part is None else part for part in parts])


def read_table(
    path: str | Path, joints: int, mapping: Mapping[str, Mapping[str, str]] | None = None
) -> Table:
    """Read a CSV file with one line of headers.

    Args:
        path: of the file; comma, semicolon or tab between cells.
        joints: number n that the robot has.
        mapping: by header: `as` a known name, `unit` of the column; either may be missing.

    Raises:
        TableError: naming column or line, what was expected and what came.
    """
    rows, headers = _cells(Path(path))
    known, unread = _meanings(headers, mapping or {}, path)
    columns: dict[str, FloatArray] = {}
    for index, found in known.items():
        if found.role in columns:
            raise TableError(f"{path}: expected one column for {found.role}, got two")
        values = [_number(cells[index], line, headers[index], path) for line, cells in rows]
        columns[found.role] = found.factor * np.array(values)
        if found.role in WHOLE:
            _check_whole(columns[found.role], [line for line, _ in rows], headers[index], path)
    missing = [f"q{j + 1}" for j in range(joints) if f"q{j + 1}" not in columns]
    more = [role for role in columns if JOINT.match(role) and int(role[1:]) > joints]
    if missing or more:
        raise TableError(
            f"{path}: expected columns q1 to q{joints} for the robot's joints, "
            + (f"got none for {', '.join(missing)}" if missing else f"got also {', '.join(more)}")
        )
    if not any(role in columns for role in WRENCH):
        raise TableError(f"{path}: expected columns of the wrench (fx_N ... mz_Nm), got none")
    angles = np.column_stack([columns[f"q{j + 1}"] for j in range(joints)])
    zero = np.zeros(len(rows))
    wrench = np.column_stack([columns.get(role, zero) for role in WRENCH])
    good = np.isfinite(angles).all(axis=1) & np.isfinite(wrench).all(axis=1)
    skipped = tuple(rows[i][0] for i in np.flatnonzero(~good))
    kept = {role: column[good] for role, column in columns.items()}
    return Table(kept, angles[good], wrench[good], unread, skipped)


def _cells(path: Path) -> tuple[list[tuple[int, list[str]]], list[str]]:
    """Rows with their line numbers, and headers."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise TableError(f"{path}: expected a table as UTF-8 text, got {error}") from error
    lines = [
        (number, line)
        # Not splitlines(), which takes eight more characters for ends of lines.
        for number, line in enumerate(re.split(r"\r\n|\n|\r", text), 1)
        if line.strip() and not line.startswith("#")
    ]
    if len(lines) < 2:
        raise TableError(f"{path}: expected a line of headers and rows, got {len(lines)} lines")
    mark = max(",;\t", key=lines[0][1].count)
    table = [(number, _split(path, number, line, mark)) for number, line in lines]
    headers = [cell.strip() for cell in table[0][1]]
    for line, cells in table[1:]:
        if len(cells) != len(headers):
            raise TableError(
                f"{path}: line {line}: expected {len(headers)} cells, got {len(cells)}"
            )
    return table[1:], headers


def _split(path: Path, number: int, line: str, mark: str) -> list[str]:
    """Cells of a line, which holds a whole row: no cell goes on in the next line."""
    try:
        return next(csv.reader([line + "\n"], delimiter=mark, strict=True))
    except (csv.Error, StopIteration) as error:
        raise TableError(f"{path}: line {number}: expected cells of CSV, got {error}") from error


def _meanings(
    headers: list[str], mapping: Mapping[str, Mapping[str, str]], path: str | Path
) -> tuple[dict[int, Meaning], tuple[str, ...]]:
    lost = [name for name in mapping if name not in headers]
    if lost:
        raise TableError(f"{path}: mapping: expected headers of the table, got {', '.join(lost)}")
    known, unread = {}, []
    for index, header in enumerate(headers):
        said = mapping.get(header, {})
        found = meaning(str(said.get("as", header)), str(said.get("unit", "")))
        if found is None:
            unread.append(header)
        else:
            known[index] = found
    return known, tuple(unread)


def _number(cell: str, line: int, header: str, path: str | Path) -> float:
    text = cell.strip()
    if text.lower() in NOTHING:
        return float("nan")
    try:
        return plain_number(text, LARGEST_SCALED)
    except ValueError as error:
        raise TableError(f"{path}: line {line}: {header}: {error}") from error


def _check_whole(values: FloatArray, lines: list[int], header: str, path: str | Path) -> None:
    """Refuse indices that are no whole numbers."""
    for value, line in zip(values, lines, strict=True):
        if np.isfinite(value) and not (value == np.round(value) and abs(value) < LARGEST_INDEX):
            raise TableError(
                f"{path}: line {line}: {header}: expected a whole number, got {value:g}"
            )
