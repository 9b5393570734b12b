# SPDX-License-Identifier: Apache-2.0
"""Samples of a free-running hardware clock on the computer's: lateness and drift; pure."""

from __future__ import annotations

DRIFT = 2e-4
"""Largest drift between two crystals [s/s]; good ones stay below half of it."""
SETTLED = 1000
"""Samples until one has certainly been read promptly: drift is counted from there."""


class Lateness:
    """Compares a count of samples with the computer's clock.

    The card's crystal and the computer's drift apart by whole periods in a minute. Lateness
    therefore counts from the promptest reading so far, which ages by DRIFT of the elapsed time.

    How that reading moves is the drift itself. Stamps that follow it stay on the computer's clock,
    on which the robot's poses are: at 50 parts in a million they would be 0.1 s apart after half an
    hour, and poses of a moving robot would be used as of another moment.
    """

    def __init__(self, period_ns: int) -> None:
        """Start without a reading."""
        self._period_ns = period_ns
        self._prompt_ns: float | None = None
        self._first_ns: float | None = None
        self._drifted_ns = 0.0
        self._index = 0

    @property
    def drifted_ns(self) -> int:
        """How far the count of periods is behind the computer's clock by drift, so far [ns].

        It changes by no more than DRIFT of the time that passes, so that what is added to stamps
        never makes them go back, nor changes a period noticeably.
        """
        return round(self._drifted_ns)

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
            most = DRIFT * (index - self._index) * self._period_ns
            self._prompt_ns = min(delay_ns, self._prompt_ns + most)
            self._follow(index, most)
        self._index = index
        return int(delay_ns - self._prompt_ns)

    def _follow(self, index: int, most: float) -> None:
        """Follow the promptest reading by at most so many nanoseconds."""
        assert self._prompt_ns is not None
        if self._first_ns is None:
            if index >= SETTLED:
                self._first_ns = self._prompt_ns
            return
        off = self._prompt_ns - self._first_ns - self._drifted_ns
        self._drifted_ns += min(max(off, -most), most)
