# SPDX-License-Identifier: Apache-2.0
"""Whether silence means that nothing was sent, or that this process was stalled; pure."""

from __future__ import annotations

import math


class StarvationWatch:
    """Detects from the times of a process's own turns that it was starved or frozen.

    Such a process receives the messages of the meantime only a little after it runs again, so that
    a node that seems silent then may not be.
    """

    def __init__(self, stall_s: float) -> None:
        """Start as after a stall.

        Args:
            stall_s: a longer time between two turns is a stall, and silence proves nothing for
                that long after it [s].
        """
        self._stall_s = stall_s
        self._last_s = -math.inf
        self._valid_from_s = math.inf

    def turn(self, now_s: float) -> bool:
        """Note a turn at a time that never jumps [s]; return whether silence proves anything."""
        if now_s - self._last_s > self._stall_s:
            self._valid_from_s = now_s + self._stall_s
        self._last_s = now_s
        return now_s >= self._valid_from_s
