"""Whether a watcher may trust that it has heard nothing: it must have been awake; pure."""

from __future__ import annotations

import math


class Wakefulness:
    """Notices from its own turns that a process was starved or frozen.

    Such a process finds the messages of the meantime only a little after it has woken up, so that
    what seems silent to it then may not be.
    """

    def __init__(self, slept_s: float) -> None:
        """Start asleep.

        Args:
            slept_s: a longer time between two turns is sleep, and after it nothing is believed for
                so long [s].
        """
        self._slept_s = slept_s
        self._last_s = -math.inf
        self._believe_from_s = math.inf

    def turn(self, now_s: float) -> bool:
        """Note a turn at a time that never jumps [s]; return whether silence may be believed."""
        if now_s - self._last_s > self._slept_s:
            self._believe_from_s = now_s + self._slept_s
        self._last_s = now_s
        return now_s >= self._believe_from_s
