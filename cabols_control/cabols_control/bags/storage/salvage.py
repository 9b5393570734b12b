# SPDX-License-Identifier: Apache-2.0
"""Read MCAP files from front to back, complete or damaged.

Every record is checked before it is believed: a chunk by its own sizes and its checksum, any other
by what follows it. Behind a damaged one the pass goes on at the next good record, which the file's
index or a search for a chunk whose checksum holds gives.
"""

from __future__ import annotations

import warnings
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode

from cabols_control.bags.errors import BagError, BagWarning
from cabols_control.bags.storage import chunks
from cabols_control.bags.storage.frames import Frames
from cabols_control.bags.storage.records import (
    FRAME,
    MAGIC,
    MESSAGE,
    NO_SCHEMA,
    PRIVATE,
    Attachment,
    ChannelInfo,
    Message,
    Metadata,
    Private,
    RecordError,
    Schema,
    attachment_of,
    channel_of,
    metadata_of,
    schema_of,
)
from cabols_control.bags.storage.summary import FOOTER_SIZE

Record = Message | Attachment | Metadata | Private


class Salvage:
    """One pass through a file.

    Attributes:
        channels: all different ones, up to the present position of the pass.
        metadata: records by name, likewise.
        dropped_bytes: bytes of records that are cut or damaged.
        complete: whether the pass has found index, footer and end.
        seen: number of messages that were read.
        expected: number of messages as the file's statistics say; None: not known.
    """

    def __init__(self, path: Path, strict: bool, opened: IO[bytes] | None = None) -> None:
        """Prepare; messages() reads.

        Args:
            path: of the file.
            strict: whether damage is an error, or skipped and counted.
            opened: its content, seekable, where it is not that of the path itself.
        """
        self._path = path
        self._strict = strict
        self._opened = opened
        self._schemas: dict[int, Schema] = {}
        self._numbers: dict[int, ChannelInfo] = {}
        self.channels: list[ChannelInfo] = []
        self.metadata: dict[str, dict[str, str]] = {}
        self.dropped_bytes = 0
        self.complete = False
        self._damaged = False
        self.seen = 0
        self.expected: int | None = None

    @property
    def whole(self) -> bool:
        """Whether the pass has found nothing cut or damaged."""
        return self.complete and not self._damaged

    def messages(self) -> Iterator[Message]:
        """Yield every readable message in the order of the file.

        Raises:
            BagError: if the file is no MCAP file, or in strict mode not whole.
        """
        for record in self.records():
            if isinstance(record, Message):
                yield record

    def records(self) -> Iterator[Record]:
        """Yield every readable message, attachment, metadata and private record, in order.

        Raises:
            BagError: if the file is no MCAP file, or in strict mode not whole.
        """
        try:
            if self._opened is not None:
                yield from self._pass(self._opened)
            else:
                with self._path.open("rb") as stream:
                    yield from self._pass(stream)
        except OSError as error:
            raise BagError(
                f"{self._path}: expected a readable MCAP file, got {error.strerror or error}; "
                "check path and permissions"
            ) from error

    def _pass(self, stream: IO[bytes]) -> Iterator[Record]:
        start = stream.read(len(MAGIC))
        if not MAGIC.startswith(start):
            raise BagError(
                f"{self._path}: expected an MCAP file, got one that begins with {start!r}; "
                "name the bag's folder or its .mcap"
            )
        frames = self._frames = Frames(stream)
        self.expected = frames.summary.messages
        position = len(MAGIC)
        while position < frames.size and not self.complete:
            record = frames.frame(position)
            if frames.mended:
                frames.mended = False
                self._damage("a damaged frame", 0)
            if record is None:
                position = yield from self._skip(position)
                continue
            opcode, content, end = record
            if opcode == Opcode.FOOTER:
                self.complete = frames.read(end, len(MAGIC)) == MAGIC
                position = end if self.complete else frames.size
            elif opcode == Opcode.DATA_END:
                # The index that follows only repeats the data.
                known = frames.summary.start is not None
                position = frames.size - FOOTER_SIZE if known else frames.after_data(end)
            else:
                yield from self._one(opcode, content)
                position = end
        if not self.complete:
            self._damage("no end: it was cut or its recorder was killed", 0)
        if self.expected is not None and self.seen < self.expected:
            self._damage(f"{self.seen} of the {self.expected} messages that it announces", 0)

    def _skip(self, position: int) -> Generator[Record, None, int]:
        """Go on behind a damaged record: yields what can be saved of it, returns where."""
        cut = self._frames.cut_chunk(position)
        goal = self._frames.next_good(position)
        what = "a cut record" if goal == self._frames.size else "a damaged record"
        if not any(self._frames.read(position, FRAME.size)):
            what = "zeros"
        self._damage(what, goal - position)
        if cut is not None and goal == self._frames.size:
            yield from self._inside(chunks.beginning(cut))
        return goal

    def _one(self, opcode: int, content: bytes) -> Iterator[Record]:
        """Yield what one record holds."""
        if opcode == Opcode.CHUNK:
            self._frames.chunked = True
            try:
                found = chunks.records(content)
            except chunks.ChunkError as error:
                found = chunks.records_by_checksum(content)
                lost = 0 if found else FRAME.size + len(content)
                self._damage(f"a damaged chunk ({error})", lost)
            yield from self._inside(found)
        elif opcode == Opcode.MESSAGE and len(content) < MESSAGE.size:
            self._short(content)
        elif opcode == Opcode.MESSAGE:
            message = self._message(content, 0, len(content))
            if message.channel is not None:
                # By these, the records behind a damaged one are judged.
                number = int.from_bytes(content[:2], "little")
                self._frames.sizes[number] = len(content)
                self._frames.times_ns = (*self._frames.times_ns[:1], message.log_time_ns)
            yield message
        else:
            found_record = self._note(opcode, content)
            if found_record is not None:
                yield found_record

    def _inside(self, data: bytes) -> Iterator[Record]:
        """Yield the messages of a chunk; the last record may be cut."""
        position, end = 0, len(data)
        while position + FRAME.size <= end:
            opcode, length = FRAME.unpack_from(data, position)
            position += FRAME.size
            if position + length > end:
                self._damage("a record beyond its chunk's end", end - position + FRAME.size)
                return
            if opcode != Opcode.MESSAGE:
                self._note(opcode, data[position : position + length])
            elif length < MESSAGE.size:
                self._short(data[position : position + length])
            else:
                yield self._message(data, position, length)
            position += length

    def _short(self, content: bytes) -> None:
        """Leave out a message without channel and times; the others are not affected."""
        self.seen += 1
        self.dropped_bytes += FRAME.size + len(content)
        if self._strict:
            text = f"{self._path}: a message record of {len(content)} bytes is left out"
            warnings.warn(text, BagWarning, stacklevel=2)

    def _message(self, data: bytes, position: int, length: int) -> Message:
        number, sequence, log_time, publish_time = MESSAGE.unpack_from(data, position)
        self.seen += 1
        channel = self._numbers.get(number)
        if channel is None and number in self._frames.summary.channels:
            # The record itself was lost with its chunk; the summary repeats it.
            channel = self._numbers[number] = self._frames.summary.channels[number]
            self.channels.append(channel)
        payload = data[position + MESSAGE.size : position + length]
        return Message(channel, sequence, log_time, publish_time, payload)

    def _note(self, opcode: int, content: bytes) -> Record | None:
        """Keep what a record says about the messages; return it if it stands for itself."""
        try:
            if opcode == Opcode.SCHEMA:
                schema = schema_of(content)
                self._schemas[schema.number] = schema
            elif opcode == Opcode.CHANNEL:
                self._add(*channel_of(content, {0: NO_SCHEMA, **self._schemas}))
            elif opcode == Opcode.METADATA:
                record = metadata_of(content)
                self.metadata[record.name] = record.content
                return record
            elif opcode == Opcode.ATTACHMENT:
                return attachment_of(content)
            elif opcode >= PRIVATE:
                return Private(opcode, content)
        except RecordError as error:
            self._damage(f"a damaged record ({error})", FRAME.size + len(content))
        return None

    def _add(self, number: int, channel: ChannelInfo) -> None:
        """Take a channel; the same one again changes nothing."""
        known = self._numbers.get(number)
        if known is None or not known.same(channel):
            self._numbers[number] = channel
            self.channels.append(channel)

    def _damage(self, what: str, size: int) -> None:
        self.dropped_bytes += size
        self._damaged = True
        if self._strict:
            raise BagError(
                f"{self._path}: expected a whole MCAP file, got one with {what}; run "
                f"`ros2 run cabols_control recover {self._path.parent}`"
            )
