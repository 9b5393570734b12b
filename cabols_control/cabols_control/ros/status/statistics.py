# SPDX-License-Identifier: Apache-2.0
"""Counters and timings of a loop, cheap enough for every cycle."""

from __future__ import annotations

import numpy as np


class Durations:
    """A ring of durations with median and 99th percentile."""

    def __init__(self, size: int = 1000) -> None:
        """Keep the last `size` durations."""
        self._ring = np.zeros(size)
        self._count = 0

    def add(self, seconds: float) -> None:
        """Add a duration."""
        self._ring[self._count % self._ring.size] = seconds
        self._count += 1

    def summary(self) -> tuple[float, float]:
        """Median and 99th percentile [s]; zeros without data."""
        if not self._count:
            return 0.0, 0.0
        found = np.percentile(self._ring[: min(self._count, self._ring.size)], (50, 99))
        return float(found[0]), float(found[1])
