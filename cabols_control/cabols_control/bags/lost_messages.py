# SPDX-License-Identifier: Apache-2.0
"""Counting lost messages from publication numbers."""

from __future__ import annotations

from collections.abc import Callable


class LostMessages:
    """Counts the lost publications of one topic, which may have several publishers.

    Every publisher numbers its own messages from 1, but a message does not name its publisher. A
    number that continues one of the known sequences belongs to that one. Any other number starts a
    new sequence as long as there are publishers without one; otherwise it marks a gap.

    Attributes:
        lost: publications missing between those received.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        """Start without any sequence.

        Args:
            publishers: returns the present number of publishers; called only when a number does
                not continue a sequence.
        """
        self._publishers = publishers
        self._newest: list[int] = []
        self.lost = 0

    def add(self, number: int) -> None:
        """Take the publication number of the next message."""
        newest = self._newest
        try:
            newest[newest.index(number - 1)] = number
        except ValueError:
            self._break(number)

    def _break(self, number: int) -> None:
        earlier = [last for last in self._newest if last < number]
        if number == 1 or not earlier or len(self._newest) < self._publishers():
            self._begin(number)
            return
        nearest = max(earlier)
        self.lost += number - nearest - 1
        self._newest[self._newest.index(nearest)] = number

    def _begin(self, number: int) -> None:
        """Start a sequence; the oldest ones make room: their publishers may be gone."""
        self._newest.append(number)
        if len(self._newest) > max(1, self._publishers()):
            del self._newest[0]
