# SPDX-License-Identifier: Apache-2.0
"""Which presses of the emergency stop hold, and which a reset has lifted; pure.

Every press has a number. A node that heard it holds it and reports its number; the supervisor
latches what it hears of, and after a reset every mode names what that reset lifted. So a node needs
to see neither FAULT nor the reset itself, and messages may come in any order: a press holds until
its own number is lifted, and what is lifted never holds again.
"""

from __future__ import annotations

from collections.abc import Iterable

REMEMBERED = 256
"""Presses that are remembered of each kind; of more, the oldest go."""
SLOTS = 8
"""Numbers that a Mode names (its field `lifted`)."""


def _keep(numbers: dict[int, None], number: int) -> None:
    """Put a number last into a bounded dictionary."""
    numbers.pop(number, None)
    if len(numbers) >= REMEMBERED:
        numbers.pop(next(iter(numbers)))
    numbers[number] = None


class HeldStops:
    """Presses that a node has heard, and those of them that it holds.

    Attributes:
        number: to be reported: of the oldest that holds; 0 for none. Other threads may read it.
    """

    def __init__(self) -> None:
        """Hold none."""
        self.number = 0
        self._held: dict[int, None] = {}
        self._heard: dict[int, None] = {}

    def press(self, number: int) -> bool:
        """Take a press; return whether it is to be acted on.

        Args:
            number: of the press; a repetition, or one that was lifted before it came, is not.
        """
        if number in self._heard:
            return False
        _keep(self._heard, number)
        _keep(self._held, number)
        self._note()
        return True

    def lift(self, numbers: Iterable[int]) -> bool:
        """Take what a mode names; return whether nothing holds any more, by this.

        Args:
            numbers: lifted ones; 0 stands for none.
        """
        before = self.number
        for number in numbers:
            if number:
                # Named again and again: it must not push out those that are repeated meanwhile.
                if number not in self._heard:
                    _keep(self._heard, number)
                self._held.pop(number, None)
        self._note()
        return bool(before and not self.number)

    def _note(self) -> None:
        self.number = next(iter(self._held), 0)


class LatchedStops:
    """Presses that a supervisor has latched since its start, and those that its resets lifted."""

    def __init__(self) -> None:
        """Know of none."""
        self._latched: dict[int, None] = {}
        self._lifted: dict[int, None] = {}

    def latch(self, number: int) -> bool:
        """Take a press, from its sender or out of a node's report.

        Args:
            number: of the press; 0 for one without, which always counts.

        Returns:
            Whether it holds: not if a reset has lifted it before.
        """
        if number == 0:
            return True
        if number in self._lifted:
            # A node still holds it: name it in the next modes.
            _keep(self._lifted, number)
            return False
        _keep(self._latched, number)
        return True

    def reset(self) -> None:
        """Lift all that is latched."""
        for number in self._latched:
            _keep(self._lifted, number)
        self._latched.clear()

    @property
    def lifted(self) -> tuple[int, ...]:
        """(SLOTS,) numbers for Mode.lifted, newest last, 0 for none."""
        newest = tuple(self._lifted)[-SLOTS:]
        return (0,) * (SLOTS - len(newest)) + newest
