"""Reading bags for analysis: arrays by topic and field, or one message after the other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_typestore
from rosbags.typesys.store import Typestore

from cabols_control.bags.columns import Column, decode
from cabols_control.bags.definitions import parse_definition
from cabols_control.bags.errors import BagError
from cabols_control.bags.metadata import custom_data, read_metadata
from cabols_control.bags.names import absolute, relative
from cabols_control.bags.salvage import Message, Salvage
from cabols_control.stamps import HEADER_STAMP, column_ns, first_stamp

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
    start_ns, channels = _collect(folder, information, wanted)
    series = {}
    for name in wanted:
        series[name] = _series(name, channels[name], start_ns)
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
    for salvage, message in _messages(folder, information):
        name = relative(salvage.channels[message.channel].topic)
        if name in wanted:
            yield name, message.log_time_ns, message.data


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
    channels: dict[str, _Channel] = {}
    numbers: dict[int, _Channel | None] = {}
    present: Salvage | None = None
    count = 0
    for salvage, message in _messages(folder, information):
        if salvage is not present:
            present, numbers = salvage, {}
        if message.channel not in numbers:
            found = salvage.channels[message.channel]
            name, definition = relative(found.topic), found.definition
            numbers[message.channel] = None
            if name in wanted:
                channel = channels.setdefault(name, _Channel(definition.type_name, definition.text))
                numbers[message.channel] = channel
        entry = numbers[message.channel]
        if entry is None:
            continue
        entry.raws.append(message.data)
        if timed:
            entry.times.append((message.log_time_ns, message.publish_time_ns, message.sequence))
        count += 1
        if count >= size:
            yield _drain(channels)
            count = 0
    if count:
        yield _drain(channels)


def _drain(channels: dict[str, _Channel]) -> dict[str, dict[str, Column]]:
    """Decode the gathered messages of all channels, and drop their bytes."""
    found = {}
    for name, channel in channels.items():
        if channel.raws:
            found[name] = _decode(name, channel)
            if channel.times:
                log_time, publish_time, *_ = np.array(channel.times, np.int64).T
                found[name].update({LOG_TIME: log_time, PUBLISH_TIME: publish_time})
            channel.raws, channel.times = [], []
    return found


class _Channel:
    """Messages that one pass gathers of a topic."""

    def __init__(self, type_name: str, text: str) -> None:
        self.type_name = type_name
        self.text = text
        self.times: list[tuple[int, int, int]] = []
        self.raws: list[bytes] = []
        self.store: Typestore | None = None


def _recorded(information: dict[str, Any]) -> dict[str, tuple[str, int]]:
    """Type and number of messages by relative name, from metadata.yaml."""
    found: dict[str, tuple[str, int]] = {}
    for entry in information.get("topics_with_message_count") or []:
        topic = entry["topic_metadata"]
        found[relative(topic["name"])] = (topic["type"], int(entry["message_count"]))
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
        elif type_name and came != type_name:
            problems.append(f"{relative(topic)}: expected {type_name}, got {came}")
        elif not count:
            problems.append(f"{relative(topic)}: expected messages, got none")
    if problems:
        raise BagError(f"{folder}: {'; '.join(problems)}. The bag has {', '.join(present)}")
    return [relative(topic) for topic in types]


def _messages(folder: Path, information: dict[str, Any]) -> Iterator[tuple[Salvage, Message]]:
    storage = information.get("storage_identifier")
    if storage != "mcap" or information.get("compression_mode"):
        raise BagError(
            f"{folder}: expected MCAP files without rosbag2's own compression, got "
            f"{storage} {information.get('compression_mode', '')}; use `ros2 bag convert`"
        )
    for name in information["relative_file_paths"]:
        salvage = Salvage(folder / Path(name).name, strict=True)
        for message in salvage.messages():
            if message.channel not in salvage.channels:
                raise BagError(
                    f"{folder}: expected only messages of known channels, got one of channel "
                    f"{message.channel}; run recover"
                )
            yield salvage, message


def _collect(
    folder: Path, information: dict[str, Any], wanted: list[str]
) -> tuple[int, dict[str, _Channel]]:
    """Gather the wanted messages, and the first stamp of all topics with a header."""
    found: dict[str, _Channel] = {}
    firsts: dict[str, int] = {}
    names: dict[int, str] = {}
    present: Salvage | None = None
    for salvage, message in _messages(folder, information):
        if salvage is not present:
            present, names = salvage, {}
        if message.channel not in names:
            channel = salvage.channels[message.channel]
            names[message.channel] = name = relative(channel.topic)
            if _has_header(channel.definition.text):
                firsts.setdefault(name, first_stamp(message.data))
            if name not in found:
                found[name] = _Channel(channel.definition.type_name, channel.definition.text)
        name = names[message.channel]
        if name in wanted:
            entry = found[name]
            entry.raws.append(message.data)
            entry.times.append((message.log_time_ns, message.publish_time_ns, message.sequence))
    if missing := [name for name in wanted if name not in found]:
        raise BagError(
            f"{folder}: expected {', '.join(map(absolute, missing))} as metadata.yaml says, got "
            "none; delete metadata.yaml and run recover"
        )
    return _first_of(firsts), found


def _has_header(text: str) -> bool:
    fields = (line for line in text.splitlines() if "=" not in line and line.strip())
    return next(fields, "").split()[:1] in (["std_msgs/Header"], ["std_msgs/msg/Header"])


def _first_of(firsts: dict[str, int]) -> int:
    """Earliest stamp; zero means `no time yet` where the others are of the wall clock."""
    stamps = sorted(firsts.values())
    if stamps and stamps[-1] > YEAR_NS:
        stamps = [stamp for stamp in stamps if stamp]
    return stamps[0] if stamps else 0


def _decode(name: str, channel: _Channel) -> dict[str, Column]:
    if channel.store is None:
        channel.store = _store(channel)
    try:
        return decode(channel.raws, channel.type_name, channel.store)
    except SerdeError as error:
        raise BagError(
            f"{name}: expected {channel.type_name} messages, got bytes that are none ({error}); "
            "were definition and messages recorded from different builds?"
        ) from error


def _series(name: str, channel: _Channel, start_ns: int) -> Series:
    columns = _decode(name, channel)
    log_time, publish_time, sequence = np.array(channel.times, np.int64).reshape(-1, 3).T
    headed = f"{HEADER_STAMP}.sec" in columns
    stamp_ns = column_ns(columns) if headed else np.zeros(0, np.int64)
    stamp: npt.NDArray[np.float64] = np.multiply(1e-9, stamp_ns - start_ns)
    if start_ns > YEAR_NS:
        stamp[stamp_ns == 0] = np.nan
    return Series(
        topic=name,
        type_name=channel.type_name,
        log_time_ns=np.ascontiguousarray(log_time),
        publish_time_ns=np.ascontiguousarray(publish_time),
        sequence=np.ascontiguousarray(sequence),
        stamp_ns=stamp_ns,
        stamp=stamp,
        _columns=columns,
    )


def _store(channel: _Channel) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(parse_definition(channel.type_name, channel.text))
    except TypesysError as error:
        raise BagError(
            f"{channel.type_name}: expected a complete definition in the bag, got {error}; "
            "record it anew"
        ) from error
    return store
