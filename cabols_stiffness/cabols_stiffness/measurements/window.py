# SPDX-License-Identifier: Apache-2.0
"""The newest samples of a stream, and their averages over a window of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cabols_control.checks import FloatArray
from cabols_stiffness.errors import CampaignError

Stamps = npt.NDArray[np.int64]
FEWEST = 5
"""Fewest samples of the wrench in a window; one of the joints suffices."""


class Rolling:
    """The newest rows of one topic, in the order of their stamps.

    Rows lie in a buffer of twice the capacity, so that any window is one slice and a row is moved
    once at most.

    Attributes:
        newest_ns: stamp of the newest row; -1 before the first.
    """

    def __init__(self, columns: int, capacity: int) -> None:
        """Start empty.

        Args:
            columns: of a row.
            capacity: rows that are kept at least.
        """
        self._capacity = capacity
        self._stamps = np.empty(2 * capacity, dtype=np.int64)
        self._rows = np.empty((2 * capacity, columns))
        self._end = 0
        self._dropped = False
        self.newest_ns = -1

    def add(self, stamps: Stamps, rows: FloatArray) -> None:
        """Append (k,) stamps [ns] and (k, columns) rows; what is not newer is left out.

        Args:
            stamps: (k,) [ns].
            rows: (k, columns).
        """
        fresh = stamps > np.maximum.accumulate(np.concatenate([[self.newest_ns], stamps[:-1]]))
        if not fresh.all():
            stamps, rows = stamps[fresh], rows[fresh]
        if stamps.size > self._capacity:
            self._dropped = True
            stamps, rows = stamps[-self._capacity :], rows[-self._capacity :]
        if self._end + stamps.size > 2 * self._capacity:
            kept = self._capacity - stamps.size if stamps.size < self._capacity else 0
            start = max(self._end - kept, 0)
            self._dropped = self._dropped or start > 0
            count = self._end - start
            self._stamps[:count] = self._stamps[start : self._end].copy()
            self._rows[:count] = self._rows[start : self._end].copy()
            self._end = count
        self._stamps[self._end : self._end + stamps.size] = stamps
        self._rows[self._end : self._end + stamps.size] = rows
        self._end += stamps.size
        if stamps.size:
            self.newest_ns = int(stamps[-1])

    def clear(self) -> None:
        """Forget everything, such as when a clock was set back."""
        self._end, self._dropped, self.newest_ns = 0, False, -1

    def between(self, begin_ns: int, end_ns: int) -> FloatArray:
        """(k, columns) rows with begin_ns <= stamp <= end_ns.

        Args:
            begin_ns: of the window.
            end_ns: of the window.

        Raises:
            CampaignError: if the window began before the oldest row that is still kept.
        """
        stamps = self._stamps[: self._end]
        if self._dropped and stamps.size and begin_ns < stamps[0]:
            raise CampaignError(
                f"window: expected it within the newest {1e-9 * (stamps[-1] - stamps[0]):.0f} s, "
                f"got one that began {1e-9 * (stamps[-1] - begin_ns):.0f} s ago; average for a "
                "shorter time"
            )
        first, last = np.searchsorted(stamps, [begin_ns, end_ns + 1])
        return self._rows[first:last]


@dataclass(frozen=True, eq=False)
class WindowAverage:
    """What the streams said during one measurement.

    Attributes:
        wrench: (6,) mean, tool axes [N, N m].
        covariance: (6, 6) of that mean.
        deviation: (6,) standard deviation of a single sample: how steady the load was.
        joints: (6,) mean [rad].
        samples: of the wrench.
    """

    wrench: FloatArray
    covariance: FloatArray
    deviation: FloatArray
    joints: FloatArray
    samples: int


def average(wrenches: Rolling, joints: Rolling, begin_ns: int, end_ns: int) -> WindowAverage:
    """Average wrench and joints over a window.

    The wrench's samples are taken as independent: the sensor's noise is white, and what is common
    to a window, such as its bias, is estimated with the stiffness.

    Args:
        wrenches: rows (6,) [N, N m].
        joints: rows (6,) [rad].
        begin_ns: of the window [ns].
        end_ns: of the window [ns].

    Raises:
        CampaignError: if the window holds too little.
    """
    loads = wrenches.between(begin_ns, end_ns)
    angles = joints.between(begin_ns, end_ns)
    if len(loads) < FEWEST or len(angles) < 1:
        raise CampaignError(
            f"window of {1e-9 * (end_ns - begin_ns):.3g} s: expected at least {FEWEST} samples of "
            f"the wrench and one of the joints, got {len(loads)} and {len(angles)}"
        )
    if not (np.isfinite(loads).all() and np.isfinite(angles).all()):
        raise CampaignError("window: expected finite wrenches and joints, got others")
    covariance = np.cov(loads, rowvar=False)
    return WindowAverage(
        wrench=loads.mean(axis=0),
        covariance=covariance / len(loads),
        deviation=np.sqrt(np.diagonal(covariance)),
        joints=angles.mean(axis=0),
        samples=len(loads),
    )


def stands(wrenches: Rolling, window_ns: int, force: float, torque: float) -> bool:
    """Whether the means over the two newest windows differ by no more than force and torque.

    Args:
        wrenches: rows (6,) [N, N m].
        window_ns: length of each window [ns].
        force: [N].
        torque: [N m].
    """
    now = wrenches.newest_ns
    later = wrenches.between(now - window_ns + 1, now)
    earlier = wrenches.between(now - 2 * window_ns + 1, now - window_ns)
    if len(later) < FEWEST or len(earlier) < FEWEST:
        return False
    change = np.abs(later.mean(axis=0) - earlier.mean(axis=0))
    return bool((change <= np.repeat([force, torque], 3)).all())
