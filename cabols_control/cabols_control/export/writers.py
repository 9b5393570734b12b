# SPDX-License-Identifier: Apache-2.0
"""Files of other programs: csv, parquet, hdf5, mat. All but mat are written batch by batch."""

from __future__ import annotations

import csv
import importlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cabols_control.errors import UsageError
from cabols_control.export.table import TableColumn, Values

Batch = Mapping[str, Values | list[str]]
Metadata = Mapping[str, str]
MAT_LIMIT = 2**31
"""Bytes of one variable in MATLAB's format 5."""


class MissingLibraryError(UsageError):
    """A format needs a library that is not installed."""


class TableWriter(Protocol):
    """Writes one table."""

    def write(self, batch: Batch) -> None:
        """Add rows: by column name, as Table.values returns them."""

    def close(self) -> list[Path]:
        """Complete the file; return what was written."""


def library(name: str, install: str) -> Any:
    """Import a library that only one format needs.

    Args:
        name: of the module.
        install: what pip is told to install.

    Raises:
        MissingLibraryError: saying how to install it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingLibraryError(
            f"{name}: expected the library for this format, found none ({error}); install it: "
            f"{install}"
        ) from error


def flat_names(columns: Sequence[TableColumn]) -> list[str]:
    """Return the names of all single columns; arrays have one for each element."""
    return [name for column in columns for name in column.flat()]


def flat_values(columns: Sequence[TableColumn], batch: Batch) -> list[Any]:
    """Return a batch column by column, in the order of flat_names.

    Args:
        columns: of the table.
        batch: some messages of the topic.
    """
    found: list[Any] = []
    for column in columns:
        values = batch[column.name]
        if column.width and isinstance(values, np.ndarray):
            found += list(values.T)
        else:
            found.append(values)
    return found


def column_notes(columns: Sequence[TableColumn]) -> dict[str, dict[str, str]]:
    """Say what each column is, for the metadata."""
    return {
        column.name: {"field": column.field, "unit": column.unit, "columns": str(column.width or 1)}
        for column in columns
    }


class CsvWriter:
    """A .csv with one header line, and a .json beside it with the metadata."""

    def __init__(
        self, folder: Path, name: str, columns: Sequence[TableColumn], metadata: Metadata
    ) -> None:
        """Begin the file."""
        self._path = folder / f"{name}.csv"
        self._columns = columns
        self._side = folder / f"{name}.json"
        notes = {"metadata": dict(metadata), "columns": column_notes(columns)}
        self._side.write_text(json.dumps(notes, indent=2) + "\n", encoding="utf-8")
        self._stream = self._path.open("w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._stream)
        self._writer.writerow(flat_names(columns))

    def write(self, batch: Batch) -> None:
        """Add rows; numbers in full, so that reading gives the same ones."""
        lists = [
            values.tolist() if isinstance(values, np.ndarray) else values
            for values in flat_values(self._columns, batch)
        ]
        self._writer.writerows(zip(*lists, strict=True))

    def close(self) -> list[Path]:
        """Complete the file."""
        self._stream.close()
        return [self._path, self._side]


class ParquetWriter:
    """A .parquet, a row group for each batch; the metadata are in its schema."""

    def __init__(
        self, folder: Path, name: str, columns: Sequence[TableColumn], metadata: Metadata
    ) -> None:
        """Begin the file."""
        self._arrow = library("pyarrow", "pip install pyarrow")
        parquet = library("pyarrow.parquet", "pip install pyarrow")
        self._path = folder / f"{name}.parquet"
        self._columns = columns
        fields = []
        for column in columns:
            kind = self._arrow.string() if column.dtype is None else self._kind(column.dtype)
            note = {"field": column.field, "unit": column.unit}
            fields += [self._arrow.field(each, kind, metadata=note) for each in column.flat()]
        self._schema = self._arrow.schema(fields, metadata=dict(metadata))
        self._writer = parquet.ParquetWriter(self._path, self._schema)

    def _kind(self, dtype: np.dtype[Any]) -> Any:
        return self._arrow.from_numpy_dtype(dtype.newbyteorder("="))

    def write(self, batch: Batch) -> None:
        """Add rows."""
        arrays = [
            self._arrow.array(np.ascontiguousarray(v) if isinstance(v, np.ndarray) else v, f.type)
            for v, f in zip(flat_values(self._columns, batch), self._schema, strict=True)
        ]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))

    def close(self) -> list[Path]:
        """Complete the file."""
        self._writer.close()
        return [self._path]


class Hdf5Writer:
    """A group for each topic in one export.h5; datasets grow; the metadata are attributes."""

    def __init__(
        self, folder: Path, name: str, columns: Sequence[TableColumn], metadata: Metadata
    ) -> None:
        """Begin the group."""
        h5py = library("h5py", "sudo apt install python3-h5py, or pip install h5py")
        self._path = folder / "export.h5"
        self._file = h5py.File(self._path, "a")
        group = self._file.create_group(name)
        for key, value in metadata.items():
            group.attrs[key] = value
        self._columns = columns
        self._sets = {}
        for column in columns:
            kind = h5py.string_dtype() if column.dtype is None else column.dtype
            wide = (column.width,) if column.width else ()
            self._sets[column.name] = group.create_dataset(
                column.name,
                (0, *wide),
                kind,
                maxshape=(None, *wide),
                chunks=(4096, *wide),
                compression="gzip",
                compression_opts=1,
            )
            self._sets[column.name].attrs.update({"field": column.field, "unit": column.unit})

    def write(self, batch: Batch) -> None:
        """Add rows."""
        for column in self._columns:
            place, values = self._sets[column.name], batch[column.name]
            before = place.shape[0]
            place.resize(before + len(values), axis=0)
            place[before:] = values

    def close(self) -> list[Path]:
        """Complete the file."""
        self._file.close()
        return [self._path]


class MatWriter:
    """A struct for each topic in one export.mat, with a struct `metadata` in it; in memory."""

    content: dict[str, dict[str, Any]]

    def __init__(
        self, folder: Path, name: str, columns: Sequence[TableColumn], metadata: Metadata
    ) -> None:
        """Begin the struct."""
        self._path = folder / "export.mat"
        self._name = name
        self._columns = columns
        self._metadata = dict(metadata)
        self._batches: dict[str, list[Any]] = {column.name: [] for column in columns}

    def write(self, batch: Batch) -> None:
        """Add rows."""
        for column in self._columns:
            self._batches[column.name].append(batch[column.name])

    def close(self) -> list[Path]:
        """Add the struct to the file.

        Raises:
            UsageError: if a column is larger than the format can hold.
        """
        from scipy.io import loadmat, savemat

        struct: dict[str, Any] = {}
        for column in self._columns:
            parts = self._batches[column.name]
            if column.dtype is None:
                texts = [text for part in parts for text in part]
                struct[_short(column.name)] = np.array(texts, dtype=object).reshape(-1, 1)
                continue
            values = np.concatenate(parts)
            if values.nbytes >= MAT_LIMIT:
                raise UsageError(
                    f"{self._name}: {column.name}: expected less than 2 GiB for --format mat, got "
                    f"{values.nbytes} bytes; use --format hdf5, which MATLAB reads, too"
                )
            struct[_short(column.name)] = values if column.width else values.reshape(-1, 1)
        struct["metadata"] = {_short(_name(k)): v for k, v in self._metadata.items()}
        before = loadmat(self._path, simplify_cells=False) if self._path.exists() else {}
        whole = {key: value for key, value in before.items() if not key.startswith("__")}
        whole[_short(_name(self._name))] = struct
        savemat(self._path, whole, long_field_names=True, do_compression=True)
        self._batches.clear()
        return [self._path]


def _name(text: str) -> str:
    """Return a name that MATLAB takes."""
    name = "".join(letter if letter.isalnum() and letter.isascii() else "_" for letter in text)
    return name if name[:1].isalpha() else f"t_{name}"


def _short(name: str) -> str:
    """Return at most the 63 letters that MATLAB takes."""
    return name[:63]


WRITERS: dict[str, type[CsvWriter] | type[ParquetWriter] | type[Hdf5Writer] | type[MatWriter]] = {
    "csv": CsvWriter,
    "parquet": ParquetWriter,
    "hdf5": Hdf5Writer,
    "mat": MatWriter,
}
