# SPDX-License-Identifier: Apache-2.0
"""Cells of a table's file, as the programs of laboratories write them: CSV in its forms, Parquet.

Between cells: comma, semicolon, tab, bar, or blanks. Text as UTF-8, or UTF-16 with its mark (a
spreadsheet's "Unicode text"). A first line `sep=;`, comment lines, empty lines and empty columns at
the end are left out. Units may be a line of their own below the headers.
"""

from __future__ import annotations

import csv
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cabols_control.export.writers import library
from cabols_stiffness.data_files.unit_words import is_unit
from cabols_stiffness.errors import TableError

MARKS = ",;\t|"
PARQUET = (".parquet", ".pq")
DECIMAL_COMMA = re.compile(r"[+-]?[0-9]+,[0-9]+(?:[eE][+-]?[0-9]{1,3})?")
DECIMAL_POINT = re.compile(r"[+-]?[0-9]+\.[0-9]+(?:[eE][+-]?[0-9]{1,3})?")
COMMENTS = ("#", "%")
"""First characters of lines that are left out."""
PREAMBLE = 60
"""Lines among which the headers are looked for."""
HEADERS_LEAST = 4
"""Expected headers by which their line is known."""
BINARY = {
    b"PK\x03\x04": "a spreadsheet or another archive (xlsx, ods, zip)",
    b"\xd0\xcf\x11\xe0": "a spreadsheet of an old form (xls)",
    b"\x1f\x8b": "a compressed file (gzip)",
    b"PAR1": "Parquet under another name (its ending must be .parquet)",
    b"\x89HDF": "an HDF5 file (MATLAB's, too)",
    b"MATLAB": "a file of MATLAB",
}
"""First bytes of files that are no text."""
SIGNS = str.maketrans({"\u2212": "-", "\u00a0": " ", "\u202f": " "})
"""Of typesetting: the minus sign and blanks that do not break."""


@dataclass(frozen=True)
class Cells:
    """Text of a table.

    Attributes:
        headers: of the columns.
        units: of the columns; empty where the header has it, or none.
        lines: number of each row's line, from 1.
        rows: as many cells as headers, each.
    """

    headers: list[str]
    units: list[str]
    lines: list[int]
    rows: list[list[str]]


def read_cells(path: str | Path, is_header: Callable[[str], bool] | None = None) -> Cells:
    """Read a table's cells.

    Args:
        path: of the file; by its ending Parquet, else CSV.
        is_header: whether a cell is a header that is expected; lines above the headers are left
            out then, and headers may be in a line of comment. None: the first line has them.

    Raises:
        TableError: naming the line, what was expected and what came.
    """
    place = Path(path)
    if place.suffix.lower() in PARQUET:
        return _parquet(place)
    # Not splitlines(), which takes eight more characters for ends of lines.
    lines = list(enumerate(re.split(r"\r\n|\n|\r", _text(place)), 1))
    numbered = _from_headers([one for one in lines if one[1].strip()], is_header)
    mark = ""
    if numbered and (said := re.fullmatch(r"sep=(.)\s*", numbered[0][1], re.IGNORECASE)):
        mark, numbered = said.group(1), numbered[1:]
    if len(numbered) < 2:
        raise TableError(f"{path}: expected a line of headers and rows, got {len(numbered)} lines")
    mark = mark or _mark(numbered[0][1])
    table = [(number, _split(place, number, line, mark)) for number, line in numbered]
    headers = [cell.strip() for cell in table[0][1]]
    for number, cells in table[1:]:
        while len(cells) > len(headers) and not cells[-1].strip():
            cells.pop()  # a mark at the end of each row
        if len(cells) != len(headers):
            hint = "; decimal commas need another mark between cells" if mark == "," else ""
            raise TableError(
                f"{path}: line {number}: expected {len(headers)} cells, got {len(cells)}{hint}"
            )
    table = [(n, cells) for n, cells in table if n == table[0][0] or any(map(str.strip, cells))]
    while headers and not headers[-1] and all(not cells[-1].strip() for _, cells in table):
        headers, table = headers[:-1], [(number, cells[:-1]) for number, cells in table]
    units = [""] * len(headers)
    if len(table) > 1 and _are_units(table[1][1]):
        units = [cell.strip().strip("[]()") for cell in table[1][1]]
        table = [table[0], *table[2:]]
    rows = [[cell.translate(SIGNS).strip() for cell in cells] for _, cells in table[1:]]
    if mark != ",":
        rows = _with_points(rows, place)
    return Cells(headers, units, [number for number, _ in table[1:]], rows)


def _from_headers(
    lines: list[tuple[int, str]], is_header: Callable[[str], bool] | None
) -> list[tuple[int, str]]:
    """Lines from that with the headers on, without comments."""
    plain = [(number, line) for number, line in lines if not line.startswith(COMMENTS)]
    if is_header is None:
        return plain
    for i, (number, line) in enumerate(lines[:PREAMBLE]):
        said = line.lstrip("".join(COMMENTS)).strip() if line.startswith(COMMENTS) else line
        cells = re.split(f"[{re.escape(MARKS)}]", said) if any(m in said for m in MARKS) else []
        cells = cells or said.split()
        if sum(is_header(cell.strip(' "')) for cell in cells) >= HEADERS_LEAST:
            after = [one for one in lines[i + 1 :] if not one[1].startswith(COMMENTS)]
            # A line `sep=;` above them counts all the same.
            first = [one for one in plain[:1] if re.match("sep=", one[1], re.IGNORECASE)]
            return [*first, (number, said), *after]
    return plain


def _text(path: Path) -> str:
    try:
        raw = path.read_bytes()
        for start, what in BINARY.items():
            if raw.startswith(start):
                raise TableError(
                    f"{path}: expected a table as text (CSV) or Parquet, got {what}; save the "
                    "sheet as CSV, in UTF-8"
                )
        utf16 = raw.startswith((BOM_UTF16_LE, BOM_UTF16_BE))
        return raw.decode("utf-16" if utf16 else "utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise TableError(
            f"{path}: expected a table as UTF-8 text, got {error}; save it as UTF-8"
        ) from error


def _mark(headers: str) -> str:
    """Character between cells: what the headers have most of; blanks if they have none."""
    mark = max(MARKS, key=headers.count)
    return mark if mark in headers else " "


def _split(path: Path, number: int, line: str, mark: str) -> list[str]:
    """Cells of a line, which holds a whole row: no cell goes on in the next line."""
    if mark == " ":
        return line.split()
    try:
        return next(csv.reader([line + "\n"], delimiter=mark, strict=True))
    except (csv.Error, StopIteration) as error:
        raise TableError(f"{path}: line {number}: expected cells of CSV, got {error}") from error


def _are_units(cells: list[str]) -> bool:
    """Whether a row is of units: known ones, dashes or nothing, at least one of them."""
    words = [cell.strip().strip("[]()") for cell in cells]
    named = [word for word in words if word not in ("", "-", "1")]
    return bool(named) and all(is_unit(word) for word in named)


def _with_points(rows: list[list[str]], path: Path) -> list[list[str]]:
    """Rows with decimal points in place of decimal commas."""
    with_comma = any(DECIMAL_COMMA.fullmatch(cell) for cells in rows for cell in cells)
    if not with_comma:
        return rows
    if any(DECIMAL_POINT.fullmatch(cell) for cells in rows for cell in cells):
        raise TableError(
            f"{path}: expected decimal points or decimal commas, got both; is a comma or a point "
            "between thousands? write the numbers without it"
        )
    return [[cell.replace(",", ".") for cell in cells] for cells in rows]


def _parquet(path: Path) -> Cells:
    arrow = library("pyarrow", "pip install pyarrow, or save the table as CSV")
    parquet = library("pyarrow.parquet", "pip install pyarrow, or save the table as CSV")
    try:
        table = parquet.read_table(path)
        columns = [column.to_pylist() for column in table.itercolumns()]
    except (arrow.ArrowException, OSError, ValueError) as error:
        raise TableError(f"{path}: expected a table in Parquet, got {error}") from error
    headers = [str(name) for name in table.column_names]
    if not headers or table.num_rows == 0:
        raise TableError(f"{path}: expected columns and rows, got {table.shape}")
    said = [(field.metadata or {}).get(b"unit", b"") for field in table.schema]
    units = [unit.decode("utf-8", "replace") for unit in said]
    rows = [
        ["" if cell is None else str(cell) for cell in row] for row in zip(*columns, strict=True)
    ]
    return Cells(headers, units, list(range(1, len(rows) + 1)), rows)
