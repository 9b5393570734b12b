# SPDX-License-Identifier: Apache-2.0
"""Messages of one topic, gathered in a pass, each decoded by its own recorded definition."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import zstandard
from rosbags.typesys.store import Typestore

from cabols_control.bags.columns import Column, Piece, decode, merge
from cabols_control.bags.errors import BagError, BagWarning
from cabols_control.bags.metadata import signed
from cabols_control.bags.recorded_types import store_of
from cabols_control.bags.storage.records import ChannelInfo, Message

ZSTD = b"\x28\xb5\x2f\xfd"
"""No serialised message begins so: the first byte of CDR is zero."""


def plain(data: bytes) -> bytes:
    """Serialised message, also if rosbag2 compressed it (mode MESSAGE)."""
    if data[:4] != ZSTD:
        return data
    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except zstandard.ZstdError:
        return data


@dataclass
class _Group:
    """Messages that were recorded with one definition; rows count within the topic."""

    channel: ChannelInfo
    rows: list[int] = field(default_factory=list)
    raws: list[bytes] = field(default_factory=list)
    store: Typestore | None = None


@dataclass(frozen=True)
class Decoded:
    """Messages of a topic in the order of recording.

    Attributes:
        type_name: of all of them.
        times: (k, 3) log time, publish time [ns], publication number.
        columns: by dotted field name.
    """

    type_name: str
    times: npt.NDArray[np.int64]
    columns: dict[str, Column]


class TopicMessages:
    """Gathers a topic's messages, and decodes them."""

    def __init__(self, name: str) -> None:
        """Start empty.

        Args:
            name: of the topic, relative to /cabols.
        """
        self._name = name
        self._times: list[tuple[int, int, int]] = []
        self._groups: dict[tuple[object, ...], _Group] = {}
        self._of: dict[int, tuple[ChannelInfo, _Group]] = {}

    def __len__(self) -> int:
        return len(self._times)

    def add(self, channel: ChannelInfo, message: Message) -> None:
        """Take a message.

        Args:
            channel: that it came on.
            message: as it is in the file.
        """
        known = self._of.get(id(channel))
        if known is None:
            schema = channel.schema
            key = (schema.name, schema.encoding, schema.data, channel.encoding, channel.type_hash)
            group = self._groups.setdefault(key, _Group(channel))
            # The channel is kept, too, so that its id stays its own.
            known = self._of[id(channel)] = (channel, group)
        _, group = known
        data = message.data
        group.rows.append(len(self._times))
        group.raws.append(data if data[:4] != ZSTD else plain(data))
        self._times.append((message.log_time_ns, message.publish_time_ns, message.sequence))

    def types(self) -> list[str]:
        """Types of the messages so far."""
        return list(dict.fromkeys(group.channel.type_name for group in self._groups.values()))

    def take(self) -> Decoded:
        """Decode what was gathered, and start anew.

        Raises:
            BagError: if none of the messages can be decoded, or their definitions disagree.
        """
        groups = [group for group in self._groups.values() if group.raws]
        if len(types := {group.channel.type_name for group in groups}) > 1:
            raise BagError(
                f"{self._name}: expected one type, got {' and '.join(sorted(types))} on this "
                "topic; read the files that were merged one by one"
            )
        pieces = [self._decode(group) for group in groups]
        self._agree(pieces)
        rows = np.sort(np.concatenate([piece.rows for piece in pieces]))
        times = _signed_times(self._times)[rows]
        placed = [Piece(np.searchsorted(rows, piece.rows), piece.columns) for piece in pieces]
        self._times = []
        for group in groups:
            group.rows, group.raws = [], []
        return Decoded(groups[0].channel.type_name, times, merge(placed, rows.size))

    def _decode(self, group: _Group) -> Piece:
        type_name = group.channel.type_name
        if group.store is None:
            group.store = store_of(group.channel)
        store, rows, raws = group.store, np.array(group.rows, np.intp), group.raws
        try:
            return Piece(rows, decode(raws, type_name, store))
        except Exception as error:
            # Bytes that are none of the type may raise any error of the decoder.
            good = [i for i, raw in enumerate(raws) if _readable(raw, type_name, store)]
            if not good:
                raise BagError(
                    f"{self._name}: expected {type_name} messages, got bytes that are none "
                    f"({error}); were definition and messages recorded from different builds?"
                ) from error
        left_out = sorted(set(range(len(raws))) - set(good))
        warnings.warn(
            f"{self._name}: {len(left_out)} of {len(raws)} messages are no {type_name} and are "
            f"left out, the first of {len(raws[left_out[0]])} bytes at "
            f"{self._times[rows[left_out[0]]][0]} ns",
            BagWarning,
            stacklevel=2,
        )
        return Piece(rows[good], decode([raws[i] for i in good], type_name, store))

    def _agree(self, pieces: Sequence[Piece]) -> None:
        """Refuse definitions whose fields cannot be put into the same columns."""
        kinds = [
            {name: _kind(column) for name, column in piece.columns.items()} for piece in pieces
        ]
        for other in kinds[1:]:
            if different := sorted(set(kinds[0].items()) ^ set(other.items())):
                fields = ", ".join(dict.fromkeys(name for name, _ in different))
                raise BagError(
                    f"{self._name}: expected one definition of its type, got two that disagree on "
                    f"{fields}; read the files that were merged one by one"
                )


def _signed_times(times: list[tuple[int, int, int]]) -> npt.NDArray[np.int64]:
    """(k, 3) times as ROS 2 reads them, and publication numbers."""
    try:
        found = np.array(times, np.int64)
    except OverflowError:
        found = np.array([[signed(value) for value in row] for row in times], np.int64)
    return found.reshape(-1, 3)


def _kind(column: Column) -> str:
    """Whether a column holds whole or real numbers, flags, or something else."""
    if isinstance(column, np.ndarray):
        return {"i": "whole", "u": "whole"}.get(column.dtype.kind, column.dtype.kind)
    first = next(iter(column), None)
    return _kind(first) if isinstance(first, np.ndarray) else "text or messages"


def _readable(raw: bytes, type_name: str, store: Typestore) -> bool:
    try:
        store.deserialize_cdr(raw, type_name)
    except Exception:
        return False
    return True
