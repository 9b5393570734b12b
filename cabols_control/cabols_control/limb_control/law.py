# SPDX-License-Identifier: Apache-2.0
"""The limb law (3.10): tension control by an inner velocity loop, for n limbs at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, finite_array, in_range
from cabols_control.compiling import njit
from cabols_control.errors import ShapeError
from cabols_control.gains import LimbGains
from cabols_control.limb_control.records import limb_records

ABSURD = 1e9
"""Positions [m] and speeds [m/s] beyond this are no numbers of a rig; products would overflow."""


@njit(cache=True)
def advance_law(limbs: Any, dt_s: float, current_limit: float) -> bool:
    """One step of (3.10) from each limb's position and reference to its law_current.

    Args:
        limbs: (n,) records of LIMB; updated.
        dt_s: time since the previous step [s].
        current_limit: bound on |current| [A].

    Returns:
        False if a reference or a position is not finite, or absurd: nothing is changed then.
    """
    for i in range(limbs.shape[0]):
        # Written so that NaN is refused.
        if not (abs(limbs[i]["reference"]) <= ABSURD and abs(limbs[i]["position"]) <= ABSURD):
            return False
    for i in range(limbs.shape[0]):
        limb = limbs[i]
        gain, position = limb["integral_gain"], limb["position"]
        velocity = (position - limb["last_position"]) / dt_s
        increment = (limb["reference"] - velocity) * dt_s
        integral = limb["integral"] + increment
        unlimited = gain * integral - limb["velocity_gain"] * velocity + limb["feed_forward"]
        current = min(max(unlimited, -current_limit), current_limit)
        # Anti-windup: the integral grows only until the current reaches its limit.
        excess = (unlimited - current) / gain
        if excess * increment > 0.0:
            integral -= excess if abs(excess) < abs(increment) else increment
        limb["integral"] = integral
        limb["last_position"] = position
        limb["law_current"] = current
    return True


@njit(cache=True)
def reset_law(limb: Any, position: float, current: float) -> None:
    """Make the next output of one limb's law continue from a current [A], at rest at a position.

    Args:
        limb: record of LIMB; updated.
        position: present elongation or wound length, whichever the law will be given [m].
        current: what the limb's amplifier has now [A].
    """
    limb["integral"] = (current - limb["feed_forward"]) / limb["integral_gain"]
    limb["last_position"] = position
    limb["law_current"] = current


class LimbLaw:
    """State of (3.10) for n limbs, with current limit, anti-windup and bumpless reset."""

    def __init__(self, gains: Sequence[LimbGains], current_limit: float) -> None:
        """Start at rest with zero current.

        Args:
            gains: one for each limb.
            current_limit: bound on |current| [A].
        """
        if not gains:
            raise ShapeError("gains: expected at least one limb, got none")
        self._records = limb_records(gains)
        self._limit = in_range("current_limit", current_limit, 0.0, 100.0)

    @property
    def tension_gain(self) -> FloatArray:
        """(n,) k_P2 [m/s/N]."""
        gain: FloatArray = self._records["tension_gain"]
        return gain

    @property
    def current(self) -> FloatArray:
        """(n,) newest output [A]."""
        current: FloatArray = self._records["law_current"]
        return current

    @property
    def limbs(self) -> int:
        """Number n of limbs."""
        return int(self._records.size)

    def reset(self, limb: int, position: float, current: float = 0.0) -> None:
        """Make the next output of one limb continue from a current, at rest at a position.

        Args:
            limb: index from 0.
            position: present elongation or wound length, whichever step will be given [m].
            current: what the limb's amplifier has now [A].
        """
        record = self._records[limb : limb + 1]
        record["integral"] = current / record["integral_gain"]
        record["last_position"] = position
        record["law_current"] = current

    def step(self, velocity_reference: FloatArray, position: FloatArray, dt_s: float) -> FloatArray:
        """Advance all limbs by one sample.

        Args:
            velocity_reference: (n,) desired winding speed [m/s]: k_P2 (tau_d - tau_hat) for
                tension control (see tension_gain), a constant for pre-tightening.
            position: (n,) elongation (or wound length) at this sample [m].
            dt_s: real time since the previous sample [s].

        Returns:
            (n,) current within the limit [A]; the same array at every call.

        Raises:
            ShapeError: on other shapes or non-finite input; the state is left as it was.
            OutOfRangeError: if dt_s is not positive.
        """
        shape = (self.limbs,)
        reference = finite_array("velocity_reference", velocity_reference, shape)
        place = finite_array("position", position, shape)
        in_range("dt_s", dt_s, 1e-6, 1.0)
        self.advance(reference, place, dt_s)
        return self.current

    def advance(self, velocity_reference: FloatArray, position: FloatArray, dt_s: float) -> bool:
        """Step without checks of shape and time, for the control loop; see advance_law.

        Args:
            velocity_reference: (n,) [m/s].
            position: (n,) elongation or wound length [m].
            dt_s: time since the last step [s].
        """
        self._records["reference"] = velocity_reference
        self._records["position"] = position
        return bool(advance_law(self._records, dt_s, self._limit))

    @property
    def saturated(self) -> BoolArray:
        """(n,) bool, true where the last output stands at the limit."""
        return np.abs(self.current) >= self._limit
