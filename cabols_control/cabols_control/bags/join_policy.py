"""When to join a topic whose other readers are to be served first; pure."""

from __future__ import annotations

import math

SETTLE_S = 0.3
"""From here another reader is seen to be there; its publisher must have met it, too."""
PATIENCE_S = 0.5
"""So long a topic that is published is left to others that may come."""


class Courtesy:
    """Waits until a topic has a publisher that has met another reader, but not for ever."""

    def __init__(self) -> None:
        """Begin to wait."""
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
