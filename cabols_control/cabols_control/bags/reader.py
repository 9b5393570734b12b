# SPDX-License-Identifier: Apache-2.0
"""Reading bags for analysis: arrays by topic and field, or one message after the other."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cabols_control.bags.columns import Column
from cabols_control.bags.errors import BagError, BagWarning
from cabols_control.bags.metadata import custom_data, read_metadata, signed
from cabols_control.bags.names import absolute, relative, type_of
from cabols_control.bags.recorded_types import has_header
from cabols_control.bags.storage.files import listed, opened
from cabols_control.bags.storage.records import ChannelInfo, Message
from cabols_control.bags.topic_messages import TopicMessages, plain
from cabols_control.stamps import HEADER_STAMP, STAMP, STAMP_AT, column_ns, first_stamp

LOG_TIME, PUBLISH_TIME = "log_time_ns", "publish_time_ns"
YEAR_NS = 365 * 24 * 3600 * 1_000_000_000


@dataclass(frozen=True)
class Series:
    """All messages of one topic.

    Attributes:
        topic: relative to /cabols.
        type_name: e.g. `cabols_msgs/msg/LimbState`.
        log_time_ns: (k,) when each was received.
        publish_time_ns: (k,) when each was published.
        sequence: (k,) publication numbers, modulo 2**32; 0 where not recorded.
        stamp_ns: (k,) header stamps; empty if the type has no header.
        stamp: (k,) the same [s] from the bag's first stamp; NaN where a node had no time yet.
    """

    topic: str
    type_name: str
    log_time_ns: npt.NDArray[np.int64]
    publish_time_ns: npt.NDArray[np.int64]
    sequence: npt.NDArray[np.int64]
    stamp_ns: npt.NDArray[np.int64]
    stamp: npt.NDArray[np.float64]
    _columns: dict[str, Column]

    def __len__(self) -> int:
        return self.log_time_ns.size

    @property
    def fields(self) -> list[str]:
        """Dotted names of all fields."""
        return list(self._columns)

    def __getitem__(self, field: str) -> Any:
        """Return a field by its dotted name, e.g. `wrench.force.x`.

        Returns:
            (k,) or (k, n) array of numbers; a list of strings; a list of (n_i,) arrays where the
            length differs between messages.

        Raises:
            BagError: if the type has no such field.
        """
        if field not in self._columns:
            raise BagError(
                f"{self.topic}: expected one of the fields {', '.join(self._columns)}, "
                f"got {field!r}; use the dotted name"
            )
        return self._columns[field]


@dataclass(frozen=True)
class Bag:
    """A bag in memory.

    Attributes:
        folder: where it came from.
        metadata: text by key, as given to the recorder.
        start_ns: first header stamp in the bag, the zero of Series.stamp.
        topics: by name relative to /cabols.
        counts: number of messages of every topic on disk.
    """

    folder: Path
    metadata: dict[str, str]
    start_ns: int
    topics: dict[str, Series]
    counts: dict[str, int]

    def __getitem__(self, topic: str) -> Series:
        """Return a topic.

        Raises:
            BagError: if the bag has no messages of it or they were not read.
        """
        name = relative(topic)
        if name not in self.topics:
            came = f"{self.counts[name]} messages on disk" if name in self.counts else "none"
            raise BagError(
                f"{name}: expected a topic that was read ({', '.join(self.topics)}), "
                f"got {came}; name it in read_bag's topics, or record it"
            )
        return self.topics[name]

    def __contains__(self, topic: str) -> bool:
        return relative(topic) in self.topics


def read_bag(folder: str | Path, topics: Iterable[str] | Mapping[str, str] | None = None) -> Bag:
    """Read topics of a bag into arrays.

    Args:
        folder: of the bag.
        topics: names relative to /cabols, or a mapping of names to the expected types; all of
            them must have messages. None: every topic that has.

    Returns:
        The bag; it needs nothing but the folder, as definitions are in it.

    Raises:
        BagError: if the bag cannot be read, is incomplete or empty, or topic by topic what is
            missing or of another type.
    """
    folder = Path(folder)
    information = read_metadata(folder)
    recorded = _recorded(information)
    wanted = _wanted(folder, recorded, topics)
    start_ns, found = _collect(folder, information, wanted)
    if isinstance(topics, Mapping):
        _check_types(folder, topics, found)
    series = {}
    refused: list[BagError] = []
    for name in wanted:
        result = _series_or_error(name, found[name], start_ns)
        if isinstance(result, Series):
            series[name] = result
        else:
            refused.append(result)
    # Where all were asked for, one that cannot be read must not keep the others away.
    if refused and (topics is not None or not series):
        raise refused[0]
    for reason in refused:
        warnings.warn(f"{folder}: left out: {reason}", BagWarning, stacklevel=2)
    counts = {name: count for name, (_, count) in recorded.items()}
    return Bag(folder, custom_data(information), start_ns, series, counts)


def iterate(
    folder: str | Path, topics: Iterable[str] | None = None
) -> Iterator[tuple[str, int, bytes]]:
    """Yield a bag's messages in the order of recording, in constant memory.

    Args:
        folder: of the bag.
        topics: names relative to /cabols; None: all.

    Yields:
        Topic relative to /cabols, log time [ns], serialised message.

    Raises:
        BagError: if the bag cannot be read or a topic has no messages.
    """
    folder = Path(folder)
    information = read_metadata(folder)
    wanted = set(_wanted(folder, _recorded(information), topics))
    for channel, message in _messages(folder, information):
        name = relative(channel.topic)
        if name in wanted:
            yield name, signed(message.log_time_ns), plain(message.data)


def batches(
    folder: str | Path,
    topics: Iterable[str] | Mapping[str, str] | None,
    size: int = 20_000,
    timed: bool = False,
) -> Iterator[dict[str, dict[str, Column]]]:
    """Yield a bag's messages as arrays, a batch at a time, in constant memory.

    Args:
        folder: of the bag.
        topics: names relative to /cabols, or a mapping of names to the expected types; all of
            them must have messages.
        size: messages of all those topics in a batch.
        timed: with the columns LOG_TIME and PUBLISH_TIME [ns].

    Yields:
        By topic, those with messages in the batch: columns by dotted field name, as Series has
        them. Topics keep their own order, not that among each other within a batch.

    Raises:
        BagError: as read_bag does.
    """
    folder = Path(folder)
    information = read_metadata(folder)
    wanted = set(_wanted(folder, _recorded(information), topics))
    gathered: dict[str, TopicMessages] = {}
    count = 0
    for channel, message in _messages(folder, information):
        name = relative(channel.topic)
        if name not in wanted:
            continue
        if name not in gathered:
            gathered[name] = TopicMessages(name)
        gathered[name].add(channel, message)
        count += 1
        if count >= size:
            yield _drain(folder, gathered, topics, timed)
            count = 0
    if count:
        yield _drain(folder, gathered, topics, timed)


def _drain(
    folder: Path,
    gathered: dict[str, TopicMessages],
    topics: Iterable[str] | Mapping[str, str] | None,
    timed: bool,
) -> dict[str, dict[str, Column]]:
    """Decode the gathered messages of all topics, and drop their bytes."""
    if isinstance(topics, Mapping):
        _check_types(folder, topics, gathered)
    found = {}
    for name, messages in gathered.items():
        if len(messages):
            decoded = messages.take()
            found[name] = dict(decoded.columns)
            if timed:
                log_time, publish_time, _ = decoded.times.T
                found[name].update({LOG_TIME: log_time, PUBLISH_TIME: publish_time})
    return found


def _recorded(information: dict[str, Any]) -> dict[str, tuple[str, int]]:
    """Type and number of messages by relative name, from metadata.yaml."""
    found: dict[str, tuple[str, int]] = {}
    for entry in information.get("topics_with_message_count") or []:
        topic = entry["topic_metadata"]
        name = relative(str(topic["name"]))
        _, before = found.get(name, ("", 0))
        found[name] = (type_of(str(topic["type"])), before + int(entry["message_count"]))
    return found


def _wanted(
    folder: Path,
    recorded: dict[str, tuple[str, int]],
    topics: Iterable[str] | Mapping[str, str] | None,
) -> list[str]:
    present = [name for name, (_, count) in recorded.items() if count]
    if not present:
        raise BagError(
            f"{folder}: expected messages, got an empty bag; was a node running that publishes?"
        )
    if topics is None:
        return present
    types = topics if isinstance(topics, Mapping) else dict.fromkeys(topics, "")
    problems = []
    for topic, type_name in types.items():
        came, count = recorded.get(relative(topic), ("", 0))
        if not came:
            problems.append(
                f"{relative(topic)}: expected {type_name or 'messages'}, not in the bag"
            )
        elif type_name and came != type_of(type_name):
            problems.append(f"{relative(topic)}: expected {type_name}, got {came}")
        elif not count:
            problems.append(f"{relative(topic)}: expected messages, got none")
    if problems:
        raise BagError(f"{folder}: {'; '.join(problems)}. The bag has {', '.join(present)}")
    return [relative(topic) for topic in types]


def _check_types(
    folder: Path, topics: Mapping[str, str], found: Mapping[str, TopicMessages]
) -> None:
    """Hold the types of the files, not only those of metadata.yaml, against the expected ones."""
    for topic, expected in topics.items():
        messages = found.get(relative(topic))
        for came in messages.types() if messages and expected else []:
            if came != type_of(expected):
                raise BagError(f"{folder}: {relative(topic)}: expected {expected}, got {came}")


def _messages(folder: Path, information: dict[str, Any]) -> Iterator[tuple[ChannelInfo, Message]]:
    """Yield all messages, each with its channel; at the end, hold their number against the totals.

    Raises:
        BagError: if a file is not whole, or of another kind.
    """
    form = str(information.get("compression_format") or "")
    if information.get("compression_mode") and form not in ("", "zstd"):
        raise BagError(
            f"{folder}: expected messages or files compressed by zstd, got {form}; record it anew"
        )
    counts: dict[ChannelInfo, int] = {}
    unknown = 0
    for path in listed(folder, information):
        with opened(path) as reading:
            for message in reading.messages():
                channel = message.channel
                if channel is None:
                    unknown += 1
                    continue
                counts[channel] = counts.get(channel, 0) + 1
                yield channel, message
    _compare(folder, information, counts, unknown)


def _compare(
    folder: Path, information: dict[str, Any], counts: dict[ChannelInfo, int], unknown: int
) -> None:
    """Say where a bag does not hold what its metadata.yaml announces."""
    announced = _recorded(information)
    read: dict[str, int] = {}
    for channel, count in counts.items():
        name = relative(channel.topic)
        read[name] = read.get(name, 0) + count
    different = [
        f"{name}: {read.get(name, 0)} of {count} messages"
        for name, (_, count) in announced.items()
        if read.get(name, 0) != count
    ]
    different += [
        f"{name}: {count} messages that metadata.yaml does not name"
        for name, count in read.items()
        if name not in announced
    ]
    if unknown:
        different.append(f"{unknown} messages of no known topic are left out")
    if different:
        warnings.warn(f"{folder}: read {'; '.join(different)}", BagWarning, stacklevel=3)


def _collect(
    folder: Path, information: dict[str, Any], wanted: list[str]
) -> tuple[int, dict[str, TopicMessages]]:
    """Gather the wanted messages, and the first stamp of all topics with a header."""
    found = {name: TopicMessages(name) for name in wanted}
    firsts: dict[str, int] = {}
    names: dict[ChannelInfo, str] = {}
    for channel, message in _messages(folder, information):
        if channel not in names:
            names[channel] = name = relative(channel.topic)
            data = plain(message.data)
            if name not in firsts and len(data) >= STAMP_AT + STAMP.size and has_header(channel):
                firsts[name] = first_stamp(data)
        name = names[channel]
        if name in found:
            found[name].add(channel, message)
    if missing := [name for name in wanted if not len(found[name])]:
        raise BagError(
            f"{folder}: expected {', '.join(map(absolute, missing))} as metadata.yaml says, got "
            f"none; delete metadata.yaml and run `ros2 run cabols_control recover {folder}`"
        )
    return _first_of(firsts), found


def _first_of(firsts: dict[str, int]) -> int:
    """Earliest stamp; zero means `no time yet` where the others are of the wall clock."""
    stamps = sorted(firsts.values())
    if stamps and stamps[-1] > YEAR_NS:
        stamps = [stamp for stamp in stamps if stamp]
    return stamps[0] if stamps else 0


def _series_or_error(name: str, messages: TopicMessages, start_ns: int) -> Series | BagError:
    try:
        return _series(name, messages, start_ns)
    except BagError as error:
        return error


def _series(name: str, messages: TopicMessages, start_ns: int) -> Series:
    decoded = messages.take()
    columns = decoded.columns
    log_time, publish_time, sequence = decoded.times.T
    headed = f"{HEADER_STAMP}.sec" in columns
    stamp_ns = column_ns(columns) if headed else np.zeros(0, np.int64)
    stamp: npt.NDArray[np.float64] = np.multiply(1e-9, stamp_ns - start_ns)
    if start_ns > YEAR_NS:
        stamp[stamp_ns == 0] = np.nan
    return Series(
        topic=name,
        type_name=decoded.type_name,
        log_time_ns=np.ascontiguousarray(log_time),
        publish_time_ns=np.ascontiguousarray(publish_time),
        sequence=np.ascontiguousarray(sequence),
        stamp_ns=stamp_ns,
        stamp=stamp,
        _columns=columns,
    )
