# SPDX-License-Identifier: Apache-2.0
"""When the recorder subscribes to a topic whose other readers are to be served first; pure."""

from __future__ import annotations

import math

SETTLE_S = 0.3
"""Shortest time from seeing another reader until its publisher has matched it, too [s]."""
PATIENCE_S = 0.5
"""Longest wait for another reader of a topic that is published [s]."""


class JoinPolicy:
    """Waits until a topic's publisher has matched another reader, for at most PATIENCE_S."""

    def __init__(self) -> None:
        """Start to wait."""
        self._published_s = math.inf
        self._served_s = math.inf

    def over(self, now_s: float, published: bool, read: bool) -> bool:
        """Whether to join now.

        Args:
            now_s: present time, by any clock that does not go back [s].
            published: whether the topic has a publisher.
            read: whether it has another reader.
        """
        self._published_s = min(self._published_s, now_s) if published else math.inf
        self._served_s = min(self._served_s, now_s) if published and read else math.inf
        served = now_s - self._served_s >= SETTLE_S
        return served or (not read and now_s - self._published_s >= PATIENCE_S)
