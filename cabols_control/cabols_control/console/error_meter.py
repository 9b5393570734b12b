# SPDX-License-Identifier: Apache-2.0
"""Error of the wrench against the command while a programme runs, for the page; pure."""

from __future__ import annotations

from collections import deque

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.run_report.judgement.vector_errors import (
    IDLE,
    KINDS,
    lengths,
    lengths_where,
    rms,
    sizes,
)

KEPT = 20_000
"""Errors that are kept: a quarter of an hour of frames."""
HELD_S = 0.2
"""Time without a command after which the next one is of another programme [s]."""


class ErrorMeter:
    """Compares commands with the wrenches that were measured at their moments."""

    def __init__(self) -> None:
        """Begin without a programme."""
        self._measured: deque[tuple[float, FloatArray]] = deque(maxlen=8)
        self._waiting: deque[tuple[float, FloatArray]] = deque(maxlen=8)
        self._errors: deque[FloatArray] = deque(maxlen=KEPT)
        self._idle: deque[BoolArray] = deque(maxlen=KEPT)
        self._last_s = -np.inf
        self._known: FloatArray | None = None

    def know(self, uncertainty: FloatArray | None) -> None:
        """Take how well the newest wrench is known.

        Args:
            uncertainty: (6,) half widths that hold 95 % of its errors [N, N m]; None: not told.
        """
        self._known = None if uncertainty is None else np.array(uncertainty)

    def measure(self, stamp_s: float, wrench: FloatArray) -> None:
        """Take a measured wrench.

        Args:
            stamp_s: of the sample [s].
            wrench: (6,) in the programme's frame [N, N m].
        """
        if not self._measured or stamp_s > self._measured[-1][0]:
            self._measured.append((stamp_s, np.array(wrench)))
            self._compare()

    def command(self, stamp_s: float, wrench: FloatArray) -> None:
        """Take a command.

        Args:
            stamp_s: of its message [s].
            wrench: (6,) in its frame [N, N m].
        """
        if not stamp_s > self._last_s:
            return
        if stamp_s - self._last_s > HELD_S:
            self._errors.clear()
            self._idle.clear()
        self._last_s = stamp_s
        self._waiting.append((stamp_s, np.array(wrench)))
        self._compare()

    def _compare(self) -> None:
        """Compare each command that lies between two measured wrenches."""
        while len(self._measured) > 1 and self._waiting:
            at, asked = self._waiting[0]
            if at > self._measured[-1][0]:
                return
            self._waiting.popleft()
            times = np.array([time for time, _ in self._measured])
            if at < times[0]:
                continue
            rows = np.array([wrench for _, wrench in self._measured])
            felt = np.array([np.interp(at, times, column) for column in rows.T])
            self._errors.append(felt - asked)
            self._idle.append(np.abs(asked) < IDLE)

    def numbers(self) -> list[float]:
        """Rms, 95th percentile and largest force [N], then torque [N m]; then rms of idle axes.

        Empty before the first comparison; NaN where no axis was idle.
        """
        if not self._errors:
            return []
        errors, idle = np.array(self._errors), np.array(self._idle)
        found: list[float] = []
        left: list[float] = []
        for _, axes in KINDS:
            found += sizes(lengths(errors[:, axes]))
            left.append(rms(lengths_where(errors[:, axes], idle[:, axes])))
        return found + left

    def text(self) -> str:
        """Say it in a line; empty before the first comparison."""
        found = self.numbers()
        if not found:
            return ""
        force, torque, left = found[:3], found[3:6], found[6:]
        words = [
            f"{name} {' / '.join(f'{value:.{digits}f}' for value in values)} {unit}"
            for name, values, unit, digits in (
                ("force", force, "N", 2),
                ("torque", torque, "N m", 3),
            )
        ]
        idle = [
            f"{value:.{digits}f} {unit}"
            for value, unit, digits in zip(left, ("N", "N m"), (2, 3), strict=True)
            if value == value
        ]
        words += [f"in axes commanded to zero {', '.join(idle)} rms"] if idle else []
        if self._known is not None and np.isfinite(self._known).all():
            force_n, torque_nm = self._known[:3].max(), self._known[3:].max()
            words += [f"measured within {force_n:.2f} N, {torque_nm:.3f} N m (95 %)"]
        return f"error against the command, rms / 95 % / largest: {'; '.join(words)}"
