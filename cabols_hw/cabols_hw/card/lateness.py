# SPDX-License-Identifier: Apache-2.0
"""Lateness of reading the samples of a free-running hardware clock; pure."""

from __future__ import annotations

DRIFT = 2e-4
"""Largest drift between two crystals [s/s]; good ones stay below half of it."""


class Lateness:
    """Compares a count of samples with the computer's clock.

    The card's crystal and the computer's drift apart by whole periods in a minute. Lateness
    therefore counts from the promptest reading so far, which ages by DRIFT of the elapsed time.
    """

    def __init__(self, period_ns: int) -> None:
        """Start without a reading."""
        self._period_ns = period_ns
        self._prompt_ns: float | None = None
        self._index = 0

    def behind_ns(self, index: int, now_ns: int) -> int:
        """Return by how much sample number index, just read at now_ns, was read late [ns].

        Args:
            index: of the sample, from the first.
            now_ns: when it was read, by the clock of the first [ns].
        """
        delay_ns = now_ns - index * self._period_ns
        if self._prompt_ns is None:
            self._prompt_ns = delay_ns
        else:
            aged = self._prompt_ns + DRIFT * (index - self._index) * self._period_ns
            self._prompt_ns = min(delay_ns, aged)
        self._index = index
        return int(delay_ns - self._prompt_ns)
