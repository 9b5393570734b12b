# SPDX-License-Identifier: Apache-2.0
"""The bridge's watchdog over commands: per limb, armed by the first command, latched."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray, IntArray
from cabols_control.compiling import njit
from cabols_control.naming import limb_names


@njit(cache=True)
def merge_into(
    limbs: IntArray, current: FloatArray, now_s: float, merged: FloatArray, newest: FloatArray
) -> bool:
    """Merge a command for some limbs into the currents of all, and note its time.

    Args:
        limbs: (k,) indices.
        current: (k,) [A].
        now_s: time of the newest sample [s].
        merged: (n,) [A], updated.
        newest: (n,) [s], as CommandWatchdog's, updated.

    Returns:
        False if an index is too large or a current is not finite: nothing is changed then.
    """
    for k in range(limbs.shape[0]):
        if not (limbs[k] < merged.shape[0] and np.isfinite(current[k])):
            return False
    for k in range(limbs.shape[0]):
        merged[limbs[k]] = current[k]
        newest[limbs[k]] = now_s
    return True


@njit(cache=True)
def oldest_age(now_s: float, newest: FloatArray) -> float:
    """Return the age of the oldest of (n,) commands [s]; those that never came (NaN) do not count.

    Args:
        now_s: now [s].
        newest: (n,) [s].
    """
    oldest = 0.0
    for i in range(newest.shape[0]):
        age = now_s - newest[i]
        if age > oldest:
            oldest = age
    return float(oldest)


class CommandWatchdog:
    """Decides whether the newest currents may still be on the amplifiers.

    Attributes:
        newest: (n,) time of the sample before each limb's newest command [s]; NaN before the first.
        fault: why the outputs must be zero; empty while commands are fresh.
        silent: whether a limb's newest command is older than half the timeout.
    """

    def __init__(self, limbs: int, timeout_s: float) -> None:
        """Start unarmed: before its first command a limb has zero current anyway."""
        self._timeout = timeout_s
        self.newest = np.full(limbs, np.nan)
        self.fault = ""
        self.silent = False

    def feed(self, now_s: float, limbs: IntArray) -> None:
        """Note a command for some limbs that arrived after the sample at now_s.

        Args:
            now_s: time of the newest sample [s].
            limbs: (k,) limbs that the command is for, from 0.
        """
        self.newest[limbs] = now_s

    def check(self, now_s: float, at_rest: bool) -> bool:
        """Return whether outputs may be non-zero.

        A fault stays until the mode is STOPPED, where the outputs are zero whatever comes.

        Args:
            now_s: time of the newest sample, as for feed [s].
            at_rest: whether the mode is STOPPED.
        """
        if at_rest:
            self.fault, self.silent = "", False
            return True
        age_s = oldest_age(now_s, self.newest)
        self.silent = age_s > 0.5 * self._timeout
        if age_s > self._timeout and not self.fault:
            stale = now_s - self.newest > self._timeout
            self.fault = (
                f"no motor_current for {limb_names(np.flatnonzero(stale))} for "
                f"{1e3 * self._timeout:.0f} ms: zero current; is the limb controller running?"
            )
        return not self.fault
