# SPDX-License-Identifier: Apache-2.0
"""Read a table: numbers in SI by role, rows without a load and repeated ones left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.files.plain_numbers import LARGEST_SCALED, plain_number
from cabols_stiffness.data_files.cells import Cells, read_cells
from cabols_stiffness.errors import TableError
from cabols_stiffness.table.units import JOINT, Meaning, is_known, meaning

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
WHOLE = frozenset({"configuration", "load", "reflector", "group", "branch"})
LARGEST_INDEX = 1e9
GRAVITY = 9.80665
"""[m/s^2]"""
NOTHING = frozenset({"", "nan", "na", "n/a", "#n/a", "none", "-", "--", "null"})
"""Cells that hold no number."""

BRANCHES = {
    **dict.fromkeys(("up", "loading", "load", "hin"), 1.0),
    **dict.fromkeys(("down", "unloading", "unload", "back"), -1.0),
    **dict.fromkeys(("reference", "ref", "unloaded", "zero"), 0.0),
}
"""Words of the column branch."""
MEASURED = ("d", "r", "p")
SHOWN = 12
"""Headers that a message names."""


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of a table, in SI.

    Attributes:
        columns: (k,) by role; NaN where a cell is empty.
        joints: (k, n) [rad, m].
        wrench: (k, 6) [N, N m]; a component without a column is zero.
        unread: headers that are none of the known names.
        skipped: lines of rows without joints or wrench, from 1.
        repeated: lines of loaded rows that repeat an earlier one, number for number.
    """

    columns: Mapping[str, FloatArray]
    joints: FloatArray
    wrench: FloatArray
    unread: tuple[str, ...]
    skipped: tuple[int, ...]
    repeated: tuple[int, ...] = ()

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
    """Read a CSV or Parquet file with one line of headers, units in them or in a line below.

    Args:
        path: of the file; comma, semicolon, tab, bar or blanks between cells.
        joints: number n that the robot has.
        mapping: by header: `as` a known name, `unit` of the column; either may be missing.

    Raises:
        TableError: naming column or line, what was expected and what came.
    """
    cells = read_cells(path, is_known)
    known, unread = _meanings(cells, mapping or {}, path)
    columns: dict[str, FloatArray] = {}
    for index, found in known.items():
        if found.role in columns:
            raise TableError(
                f"{path}: expected one column for {found.role}, got {cells.headers[index]!r} "
                "beside another one; name one of them otherwise, as by a mapping"
            )
        columns[found.role] = found.factor * _column(cells, index, found.role, path)
    missing = [f"q{j + 1}" for j in range(joints) if f"q{j + 1}" not in columns]
    more = [role for role in columns if JOINT.match(role) and int(role[1:]) > joints]
    if missing or more:
        raise TableError(
            f"{path}: expected columns q1 to q{joints} for the robot's joints, "
            + (f"got none for {', '.join(missing)}" if missing else f"got also {', '.join(more)}")
            + f"; the headers are {_some(cells.headers)}"
        )
    _hang(columns, path)
    if not any(role in columns for role in WRENCH):
        raise TableError(
            f"{path}: expected columns of the wrench (fx_N ... mz_Nm), got none; the headers are "
            f"{_some(cells.headers)}"
        )
    lines = np.array(cells.lines, dtype=np.int64)
    angles = np.column_stack([columns[f"q{j + 1}"] for j in range(joints)])
    zero = np.zeros(lines.size)
    wrench = np.column_stack([columns.get(role, zero) for role in WRENCH])
    good = np.isfinite(angles).all(axis=1) & np.isfinite(wrench).all(axis=1)
    again = good & ~_first(columns, angles, wrench)
    kept = {role: column[good & ~again] for role, column in columns.items()}
    return Table(
        columns=kept,
        joints=angles[good & ~again],
        wrench=wrench[good & ~again],
        unread=unread,
        skipped=tuple(lines[~good].tolist()),
        repeated=tuple(lines[again].tolist()),
    )


def _hang(columns: dict[str, FloatArray], path: str | Path) -> None:
    """Turn a column of hung masses into the force of their weight, along -z of the base."""
    mass = columns.pop("mass", None)
    if mass is None:
        return
    both = [role for role in WRENCH if role in columns]
    if both:
        raise TableError(
            f"{path}: expected either hung masses or a measured wrench, got mass beside "
            f"{', '.join(both)}; leave one of them out"
        )
    columns["fz"] = -GRAVITY * mass


def _some(headers: list[str]) -> str:
    more = "" if len(headers) <= SHOWN else f" and {len(headers) - SHOWN} more"
    return ", ".join(headers[:SHOWN]) + more


def _first(columns: Mapping[str, FloatArray], angles: FloatArray, wrench: FloatArray) -> BoolArray:
    """(k,) rows that are unloaded, or the first of their joints, wrench and measured numbers."""
    measured = [c for role, c in columns.items() if role == "distance" or role[0] in MEASURED]
    reflector = columns.get("reflector", np.zeros(len(angles)))
    key = np.column_stack([angles, wrench, reflector, *measured])
    _, first = np.unique(np.nan_to_num(key, nan=1e300), axis=0, return_index=True)
    once: BoolArray = ~(wrench != 0.0).any(axis=1)
    once[first] = True
    return once


def _column(cells: Cells, index: int, role: str, path: str | Path) -> FloatArray:
    """(k,) numbers of a column; names of configurations and the like are counted from 0."""
    header, words = cells.headers[index], [row[index] for row in cells.rows]
    if role == "branch":
        signs = {"+": "1", "-": "-1"} if "+" in words else {}
        words = [signs.get(word, str(BRANCHES.get(word.lower(), word))) for word in words]
    elif role in WHOLE and any(_is_name(word) for word in words):
        _refuse_almost_numbers(words, cells.lines, header, path)
        names = {word: i for i, word in enumerate(dict.fromkeys(words))}
        return np.array([np.nan if w.lower() in NOTHING else names[w] for w in words])
    values = [_number(w, line, header, path) for w, line in zip(words, cells.lines, strict=True)]
    found = np.array(values)
    if role in WHOLE:
        _check_whole(found, cells.lines, header, path)
    if role == "branch" and np.nanmax(np.abs(found), initial=0.0) > 1.0:
        raise TableError(
            f"{path}: {header}: expected up or down, or 1 (load rises), -1 (falls) and 0 (unloaded)"
            f", got {np.nanmax(np.abs(found)):g}; name them so"
        )
    return found


def _is_name(word: str) -> bool:
    """Whether a word is no number, but the name of something."""
    if word.lower() in NOTHING:
        return False
    try:
        float(word)
    except ValueError:
        return any(letter.isalpha() for letter in word)
    return False


def _refuse_almost_numbers(
    words: list[str], lines: list[int], header: str, path: str | Path
) -> None:
    """Refuse `1e` or `0x10` beside numbers: a slip, by which rows would be ones of their own."""
    if not any(word.lower() not in NOTHING and not _is_name(word) for word in words):
        return
    for word, line in zip(words, lines, strict=True):
        if _is_name(word) and word.lstrip("+-.")[:1].isdigit():
            raise TableError(
                f"{path}: line {line}: {header}: expected a whole number as in other lines, or a "
                f"name that begins with a letter, got {word!r}"
            )


def _meanings(
    cells: Cells, mapping: Mapping[str, Mapping[str, str]], path: str | Path
) -> tuple[dict[int, Meaning], tuple[str, ...]]:
    headers = cells.headers
    odd = [name for name, said in mapping.items() if not _is_said(said)]
    if odd:
        raise TableError(
            f"{path}: mapping: expected for each header `as` (a known name), `unit`, or both, as "
            f"in '{odd[0]}: {{as: fx, unit: N}}', got {mapping[odd[0]]!r}"
        )
    lost = [name for name in mapping if name not in headers]
    if lost:
        raise TableError(f"{path}: mapping: expected headers of the table, got {', '.join(lost)}")
    known, unread = {}, []
    for index, header in enumerate(headers):
        said = mapping.get(header, {})
        found = meaning(str(said.get("as", header)), str(said.get("unit", cells.units[index])))
        if found is None:
            unread.append(header)
        else:
            known[index] = found
    return known, tuple(unread)


def _is_said(said: object) -> bool:
    words = isinstance(said, Mapping) and set(said) <= {"as", "unit"}
    return bool(words and all(isinstance(word, str) for word in said.values()))  # type: ignore[attr-defined]


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
