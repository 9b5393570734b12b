# SPDX-License-Identifier: Apache-2.0
"""Several topics on one time base: values held, or interpolated between neighbours; pure."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.errors import CabolsError

PREVIOUS, LINEAR = "previous", "linear"
METHODS = (PREVIOUS, LINEAR)


class TimeBaseError(CabolsError):
    """Topics cannot be converted to the requested time base."""


def regular(first_ns: int, last_ns: int, rate_hz: float) -> IntArray:
    """Return instants at a rate, from the first to at most the last [ns].

    Args:
        first_ns: earliest instant [ns].
        last_ns: latest instant [ns].
        rate_hz: of the instants between them [Hz].

    Raises:
        TimeBaseError: if the rate is not positive.
    """
    if not 0.0 < rate_hz < 1e9:
        raise TimeBaseError(f"time base: expected a rate above 0 Hz, got {rate_hz:g}")
    count = int(np.floor((last_ns - first_ns) * 1e-9 * rate_hz)) + 1
    return first_ns + np.round(np.arange(max(count, 0)) * (1e9 / rate_hz)).astype(np.int64)


def newest_before(instants_ns: IntArray, times_ns: IntArray) -> tuple[IntArray, BoolArray]:
    """Find the newest message at or before each instant.

    Args:
        instants_ns: (m,) of the time base.
        times_ns: (k,) of the messages, not falling.

    Returns:
        (m,) rows of the messages, and (m,) whether there is one; where not, the row is 0.
    """
    rows = np.searchsorted(times_ns, instants_ns, side="right") - 1
    return np.maximum(rows, 0), rows >= 0


def previous(values: npt.NDArray[np.generic], rows: IntArray, there: BoolArray) -> FloatArray:
    """Return numbers held from message to message; NaN before the first.

    Args:
        values: (k,) or (k, n) of the messages.
        rows: from newest_before.
        there: likewise.
    """
    found = np.asarray(values, np.float64)[rows]
    found[~there] = np.nan
    return found


def linear(
    values: npt.NDArray[np.generic], instants_ns: IntArray, times_ns: IntArray
) -> FloatArray:
    """Return numbers between the messages before and after; NaN outside of the first and last.

    Args:
        values: (k,) or (k, n) of the messages.
        instants_ns: (m,) of the time base.
        times_ns: (k,) of the messages, not falling.
    """
    table = np.asarray(values, np.float64)
    before, there = newest_before(instants_ns, times_ns)
    after = np.minimum(before + 1, times_ns.size - 1)
    gap = (times_ns[after] - times_ns[before]).astype(np.float64)
    inside = there & (instants_ns <= times_ns[-1])
    share = np.divide(
        (instants_ns - times_ns[before]).astype(np.float64),
        gap,
        out=np.zeros(instants_ns.size),
        where=gap > 0.0,
    )
    if table.ndim > 1:
        share = share[:, None]
    found = table[before] + share * (table[after] - table[before])
    # A message at the very instant counts alone, also beside one that is NaN.
    exact = times_ns[before] == instants_ns
    found[exact] = table[before][exact]
    found[~inside] = np.nan
    return found


def texts(values: list[str], rows: IntArray, there: BoolArray) -> list[str]:
    """Return texts held from message to message; empty before the first.

    Args:
        values: one for each message.
        rows: (k,) message that holds at each instant.
        there: (k,) whether there was one by then.
    """
    return [values[row] if known else "" for row, known in zip(rows.tolist(), there, strict=True)]
