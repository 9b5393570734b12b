# SPDX-License-Identifier: Apache-2.0
"""Write rosbag2 folders of MCAP files, one or split, that survive a kill of their writer."""

from __future__ import annotations

import contextlib
import fcntl
import os
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from mcap.writer import CompressionType, Writer

from cabols_control.bags.definitions import Definition, Definitions
from cabols_control.bags.errors import BagError, MissingBagError
from cabols_control.bags.metadata import OfferedQos, Summary, TopicSummary, write_metadata
from cabols_control.bags.names import absolute
from cabols_control.bags.storage.records import FRAME, QOS, Attachment, ChannelInfo, Private

METADATA_NAME = "cabols"
TEMPORARY_SUFFIX = ".recovering"
LIBRARY = "cabols_control"


class McapFile:
    """An MCAP file with ROS 2 channels, and the totals that metadata.yaml needs.

    Attributes:
        summary: see Summary.
    """

    def __init__(self, path: Path, file_name: str, replace: bool = False) -> None:
        """Create the file and lock it against `recover`.

        Args:
            path: of the file.
            file_name: its name in metadata.yaml.
            replace: whether an existing file is overwritten.
        """
        self.summary = Summary(file_name)
        self._stream = path.open("wb" if replace else "xb")
        with contextlib.suppress(OSError):  # not every file system has locks
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._writer = Writer(self._stream, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library=LIBRARY)
        self._schemas: dict[tuple[str, str], int] = {}
        self._copied: dict[tuple[str, str, bytes], int] = {}
        self._topics: dict[int, TopicSummary] = {}

    def add_metadata(self, name: str, content: dict[str, str]) -> None:
        """Write a metadata record at once.

        Args:
            name: of the record.
            content: text by key.
        """
        self._writer.add_metadata(name, content)
        self._stream.flush()

    def add_channel(self, topic: str, definition: Definition, qos_text: str) -> int:
        """Add a channel and return its number; qos_text is a YAML list of profiles.

        Args:
            topic: absolute name.
            definition: of its type.
            qos_text: YAML list of the publishers' profiles.
        """
        key = (definition.type_name, definition.text)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(
                definition.type_name, "ros2msg", definition.text.encode()
            )
        metadata = {"offered_qos_profiles": qos_text, "topic_type_hash": definition.type_hash}
        channel = self._writer.register_channel(topic, "cdr", self._schemas[key], metadata)
        entry = TopicSummary(topic, definition.type_name, definition.type_hash, qos_text)
        self._topics[channel] = entry
        self.summary.topics.append(entry)
        return channel

    def copy_channel(self, channel: ChannelInfo, definition: bytes) -> int:
        """Add a channel of another file as it is there, and return its number.

        Args:
            channel: of the other file; with any encoding, or without a schema.
            definition: of its type, as the other file has it or mended.
        """
        schema = channel.schema
        number = 0
        if schema.number or schema.name:
            key = (schema.name, schema.encoding, definition)
            if key not in self._copied:
                self._copied[key] = self._writer.register_schema(*key)
            number = self._copied[key]
        metadata = dict(channel.metadata)
        if QOS in metadata:
            metadata[QOS] = channel.qos_text
        copy = self._writer.register_channel(channel.topic, channel.encoding, number, metadata)
        entry = TopicSummary(channel.topic, schema.name, channel.type_hash, channel.qos_text)
        entry.encoding = channel.encoding
        self._topics[copy] = entry
        self.summary.topics.append(entry)
        return int(copy)

    def add_attachment(self, attachment: Attachment) -> None:
        """Copy an attachment of another file."""
        self._writer.add_attachment(
            attachment.create_time_ns,
            attachment.log_time_ns,
            attachment.name,
            attachment.media_type,
            attachment.data,
        )

    def add_private(self, record: Private) -> None:
        """Copy another program's record."""
        self.flush()
        self._stream.write(FRAME.pack(record.opcode, len(record.content)) + record.content)

    def add_message(
        self, channel: int, log_time_ns: int, publish_time_ns: int, data: bytes, sequence: int = 0
    ) -> None:
        """Add one message to the chunk in progress.

        Args:
            channel: number that add_channel returned.
            log_time_ns: when it was received.
            publish_time_ns: when it was published.
            data: serialised message.
            sequence: publication number; 0: not known.
        """
        self._writer.add_message(channel, log_time_ns, data, publish_time_ns, sequence)
        summary = self.summary
        if summary.start_ns is None or log_time_ns < summary.start_ns:
            summary.start_ns = log_time_ns
        if log_time_ns > summary.end_ns:
            summary.end_ns = log_time_ns
        self._topics[channel].messages += 1

    def flush(self) -> None:
        """End the chunk and hand it to the kernel; from then on it survives kill -9."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    @property
    def size(self) -> int:
        """Bytes that the kernel has."""
        return self._stream.tell()

    def finish(self, sync: bool = False) -> None:
        """Write index and footer; with sync, they are on the disk on return."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.flush()
        if sync:
            os.fsync(self._stream.fileno())
        self._stream.close()

    def abandon(self) -> None:
        """Close without index, as a kill would leave it."""
        with contextlib.suppress(OSError):
            self._stream.close()


@dataclass(frozen=True)
class Split:
    """When a bag goes on in another file, as `ros2 bag record` splits: at the next flush.

    Attributes:
        size: of a file [bytes]; 0: whatever its size.
        duration_s: from a file's first message to its last [s]; 0: however long.
    """

    size: int = 0
    duration_s: float = 0.0

    def due(self, file: McapFile) -> bool:
        """Whether a file has become as large or as long."""
        if not file.summary.messages:
            return False
        long = 1e-9 * file.summary.duration_ns >= self.duration_s > 0.0
        return long or file.size >= self.size > 0


class BagWriter:
    """A bag that is being recorded; not thread-safe."""

    def __init__(
        self, folder: str | Path, metadata: dict[str, str], split: Split | None = None
    ) -> None:
        """Create the folder and the file.

        Args:
            folder: of the bag; new or empty.
            metadata: free text by key; at once in an MCAP metadata record named `cabols`, at the
                end in metadata.yaml's custom_data.
            split: when another file begins; None: never.

        Raises:
            BagError: if the folder is not empty, or cannot be created.
        """
        self.folder = Path(folder)
        self._metadata = dict(metadata)
        self._definitions = Definitions()
        self._channels: dict[str, int] = {}
        self._split = split or Split()
        self._full = False
        self._whole: list[Summary] = []
        self._added: list[tuple[str, Definition, str]] = []
        make_folder(self.folder)
        try:
            self._file = self._open()
        except OSError as error:
            raise self._failure(error) from error

    def _open(self) -> McapFile:
        """Begin the next file, with what each has of its own: metadata and topics."""
        name = mcap_name(self.folder, len(self._whole))
        self.path = self.folder / name
        file = McapFile(self.path, name)
        file.add_metadata(METADATA_NAME, self._metadata)
        self._channels = {added[0]: file.add_channel(*added) for added in self._added}
        return file

    def _go_on(self) -> None:
        """Complete the present file, and begin another."""
        self._file.finish()
        self._whole.append(self._file.summary)
        self._file, self._full = self._open(), False

    def add_topic(self, topic: str, type_name: str, qos: OfferedQos | None = None) -> None:
        """Add a topic before its first message.

        Args:
            topic: absolute, or relative to /cabols.
            type_name: e.g. `cabols_msgs/msg/LimbState`.
            qos: with which it is published.

        Raises:
            BagError: if the topic exists or no definition of the type is found.
        """
        name = absolute(topic)
        if name in self._channels:
            raise BagError(f"{name}: expected a new topic, got it twice; add it once")
        definition = self._definitions.get(type_name)
        self._added.append((name, definition, (qos or OfferedQos()).text()))
        self._channels[name] = self._file.add_channel(*self._added[-1])

    def describe(self, metadata: dict[str, str]) -> None:
        """Replace the free text of the metadata; at once in the file, where the last one counts.

        Args:
            metadata: text by key.

        Raises:
            BagError: if the disk refuses.
        """
        self._metadata = dict(metadata)
        try:
            self._file.add_metadata(METADATA_NAME, self._metadata)
        except OSError as error:
            raise self._failure(error) from error

    def write(
        self,
        topic: str,
        log_time_ns: int,
        publish_time_ns: int,
        data: bytes,
        sequence: int = 0,
    ) -> None:
        """Add one serialised message.

        Args:
            topic: as given to add_topic.
            log_time_ns: when it was received.
            publish_time_ns: when it was published.
            data: CDR, with its 4-byte header.
            sequence: publication number; 0: unknown.

        Raises:
            BagError: for an unknown topic or if the disk refuses.
        """
        name = absolute(topic)
        if name not in self._channels:
            known = ", ".join(self._channels) or "none"
            raise BagError(f"{name}: expected a topic of this bag ({known}); call add_topic first")
        try:
            if self._full:
                self._go_on()
            self._file.add_message(
                self._channels[name], log_time_ns, publish_time_ns, data, sequence & 0xFFFFFFFF
            )
        except OSError as error:
            raise self._failure(error) from error

    def flush(self) -> None:
        """Make everything written so far safe against kill -9 (not against a power cut).

        The next message goes into another file where that is due.

        Raises:
            BagError: if the disk refuses.
        """
        try:
            self._file.flush()
            self._full = self._split.due(self._file)
        except OSError as error:
            raise self._failure(error) from error

    def close(self) -> None:
        """Complete the bag.

        Raises:
            BagError: if the disk refuses; `recover` then saves what was flushed.
        """
        try:
            self._file.finish()
            write_metadata(self.folder, [*self._whole, self._file.summary], self._metadata)
        except OSError as error:
            raise self._failure(error) from error

    def abandon(self) -> None:
        """Stop without completing the bag, after a failure; `recover` can complete it."""
        self._file.abandon()

    @property
    def messages(self) -> dict[str, int]:
        """Number of messages by absolute topic."""
        files = [*self._whole, self._file.summary]
        topics = [topic for file in files for topic in file.topics]
        return {
            name: sum(topic.messages for topic in topics if topic.name == name)
            for name in self._channels
        }

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()

    def _failure(self, error: OSError) -> BagError:
        return BagError(
            f"{self.folder}: expected to write the bag, got {error.strerror or error}; see to the "
            f"disk, then run `ros2 run cabols_control recover {self.folder}` for what was saved"
        )


def mcap_name(folder: Path, number: int = 0) -> str:
    """Name of a bag's file, as rosbag2 would call it.

    Args:
        folder: of the bag.
        number: of the file, from 0.
    """
    return f"{folder.resolve().name}_{number}.mcap"


def make_folder(folder: Path) -> None:
    """Create a folder for a new bag.

    Raises:
        BagError: if it is not empty or cannot be created.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = sorted(p.name for p in folder.iterdir() if p.suffix != TEMPORARY_SUFFIX)
    except OSError as error:
        raise MissingBagError(
            f"{folder}: expected to create a folder for the bag, got {error.strerror}; "
            "name another one"
        ) from error
    if there:
        raise MissingBagError(
            f"{folder}: expected a new or empty folder for the bag, got one with "
            f"{', '.join(there[:3])}; name another one or remove it"
        )
