# SPDX-License-Identifier: Apache-2.0
"""Bags of rosbag2's older storage, sqlite3: files `.db3`."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from cabols_control.bags.errors import BagError
from cabols_control.bags.storage.records import HASH, QOS, ChannelInfo, Message, Schema


class SqliteFile:
    """One pass through a .db3 file, as Salvage is one through a .mcap.

    Attributes:
        channels: of the file, once the pass has begun.
        metadata: by name; sqlite3 bags have none.
        seen: number of messages that were read.
        expected: number of messages as the file says; None: it does not.
        dropped_bytes: of damaged records; none, as a damaged file is an error.
        whole: likewise.
    """

    def __init__(self, path: Path) -> None:
        """Prepare; messages() reads."""
        self._path = path
        self.channels: list[ChannelInfo] = []
        self.metadata: dict[str, dict[str, str]] = {}
        self.seen = 0
        self.expected: int | None = None
        self.dropped_bytes = 0
        self.whole = True

    def records(self) -> Iterator[Message]:
        """Yield every message, as messages() does.

        Raises:
            BagError: as messages() does.
        """
        yield from self.messages()

    def messages(self) -> Iterator[Message]:
        """Yield every message in the order of its time.

        Raises:
            BagError: if the file is no bag of rosbag2, or damaged.
        """
        try:
            with contextlib.closing(self._open()) as connection:
                yield from self._messages(connection)
        except (
            *(sqlite3.Error, OSError, ValueError, TypeError, OverflowError, KeyError),
            MemoryError,  # of a row that announces more than there is
        ) as error:
            raise BagError(
                f"{self._path}: expected a readable sqlite3 bag, got one with {error}; "
                "mend it with sqlite3's own `.recover`"
            ) from error

    def _open(self) -> sqlite3.Connection:
        """Open for reading; a file in a folder that may not be written, too."""
        if not self._path.is_file():
            raise OSError("nothing there")
        place = f"file:{quote(str(self._path.resolve()))}"
        try:
            connection = sqlite3.connect(f"{place}?mode=ro", uri=True)
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
        except sqlite3.OperationalError:
            connection = sqlite3.connect(f"{place}?immutable=1", uri=True)
        connection.text_factory = lambda raw: raw.decode("utf-8", "replace")
        return connection

    def _messages(self, connection: sqlite3.Connection) -> Iterator[Message]:
        channels = self._channels(connection)
        self.channels = list(channels.values())
        rows = connection.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
        for topic, time_ns, data in rows:
            if not (isinstance(time_ns, int) and isinstance(data, bytes)):
                raise TypeError(f"message {self.seen + 1} without time or content")
            self.seen += 1
            yield Message(channels.get(topic), 0, time_ns, time_ns, data)

    def _channels(self, connection: sqlite3.Connection) -> dict[int, ChannelInfo]:
        found = {}
        definitions = self._definitions(connection)
        for row in _rows(connection, "topics"):
            if not (isinstance(row["name"], str) and isinstance(row["type"], str)):
                raise TypeError("a topic without name or type")
            encoding, text = definitions.get(row["type"], ("", b""))
            schema = Schema(0, row["type"], encoding, text)
            metadata = {QOS: row.get("offered_qos_profiles") or ""}
            if hashed := row.get("type_description_hash"):
                metadata[HASH] = hashed
            found[row["id"]] = ChannelInfo(
                row["name"], schema, row.get("serialization_format") or "cdr", metadata
            )
        return found

    def _definitions(self, connection: sqlite3.Connection) -> dict[str, tuple[str, bytes]]:
        """Encoding and text by type; bags before ROS 2 Iron carry none."""
        tables = connection.execute("SELECT name FROM sqlite_master WHERE type='table'")
        if ("message_definitions",) not in tables.fetchall():
            return {}
        return {
            row["topic_type"]: (
                row["encoding"],
                (row["encoded_message_definition"] or "").encode(),
            )
            for row in _rows(connection, "message_definitions")
            if row["encoding"] != "unknown"
        }


def _rows(connection: sqlite3.Connection, table: str) -> list[dict[str, Any]]:
    """Rows of a table by column; the columns differ between rosbag2's versions."""
    cursor = connection.execute(f"SELECT * FROM {table}")
    names = [column[0] for column in cursor.description]
    return [dict(zip(names, row, strict=True)) for row in cursor]
