# SPDX-License-Identifier: Apache-2.0
"""Which samples the limb controllers have answered, and how long the answers took."""

from __future__ import annotations

import time

import numpy as np

RING = 1024
"""Samples whose time of sending is kept."""


class AnswerCount:
    """Numbers of samples and of their answers; both count from 1, and 0 is none.

    Attributes:
        sent: newest sample.
        answered: newest sample that has an answer.
    """

    def __init__(self) -> None:
        """None yet."""
        self.sent = self.answered = 0
        self._sent_ns = np.zeros(RING, dtype=np.int64)

    def sending(self) -> None:
        """Note that the newest sample is about to be sent."""
        self._sent_ns[self.sent % RING] = time.monotonic_ns()

    def complaint(self, sequence: int) -> str:
        """Why an answer cannot be used: it is older than the one before, or of no sample."""
        if self.answered <= sequence <= self.sent:
            return ""
        return (
            f"motor_current: expected an answer to state {self.answered} to {self.sent}, "
            f"got {sequence}"
        )

    def take(self, sequence: int) -> int:
        """Take an answer that can be used; returns how many samples in between have none."""
        skipped = max(sequence - self.answered - 1, 0) if self.answered else 0
        self.answered = sequence
        return skipped

    def round_trip_s(self, sequence: int, now_ns: int) -> float:
        """Time from a sample's sending to now [s].

        Args:
            sequence: of the sample.
            now_ns: time.monotonic_ns() at the answer's arrival.
        """
        return 1e-9 * float(now_ns - self._sent_ns[sequence % RING])
