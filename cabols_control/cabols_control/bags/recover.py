"""Recover bags whose recorder was killed: `recover BAG`."""

from __future__ import annotations

import contextlib
import fcntl
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cabols_control.bags.definitions import verified
from cabols_control.bags.errors import BagError, MissingBagError
from cabols_control.bags.metadata import (
    FILE_NAME,
    Summary,
    custom_data,
    read_metadata,
    write_metadata,
)
from cabols_control.bags.names import relative
from cabols_control.bags.salvage import Salvage
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
    """

    folder: Path
    messages: int
    topics: dict[str, int]
    duration_s: float
    dropped_bytes: int
    unknown: int
    changed: bool


def recover(bag: str | Path, output: str | Path | None = None) -> Recovery:
    """Make a complete bag of the readable part of a killed or damaged recording.

    Args:
        bag: folder with one .mcap, or the .mcap in it.
        output: new folder for the complete bag; None: in place. The new file is written next to
            the old one, which it replaces when it is complete, so that nothing is lost if this
            is killed, too.

    Returns:
        What was saved.

    Raises:
        BagError: if there is no such file, it is no recording, it is being recorded, or the
            result cannot be written.
    """
    source = _find(Path(bag))
    target = source.parent if output is None else Path(output)
    name = source.name
    if output is not None:
        make_folder(target)
        name = mcap_name(target)
    try:
        with _unused(source):
            return _rewrite(source, target, name, in_place=output is None)
    except OSError as error:
        raise BagError(
            f"{target}: expected to write the recovered bag, got {error.strerror or error}; "
            "the recording is as it was: see to the disk, or name another output"
        ) from error


def _rewrite(source: Path, target: Path, name: str, in_place: bool) -> Recovery:
    salvage = Salvage(source, strict=False)
    temporary = target / (name + TEMPORARY_SUFFIX)
    file = McapFile(temporary, name, replace=True)
    try:
        unknown = _copy(salvage, file)
        custom = _custom(salvage, source.parent)
        whole = salvage.complete and not salvage.dropped_bytes and not unknown
        untouched = in_place and whole and (target / FILE_NAME).exists()
        if not untouched:
            for key, content in {**salvage.metadata, METADATA_NAME: custom}.items():
                # rosbag2 keeps a copy of metadata.yaml there, which would no longer be true.
                if key != "rosbag2":
                    file.add_metadata(key, content)
            file.finish(sync=True)
            # An older metadata.yaml must not describe the new file.
            (target / FILE_NAME).unlink(missing_ok=True)
            temporary.replace(target / name)
            write_metadata(target, file.summary, custom)
    finally:
        file.abandon()
        temporary.unlink(missing_ok=True)
    return _result(file.summary, target, salvage.dropped_bytes, unknown, not untouched)


def _copy(salvage: Salvage, file: McapFile) -> int:
    """Copy all messages; returns the number of those without a known topic."""
    channels: dict[int, int] = {}
    unknown = 0

    def channel_of(number: int) -> int:
        if number not in channels:
            info = salvage.channels[number]
            definition = verified(info.definition)
            channels[number] = file.add_channel(info.topic, definition, info.qos_text)
        return channels[number]

    for message in salvage.messages():
        if message.channel not in salvage.channels:
            unknown += 1
            continue
        file.add_message(
            channel_of(message.channel),
            message.log_time_ns,
            message.publish_time_ns,
            message.data,
            message.sequence,
        )
    for number in salvage.channels:
        channel_of(number)
    return unknown


def _custom(salvage: Salvage, folder: Path) -> dict[str, str]:
    if METADATA_NAME in salvage.metadata:
        return salvage.metadata[METADATA_NAME]
    try:
        return custom_data(read_metadata(folder))
    except BagError:
        return {}


def _result(
    summary: Summary, folder: Path, dropped_bytes: int, unknown: int, changed: bool
) -> Recovery:
    topics: dict[str, int] = {}
    for topic in summary.topics:
        name = relative(topic.name)
        topics[name] = topics.get(name, 0) + topic.messages
    duration_s = 1e-9 * summary.duration_ns
    return Recovery(folder, summary.messages, topics, duration_s, dropped_bytes, unknown, changed)


def _find(bag: Path) -> Path:
    if bag.is_file():
        files = [bag]
    elif bag.is_dir():
        files = sorted(bag.glob("*.mcap"))
    else:
        raise MissingBagError(
            f"{bag}: expected a bag's folder or .mcap file, got nothing; check the path"
        )
    if len(files) != 1:
        raise BagError(
            f"{bag}: expected one .mcap in the bag, got {len(files)}; name one file and an output"
        )
    return files[0]


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


if __name__ == "__main__":
    sys.exit(main())
