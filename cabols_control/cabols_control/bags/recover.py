# SPDX-License-Identifier: Apache-2.0
"""Recover bags whose recorder was killed: `recover BAG`."""

from __future__ import annotations

import contextlib
import fcntl
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cabols_control.bags.definitions import Definition, verified
from cabols_control.bags.errors import BagError, MissingBagError
from cabols_control.bags.metadata import (
    FILE_NAME,
    Compression,
    Summary,
    custom_data,
    read_metadata,
    write_metadata,
)
from cabols_control.bags.names import relative
from cabols_control.bags.storage.files import COMPRESSED, SQLITE, files_of, opened
from cabols_control.bags.storage.records import Attachment, ChannelInfo, Metadata, Private
from cabols_control.bags.storage.salvage import Salvage
from cabols_control.bags.storage.sqlite_file import SqliteFile
from cabols_control.bags.topic_messages import ZSTD
from cabols_control.bags.writer import (
    METADATA_NAME,
    TEMPORARY_SUFFIX,
    McapFile,
    make_folder,
    mcap_name,
)
from cabols_control.command_line import DONE, CommandParser, command


@dataclass(frozen=True)
class Recovery:
    """What was saved.

    Attributes:
        folder: of the complete bag.
        messages: number of all messages.
        topics: number by topic, relative to /cabols.
        duration_s: from the first message to the last.
        dropped_bytes: of records that were cut or damaged, also where their beginning was saved.
        unknown: messages dropped because the record that names their topic is lost.
        changed: False if the bag was complete already and was left as it is.
        expected: number of messages that the file's statistics or metadata.yaml announce, if they
            announce more than were saved; else that of those saved.
    """

    folder: Path
    messages: int
    topics: dict[str, int]
    duration_s: float
    dropped_bytes: int
    unknown: int
    changed: bool
    expected: int = 0


def recover(bag: str | Path, output: str | Path | None = None) -> Recovery:
    """Make a complete bag of the readable part of a killed or damaged recording.

    What can be copied is copied as it is: messages of any encoding, also without a definition,
    attachments, metadata and other programs' records. Nothing is decoded.

    Args:
        bag: folder of the bag, of one file or split, or a .mcap in it.
        output: new folder for the complete bag; None: in place. The new files are written next to
            the old ones, which they replace when all are complete, so that nothing is lost if this
            is killed, too. Files that are whole stay as they are.

    Returns:
        What was saved.

    Raises:
        BagError: if there is no such file, it is no recording, it is being recorded, or the
            result cannot be written.
    """
    sources = _find(Path(bag), in_place=output is None)
    target = sources[0].parent if output is None else Path(output)
    names = [source.name for source in sources]
    if output is not None:
        make_folder(target)
        names = [mcap_name(target, number) for number in range(len(sources))]
    try:
        with contextlib.ExitStack() as locks:
            for source in sources:
                locks.enter_context(_unused(source))
            return _Rewriting(target, in_place=output is None).run(sources, names)
    except OSError as error:
        raise BagError(
            f"{target}: expected to write the recovered bag, got {error.strerror or error}; "
            "the recording is as it was: see to the disk, or name another output"
        ) from error


class _Rewriting:
    """Copies files of one bag, and completes it."""

    def __init__(self, target: Path, in_place: bool) -> None:
        self._target = target
        self._in_place = in_place
        self._dropped_bytes = self._unknown = 0
        self._expected: int | None = 0
        self._metadata: dict[str, str] | None = None
        self._packed = False

    def run(self, sources: list[Path], names: list[str]) -> Recovery:
        old = _old_metadata(sources[0].parent)
        files: list[McapFile] = []
        ready: list[tuple[Path, Path]] = []
        try:
            for source, name in zip(sources, names, strict=True):
                temporary = self._target / (name + TEMPORARY_SUFFIX)
                files.append(McapFile(temporary, name, replace=True))
                ready.append((temporary, self._target / name))
                if self._copy(source, files[-1], custom_data(old)) and self._in_place:
                    files[-1].abandon()
                    temporary.unlink()
                    ready.pop()
            summaries = [file.summary for file in files]
            messages = sum(summary.messages for summary in summaries)
            changed = bool(ready) or not _describes(old, messages, names)
            if changed:
                # An older metadata.yaml must not describe the new files.
                (self._target / FILE_NAME).unlink(missing_ok=True)
                for temporary, place in ready:
                    temporary.replace(place)
                custom = custom_data(old) if self._metadata is None else self._metadata
                write_metadata(self._target, summaries, custom, self._compression(old))
        finally:
            for file in files:
                file.abandon()
            for temporary, _ in ready:
                temporary.unlink(missing_ok=True)
        same = [source.name for source in sources] == _listed(old)
        announced = old.get("message_count") if same else None
        return self._result(summaries, changed, announced)

    def _copy(self, source: Path, file: McapFile, custom: dict[str, str]) -> bool:
        """Copy a file; returns whether it was whole."""
        with opened(source, strict=False) as reading:
            copied = _copy_records(reading, file)
            self._dropped_bytes += reading.dropped_bytes
            self._unknown += copied.unknown
            self._packed = self._packed or copied.packed
            if self._expected is not None:
                self._expected += copied.messages if reading.expected is None else reading.expected
            if METADATA_NAME in reading.metadata:
                self._metadata = reading.metadata[METADATA_NAME]
                custom = self._metadata
            if reading.whole and self._in_place:
                return True
            file.add_metadata(METADATA_NAME, custom)
        file.finish(sync=True)
        return False

    def _compression(self, old: dict[str, Any]) -> Compression | None:
        """rosbag2's compression of single messages, which are copied as they are."""
        mode = str(old.get("compression_mode") or "").upper()
        if mode == "MESSAGE":
            return Compression(str(old.get("compression_format") or "zstd"), mode)
        return Compression("zstd", "MESSAGE") if self._packed else None

    def _result(self, summaries: list[Summary], changed: bool, announced: Any) -> Recovery:
        topics: dict[str, int] = {}
        for topic in (topic for summary in summaries for topic in summary.topics):
            name = relative(topic.name)
            topics[name] = topics.get(name, 0) + topic.messages
        begun = [summary for summary in summaries if summary.start_ns is not None]
        first = min((summary.start_ns or 0 for summary in begun), default=0)
        last = max((summary.end_ns for summary in begun), default=0)
        messages = sum(topics.values())
        counts = [count for count in (self._expected, announced) if isinstance(count, int)]
        return Recovery(
            folder=self._target,
            messages=messages,
            topics=topics,
            duration_s=1e-9 * (last - first),
            dropped_bytes=self._dropped_bytes,
            unknown=self._unknown,
            changed=changed,
            expected=max([messages, *counts]),
        )


@dataclass
class _Copied:
    """What was copied of a file: messages without a known topic; whether rosbag2 packed them."""

    messages: int = 0
    unknown: int = 0
    packed: bool = False


def _copy_records(reading: Salvage | SqliteFile, file: McapFile) -> _Copied:
    """Copy all records, and the channels without messages."""
    channels: dict[ChannelInfo, int] = {}
    found = _Copied()
    for record in reading.records():
        if isinstance(record, Attachment):
            file.add_attachment(record)
        elif isinstance(record, Private):
            file.add_private(record)
        elif isinstance(record, Metadata):
            # rosbag2 keeps a copy of metadata.yaml there, which would no longer be true.
            if record.name not in ("rosbag2", METADATA_NAME):
                file.add_metadata(record.name, record.content)
        elif record.channel is None:
            found.unknown += 1
        else:
            if record.channel not in channels:
                channels[record.channel] = _copy_channel(record.channel, file)
            file.add_message(
                channels[record.channel],
                record.log_time_ns,
                record.publish_time_ns,
                record.data,
                record.sequence,
            )
            found.messages += 1
            found.packed = found.packed or record.data[:4] == ZSTD
    for channel in reading.channels:
        if channel not in channels:
            channels[channel] = _copy_channel(channel, file)
    return found


def _copy_channel(channel: ChannelInfo, file: McapFile) -> int:
    """Copy a channel; a damaged definition is replaced by the installed one of the same hash."""
    schema = channel.schema
    definition = schema.data
    if schema.encoding == "ros2msg" and channel.type_hash:
        text = definition.decode("utf-8", "replace")
        with contextlib.suppress(BagError):
            recorded = Definition(channel.type_name, text, channel.type_hash)
            found = verified(recorded)
            if found is not recorded and found.type_hash == channel.type_hash:
                definition = found.text.encode()
    return file.copy_channel(channel, definition)


def _old_metadata(folder: Path) -> dict[str, Any]:
    """What metadata.yaml says; empty if there is none that can be read."""
    try:
        return read_metadata(folder)
    except BagError:
        return {}


def _describes(old: dict[str, Any], messages: int, names: list[str]) -> bool:
    """Whether a metadata.yaml is that of these files."""
    return old.get("message_count") == messages and _listed(old) == names


def _listed(old: dict[str, Any]) -> list[str]:
    return [Path(str(name)).name for name in old.get("relative_file_paths", [])]


def _find(bag: Path, in_place: bool) -> list[Path]:
    """Files of the bag in the order of recording."""
    if bag.is_file():
        others = [path for path in files_of(bag.parent) if path != bag]
        if in_place and others:
            raise BagError(
                f"{bag}: expected the folder of a split bag, or an output for this file alone, got "
                f"one of {1 + len(others)} files; name {bag.parent}, or an output"
            )
        files = [bag]
    elif bag.is_dir():
        files = files_of(bag)
    else:
        raise MissingBagError(
            f"{bag}: expected a bag's folder or .mcap file, got nothing; check the path"
        )
    if not files:
        raise BagError(f"{bag}: expected a bag's .mcap or .db3 files, got none; check the path")
    odd = [path.name for path in files if path.suffix in (SQLITE, COMPRESSED)]
    if in_place and odd:
        raise BagError(
            f"{bag}: expected an output, got none for {', '.join(odd[:3])}, which cannot be "
            f"recovered in place; run `ros2 run cabols_control recover {bag} --output NEW_FOLDER`"
        )
    return files


@contextlib.contextmanager
def _unused(path: Path) -> Iterator[None]:
    """Hold the lock that a running recorder would hold."""
    with path.open("rb") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BagError(
                f"{path}: expected a recording that has ended, got one that is being written; "
                "stop its recorder first"
            ) from None
        yield


@command
def main(arguments: list[str] | None = None) -> int:
    """Entry point.

    Returns:
        Exit code: 0 saved (or complete already), 1 nothing could be saved, 2 wrong arguments.
    """
    parser = CommandParser(
        "recover", "Make a complete rosbag2 folder of what a killed recorder has left."
    )
    parser.add_argument("bag", type=Path, help="folder of the bag, or the .mcap file in it")
    parser.add_argument(
        "-o", "--output", type=Path, help="new folder for the complete bag (default: in place)"
    )
    options = parser.parse_args(arguments)
    _report(recover(options.bag, options.output))
    return DONE


def _report(saved: Recovery) -> None:
    state = "saved" if saved.changed else "complete already, left as it is"
    print(f"{saved.folder}: {state}: {saved.messages} messages in {saved.duration_s:.3f} s")
    for topic, count in saved.topics.items():
        print(f"  {count:9d}  {topic}")
    if saved.dropped_bytes or saved.unknown:
        print(
            f"  dropped: {saved.dropped_bytes} bytes of cut or damaged records, "
            f"{saved.unknown} messages of unknown topics"
        )
    if saved.messages < saved.expected:
        print(f"  saved: {saved.messages} of the {saved.expected} messages that it announced")


if __name__ == "__main__":
    sys.exit(main())
