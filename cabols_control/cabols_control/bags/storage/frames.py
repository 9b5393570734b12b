# SPDX-License-Identifier: Apache-2.0
"""Find the records of an MCAP file, whole or damaged.

Every record is checked before it is believed: a chunk by its own sizes and its checksum, any other
by what follows it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import IO

from mcap.opcode import Opcode

from cabols_control.bags.storage import chunks
from cabols_control.bags.storage.records import (
    FRAME,
    MAGIC,
    MESSAGE,
    RecordError,
    allowed,
    channel_of,
    fills,
    schema_of,
)
from cabols_control.bags.storage.summary import FOOTER_SIZE, read_summary

OUTSIDE = (Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END, Opcode.FOOTER)
"""Records that lie in no chunk."""
DAY_NS = 24 * 3600 * 1_000_000_000
CHAIN = 3
"""Records in a row that must be plausible where none of them has a checksum."""
CUT_MAX = 1 << 26
"""Longest record whose end may be missing where a recorder was killed [bytes]."""
WINDOW = 1 << 20
BEGIN = re.compile(rb"(?s)(?=[\x02-\x06\x09\x0c\x0f].{4}\x00{4})")
"""An opcode that a search may find, and a length below 4 GiB."""


class Frames:
    """Records of one file by their places.

    Attributes:
        size: of the file [bytes].
        summary: at the file's end.
        chunked: whether a chunk has been found; kept by the caller.
        sizes: of the newest message record by channel; kept by the caller.
        times_ns: of the first message and of the newest; kept by the caller.
        mended: whether a chunk was taken although the frame around it is damaged.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        """Read the summary.

        Args:
            stream: of the file, seekable.
        """
        self._stream = stream
        self.size = stream.seek(0, 2)
        self.summary = read_summary(self.read, self.size)
        self.chunked = False
        self.sizes: dict[int, int] = {}
        self.times_ns: tuple[int, ...] = ()
        self.mended = False

    def after_data(self, position: int) -> int:
        """Return where the footer is, behind a damaged or empty summary."""
        while position + FRAME.size <= self.size:
            opcode, size = FRAME.unpack(self.read(position, FRAME.size))
            if opcode == Opcode.FOOTER:
                return position
            position += FRAME.size + size
        return self.size

    def read(self, position: int, size: int) -> bytes:
        """Return bytes of the file; fewer at its end.

        Args:
            position: of the first.
            size: number of them.
        """
        if self._stream.tell() != position:
            self._stream.seek(position)
        return self._stream.read(size)

    def frame(self, position: int) -> tuple[int, bytes, int] | None:
        """Return opcode, content and end of the record here; None if it is damaged or cut."""
        head = self.read(position, FRAME.size)
        if len(head) < FRAME.size:
            return None
        opcode, size = FRAME.unpack(head)
        end = position + FRAME.size + size
        if end <= self.size and opcode == Opcode.MESSAGE:
            content = self.read(position + FRAME.size, size)
            return (opcode, content, end) if self._trusted(content, end) else None
        inner = chunks.content_size(self.read(position + FRAME.size, chunks.HEAD_MAX))
        if inner and (opcode != Opcode.CHUNK or inner != size):
            odd = self._odd_chunk(position, inner)
            if odd is not None or opcode == Opcode.CHUNK:
                return odd
        if end > self.size or not allowed(opcode, size):
            return None
        content = self.read(position + FRAME.size, size)
        good = inner or self._head_at(end) or fills(opcode, content)
        return (opcode, content, end) if good else None

    def _odd_chunk(self, position: int, inner: int) -> tuple[int, bytes, int] | None:
        """Return a chunk whose frame is damaged but whose checksum holds."""
        if inner > self.size - position - FRAME.size:
            return None
        content = self.read(position + FRAME.size, inner)
        try:
            if not chunks.checked(content):
                return None
            chunks.records(content)
        except chunks.ChunkError:
            return None
        self.mended = True
        return Opcode.CHUNK, content, position + FRAME.size + inner

    def _head_at(self, position: int) -> bool:
        """Whether a record, or the end of what was written, may be here."""
        head = self.read(position, FRAME.size)
        if len(head) < FRAME.size:
            return position <= self.size
        opcode, size = FRAME.unpack(head)
        if position == self.size - len(MAGIC) and head.startswith(MAGIC):
            return True
        # The last record of a killed recording is longer than what is left; but not by much.
        if allowed(opcode, size) and size <= max(self.size - position, CUT_MAX):
            return True
        # Or a chunk whose frame is damaged.
        inner = chunks.content_size(self.read(position + FRAME.size, chunks.HEAD_MAX))
        return (inner or 0) > chunks.HEAD_MAX

    def _trusted(self, content: bytes, end: int) -> bool:
        """Whether a message's length is right: by what follows, or by those before it."""
        if self._head_at(end):
            return True
        number = int.from_bytes(content[:2], "little")
        return self.sizes.get(number) == len(content)

    def cut_chunk(self, position: int) -> bytes | None:
        """Return what there is of a chunk whose end is missing; None if here is none."""
        head = self.read(position, FRAME.size + chunks.HEAD_MAX)
        if len(head) <= FRAME.size or head[0] != Opcode.CHUNK:
            return None
        inner = chunks.content_size(head[FRAME.size :])
        left = self.size - position - FRAME.size
        return self.read(position + FRAME.size, left) if inner and inner > left else None

    def next_good(self, start: int) -> int:
        """Return where the next good record behind a damaged one begins; the size if none does."""
        goal = self.summary.start if self.summary.start is not None else self.size
        end = goal if self.summary.start is None else self.size - FOOTER_SIZE
        for offset in self.summary.offsets:
            if start < offset < goal and self._good(offset, alone=True):
                goal = end = offset
                break
        places = self._candidates(start + 1, goal)
        found = next((place for place in places if self._good(place, alone=True)), end)
        chunked = self.chunked or bool(self.summary.offsets)
        if not chunked and self.read(found, 1) != bytes([Opcode.CHUNK]):
            places = self._candidates(start + 1, min(goal, found))
            return next((place for place in places if self._good(place, alone=False)), found)
        return found

    def _good(self, position: int, alone: bool, chain: int = CHAIN) -> bool:
        """Whether a record at a place that a search has found is one.

        Args:
            position: of the record [bytes].
            alone: whether it must prove itself by a checksum, or by belonging outside chunks.
            chain: number of records, with this one, that must be plausible.
        """
        head = self.read(position, FRAME.size)
        if len(head) < FRAME.size:
            return position == self.size
        opcode, size = FRAME.unpack(head)
        end = position + FRAME.size + size
        inner = chunks.content_size(self.read(position + FRAME.size, chunks.HEAD_MAX))
        if opcode == Opcode.CHUNK or (inner and self._good_chunk(position, inner, agreed=False)):
            return bool(inner) and self._good_chunk(position, inner or 0, agreed=inner == size)
        if end > self.size or not allowed(opcode, size) or (alone and opcode not in OUTSIDE):
            return False
        content = self.read(position + FRAME.size, size)
        try:
            if opcode in (Opcode.ATTACHMENT, Opcode.METADATA):
                return fills(opcode, content)
            if opcode == Opcode.SCHEMA:
                schema_of(content)
            elif opcode == Opcode.CHANNEL:
                channel_of(content, {})
            elif opcode == Opcode.MESSAGE and not self._plausible(content):
                return False
            elif opcode == Opcode.DATA_END:
                return self._head_at(end)
            elif opcode == Opcode.FOOTER:
                return self.read(end, len(MAGIC)) == MAGIC
        except RecordError:
            return False
        if alone:
            return self._head_at(end)
        return chain <= 1 or end == self.size or self._good(end, False, chain - 1)

    def _good_chunk(self, position: int, inner: int, agreed: bool) -> bool:
        """Whether a chunk is whole; one without checksum needs a frame that agrees."""
        if inner > self.size - position - FRAME.size:
            return False
        content = self.read(position + FRAME.size, inner)
        try:
            chunks.records(content)
        except chunks.ChunkError:
            return False
        end = position + FRAME.size + inner
        return chunks.checked(content) or (agreed and self._head_at(end))

    def _plausible(self, content: bytes) -> bool:
        if len(content) < MESSAGE.size:
            return False
        number, _, time_ns, _ = MESSAGE.unpack_from(content)
        # One of the two may itself be damaged.
        near = not self.times_ns or any(abs(time_ns - known) < DAY_NS for known in self.times_ns)
        known = self.sizes or self.summary.channels
        return near and (not known or number in known or number in self.summary.channels)

    def _candidates(self, start: int, stop: int) -> Iterator[int]:
        """Yield places where a record may begin, in order."""
        while start < stop:
            width = min(WINDOW, stop - start)
            window = self.read(start, width + FRAME.size - 1)
            for match in BEGIN.finditer(window):
                if match.start() < width:
                    yield start + match.start()
            start += WINDOW
