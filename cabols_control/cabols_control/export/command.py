# SPDX-License-Identifier: Apache-2.0
"""Command `export`: topics of any bag as csv, parquet, mat or hdf5."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cabols_control.bags.information import bag_information
from cabols_control.bags.names import absolute, relative
from cabols_control.bags.reader import LOG_TIME, batches
from cabols_control.checks import IntArray
from cabols_control.command_line import DONE, CommandParser, command
from cabols_control.export.table import STAMP, Table, TableColumn, Values
from cabols_control.export.time_base import (
    LINEAR,
    METHODS,
    PREVIOUS,
    TimeBaseError,
    linear,
    newest_before,
    previous,
    regular,
    texts,
)
from cabols_control.export.writers import WRITERS, Metadata, TableWriter
from cabols_control.files.output_folder import output_folder

SIZE = 20_000
"""Messages in memory at a time."""
TOLD_S = 2.0
JOINED = "table"
TEXT = """Write topics of a bag, of any types, as tables for other programs.

One table for each topic, or a single one on a common time base. Columns carry their unit for the
types of this project and the common ones of ROS (tension_0_n, force_x_n); numbers in names count
from 0. Times are nanoseconds of the system clock. What the recorder noted goes along: in the
schema's metadata (parquet), attributes (hdf5), a struct `metadata` (mat), a .json beside each file
(csv)."""


class Progress:
    """Says how far a long command is, every two seconds."""

    def __init__(self, total: int) -> None:
        """Start counting up to total messages."""
        self._total = total
        self._done = 0
        self._told = time.monotonic()

    def add(self, count: int) -> None:
        """Count messages; print if it is time."""
        self._done += count
        now = time.monotonic()
        if now - self._told > TOLD_S:
            self._told = now
            share = 100.0 * self._done / max(self._total, 1)
            print(f"  {share:3.0f} %", file=sys.stderr, flush=True)


def learn_tables(bag: Path, topics: Sequence[str], progress: Progress) -> dict[str, Table]:
    """Read a bag once to find what its messages have in common.

    Args:
        bag: its folder.
        topics: relative names.
        progress: called after each batch.

    Raises:
        BagError: if the bag cannot be read.
    """
    types = bag_information(bag).types
    tables = {topic: Table(topic, types[topic]) for topic in topics}
    for batch in batches(bag, topics, SIZE, timed=True):
        for topic, columns in batch.items():
            tables[topic].learn(columns)
            progress.add(len(columns[LOG_TIME]))
    return tables


def write_tables(
    bag: Path, tables: dict[str, Table], writers: dict[str, TableWriter], progress: Progress
) -> list[Path]:
    """Read a bag again and write each topic's table; return the files.

    Args:
        bag: folder of the bag.
        tables: to be written, by topic.
        writers: of the files, by topic.
        progress: told what has been written.
    """
    for batch in batches(bag, list(tables), SIZE, timed=True):
        for topic, columns in batch.items():
            writers[topic].write(tables[topic].values(columns))
            progress.add(len(columns[LOG_TIME]))
    return [path for writer in writers.values() for path in writer.close()]


def read_tables(
    bag: Path, tables: dict[str, Table], progress: Progress
) -> dict[str, dict[str, Values | list[str]]]:
    """Read whole tables into memory, sorted by time.

    Args:
        bag: folder of the bag.
        tables: to be read, by topic.
        progress: told what has been read.
    """
    parts: dict[str, list[dict[str, Values | list[str]]]] = {topic: [] for topic in tables}
    for batch in batches(bag, list(tables), SIZE, timed=True):
        for topic, columns in batch.items():
            parts[topic].append(tables[topic].values(columns))
            progress.add(len(columns[LOG_TIME]))
    return {topic: _sorted(_whole(parts[topic])) for topic in tables}


def _whole(parts: list[dict[str, Values | list[str]]]) -> dict[str, Values | list[str]]:
    found: dict[str, Values | list[str]] = {}
    for name, first in parts[0].items():
        if isinstance(first, np.ndarray):
            found[name] = np.concatenate([np.asarray(part[name]) for part in parts])
        else:
            found[name] = [text for part in parts for text in part[name]]
    return found


def _sorted(values: dict[str, Values | list[str]]) -> dict[str, Values | list[str]]:
    order = np.argsort(times_of(values), kind="stable")
    return {
        name: column[order]
        if isinstance(column, np.ndarray)
        else [column[row] for row in order.tolist()]
        for name, column in values.items()
    }


def times_of(values: dict[str, Values | list[str]]) -> IntArray:
    """Return a table's times: header stamps, or the times of recording without any [ns]."""
    return np.asarray(values[STAMP if STAMP in values else LOG_TIME], np.int64)


def time_base(text: str, data: dict[str, dict[str, Values | list[str]]]) -> IntArray:
    """Return the instants of `--time-base`: a topic's, or those of a rate in Hz [ns].

    Args:
        text: a topic's name, or a rate in Hz.
        data: values of each topic by column, sorted by time.

    Raises:
        TimeBaseError: if it is neither.
    """
    topic = relative(text)
    if topic in data:
        return np.unique(times_of(data[topic]))
    try:
        rate = float(text)
    except ValueError:
        raise TimeBaseError(
            f"--time-base: expected a rate in Hz or one of {', '.join(data)}, got {text!r}"
        ) from None
    every = [times_of(values) for values in data.values()]
    return regular(min(int(t[0]) for t in every), max(int(t[-1]) for t in every), rate)


def joined(
    tables: dict[str, Table],
    data: dict[str, dict[str, Values | list[str]]],
    instants_ns: IntArray,
    method: str,
) -> tuple[list[TableColumn], dict[str, Values | list[str]]]:
    """Put all topics on one time base, columns named by their topic.

    Args:
        tables: of the topics, by name.
        data: values of each topic by column, sorted by time.
        instants_ns: (k,) common time base [ns].
        method: how numbers are carried over to it: one of time_base.METHODS.

    Returns:
        The columns, and their values.
    """
    columns = [TableColumn("time_ns", "", "ns", np.dtype(np.int64))]
    values: dict[str, Values | list[str]] = {"time_ns": instants_ns}
    for topic, table in tables.items():
        times = times_of(data[topic])
        rows, there = newest_before(instants_ns, times)
        for column in table.columns():
            if column.name in (LOG_TIME, "publish_time_ns", STAMP):
                continue
            name = f"{topic.strip('/').replace('/', '_')}_{column.name}"
            given = data[topic][column.name]
            if not isinstance(given, np.ndarray):
                columns.append(TableColumn(name, column.field, column.unit, None))
                values[name] = texts(given, rows, there)
                continue
            kind = np.dtype(np.float64)
            columns.append(TableColumn(name, column.field, column.unit, kind, column.width))
            between = method == LINEAR and given.dtype.kind == "f"
            values[name] = (
                linear(given, instants_ns, times) if between else previous(given, rows, there)
            )
    return columns, values


@command
def main(words: Sequence[str] | None = None) -> int:
    """Export; returns the exit code."""
    options = _parser().parse_args(words)
    information = bag_information(options.bag)
    topics = information.present(options.topics)
    output = options.output or options.bag.with_name(options.bag.resolve().name + "_export")
    metadata = {
        **information.metadata,
        "bag": options.bag.resolve().name,
        "written_by": "cabols export",
        "indices": "numbers in the names of columns count from 0",
    }
    kind = WRITERS[options.format]
    count = sum(information.counts[topic] for topic in topics)
    with output_folder(output, "export") as folder:
        tables = learn_tables(options.bag, topics, Progress(2 * count))
        if options.time_base:
            data = read_tables(options.bag, tables, Progress(count))
            instants = time_base(options.time_base, data)
            metadata["time_base"] = options.time_base
            metadata["interpolation"] = options.interpolate
            columns, values = joined(tables, data, instants, options.interpolate)
            writer = kind(output, JOINED, columns, metadata)
            for part in _parts(values, len(instants)):
                writer.write(part)
            written = writer.close()
        else:
            writers = {t: _writer(kind, output, table, metadata) for t, table in tables.items()}
            written = write_tables(options.bag, tables, writers, Progress(count))
        folder.finish()
    for path in dict.fromkeys(written):
        print(f"  {path}")
    return DONE


def _writer(kind: Any, output: Path, table: Table, metadata: Metadata) -> TableWriter:
    name = table.topic.strip("/").replace("/", "_")
    own = {"topic": absolute(table.topic), "type": table.type_name}
    writer: TableWriter = kind(output, name, table.columns(), {**metadata, **own})
    return writer


def _parts(values: dict[str, Values | list[str]], count: int) -> Iterator[dict[str, Any]]:
    """Yield a whole table batch by batch."""
    for begin in range(0, count, SIZE):
        yield {name: column[begin : begin + SIZE] for name, column in values.items()}


def _parser() -> CommandParser:
    parser = CommandParser("export", TEXT)
    add = parser.add_argument
    add("bag", type=Path, help="folder of the bag")
    add("--format", choices=sorted(WRITERS), required=True, help="of the files")
    add("--topics", nargs="+", help="relative to /cabols; default: all that have messages")
    add(
        "--time-base",
        metavar="TOPIC|RATE",
        default="",
        help="one table, at this topic's stamps or this rate in Hz; takes the topics into memory",
    )
    add(
        "--interpolate",
        choices=METHODS,
        default=PREVIOUS,
        help="between messages: the previous value, or linear for floating-point numbers; whole "
        "numbers, flags and texts are always the previous ones (default: %(default)s)",
    )
    add("--output", type=Path, help="folder to fill; default: BAG_export")
    return parser


if __name__ == "__main__":
    sys.exit(main())
