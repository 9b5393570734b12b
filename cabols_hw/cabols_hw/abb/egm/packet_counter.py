# SPDX-License-Identifier: Apache-2.0
"""Counts the packets of a numbered stream, whatever its numbers and its clock do."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

NUMBERS = 2**32
"""Numbers wrap there."""

CLOCK_WRAP_S = 1e-3 * 2**32
"""A controller's clock of 32 bit in milliseconds wraps there [s]."""

JUMP = 250
"""Numbers may run ahead by so many at once, 1 s of packets: more needs to be confirmed."""

REORDERED = 6
"""Numbers that far behind are of packets which came late: the network does not hold more back."""

BEGINNING = 50
"""A session has begun anew if its number is below this, after one that was far ahead."""

CONFIRMED = 3
"""Packets that follow each other confirm an odd number."""

PACED = 8
"""So many, at the pace of their own clock, confirm what could be old packets."""

STEP_S = 0.008
"""Smallest disagreement of clock and numbers that is a step of the clock [s]."""

FORWARD_S = 0.5
"""Smallest step forward that is counted; smaller ones change nothing [s]."""

PAUSE_S = 0.1
"""With a step of the clock, a pause in which a session may have ended [s]."""

CLOCK_DRIFT = 1.2e-3
"""Largest drift between the two clocks before packets count as late [s/s]."""


@dataclass
class _Candidate:
    """Packets whose numbers do not continue the stream."""

    first: int
    newest: int
    sent_s: float
    first_sent_s: float
    first_received_s: float
    count: int = 1


@dataclass
class _Newest:
    """The newest packet of a session."""

    number: int
    sent_s: float


@dataclass
class PacketCounter:
    """Counts lost, late, repeated and reordered packets of a numbered stream.

    Whether a packet is late is judged by differences alone. Numbers and times come both from the
    sender, so a time that disagrees with the numbers is a step of its clock, and not a delay.

    Attributes:
        late_after_s: a packet is late if its way took longer than the quickest one's by this [s].
        received: packets.
        lost: numbers missing so far.
        late: packets over late_after_s.
        duplicates: packets received twice.
        out_of_order: packets behind a newer one.
        restarts: number of restarts of the numbering.
        impossible: packets whose number nothing followed.
        clock_steps: steps of the sender's clock, without its wraps.
        newest: newest number; -1 before the first.
    """

    late_after_s: float = 0.010
    received: int = 0
    lost: int = 0
    late: int = 0
    duplicates: int = 0
    out_of_order: int = 0
    restarts: int = 0
    impossible: int = 0
    clock_steps: int = 0
    newest: int = -1
    _offset: float = math.inf
    _sent_s: float = 0.0
    _received_s: float = 0.0
    _period_s: float = 0.0
    _again: int = 0
    _odd: _Candidate | None = None
    _before: _Newest | None = field(default=None)

    def take(self, sequence: int, sent_s: float, received_s: float) -> bool:
        """Count one packet.

        Args:
            sequence: its number, as the controller counts.
            sent_s: its time, by the controller's clock [s].
            received_s: when it came, by any clock of this computer [s].

        Returns:
            Whether it is newer than all before.
        """
        self.received += 1
        ahead = _ahead(sequence, self.newest)
        if self.newest < 0:
            self._begin(sequence, sent_s, received_s)
            return True
        if 0 < ahead <= JUMP:
            self._drop_odd()
            self._go_on(sequence, ahead, sent_s, received_s)
            return True
        if -REORDERED <= ahead <= 0:
            self.duplicates += ahead == 0
            self.out_of_order += ahead < 0
            self._again += 1
            if ahead < 0:
                # It was counted as lost, unless it precedes the first packet or is a duplicate.
                self.lost = max(self.lost - 1, 0)
            return False
        return self._take_odd(sequence, ahead, sent_s, received_s)

    def renew(self) -> None:
        """Expect another session: the sender is another one."""
        if self.newest >= 0:
            self.restarts += 1
        self.newest, self._odd, self._before = -1, None, None

    def _begin(self, sequence: int, sent_s: float, received_s: float) -> None:
        self.newest, self._odd = sequence, None
        self._offset = received_s - sent_s
        self._sent_s, self._received_s = sent_s, received_s

    def _go_on(self, sequence: int, ahead: int, sent_s: float, received_s: float) -> None:
        self.lost += ahead - 1
        self._follow_clock(ahead, sent_s, received_s)
        self.newest, self._again = sequence, 0
        offset = received_s - sent_s
        # The clocks' offset is unknown: the quickest packet so far counts as undelayed.
        self._offset += CLOCK_DRIFT * max(received_s - self._received_s, 0.0)
        self._offset = min(self._offset, offset)
        self._sent_s, self._received_s = sent_s, received_s
        self.late += not offset - self._offset <= self.late_after_s

    def _follow_clock(self, ahead: int, sent_s: float, received_s: float) -> None:
        """Learn the period; take a step of the clock out of the offset."""
        went = sent_s - self._sent_s
        back = ahead * self._period_s - went
        if back > STEP_S or went < 0.0:
            waited = received_s - self._received_s - ahead * self._period_s
            # After a pause, or some numbers again, it is another session: nothing is known yet.
            another = waited > PAUSE_S or self._again > 1
            self._offset = math.inf if another else self._offset + back
            self.clock_steps += not abs(back - CLOCK_WRAP_S) < 1.0
        elif went - max(received_s - self._received_s, 0.0) > FORWARD_S:
            self.clock_steps += -back > FORWARD_S
        elif went > 0.0:
            each = went / ahead
            share = 0.05 if self._period_s else 1.0
            self._period_s += share * (each - self._period_s)

    def _take_odd(self, sequence: int, ahead: int, sent_s: float, received_s: float) -> bool:
        odd = self._odd
        if odd is not None and 0 < _ahead(sequence, odd.newest) <= REORDERED:
            odd.newest, odd.sent_s, odd.count = sequence, sent_s, odd.count + 1
        else:
            self._drop_odd()
            odd = _Candidate(sequence, sequence, sent_s, sent_s, received_s)
            self._odd = odd
        if self._returns(sequence, sent_s, received_s):
            return True
        if not self._confirmed(odd, ahead, sent_s, received_s):
            return False
        gap = _ahead(odd.first, self.newest)
        went = odd.first_sent_s - self._sent_s
        if gap > 0 and 0.5 * gap * self._period_s < went < 2.0 * gap * self._period_s:
            # The same session after a long silence.
            self.lost += gap - 1
        else:
            self.restarts += 1
            self._before = _Newest(self.newest, self._sent_s)
        self._begin(sequence, sent_s, received_s)
        return True

    def _confirmed(self, odd: _Candidate, ahead: int, sent_s: float, received_s: float) -> bool:
        """Whether the packets of another numbering are the stream now."""
        behind, older = -ahead, self._sent_s - sent_s
        anew = odd.first < BEGINNING and behind > BEGINNING
        if anew and behind >= JUMP:
            return True
        known = behind * self._period_s
        if behind > 0 and known > 0.0 and 0.5 * known < older < 2.0 * known:
            # Number and time are those of packets that have been: they may be old ones.
            span = odd.sent_s - odd.first_sent_s
            return odd.count >= PACED and received_s - odd.first_received_s >= 0.6 * span > 0.0
        return anew or odd.count >= CONFIRMED

    def _returns(self, sequence: int, sent_s: float, received_s: float) -> bool:
        """Whether the session goes on that a false beginning had ended; if so, take the packet."""
        before = self._before
        if before is None or not 0 < _ahead(sequence, before.number) <= JUMP:
            return False
        self.impossible += 1
        self.restarts -= 1
        ahead = _ahead(sequence, before.number)
        self.lost += ahead - 1
        self._before = None
        self._begin(sequence, sent_s, received_s)
        return True

    def _drop_odd(self) -> None:
        if self._odd is not None:
            self.impossible += self._odd.count
            self._odd = None


def _ahead(sequence: int, newest: int) -> int:
    """How far a number is ahead of another one, across the wrap; negative: behind."""
    return (sequence - newest + NUMBERS // 2) % NUMBERS - NUMBERS // 2
