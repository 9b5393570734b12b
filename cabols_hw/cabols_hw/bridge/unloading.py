# SPDX-License-Identifier: Apache-2.0
"""The bridge's own unloading, for when controllers must no longer be obeyed; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.limb_control.law import LimbLaw
from cabols_control.rig import Rig
from cabols_hw.bridge.braking import pay_out_only

LONGEST_STEP_S = 0.010
BEHIND_N = 60.0
"""Distance of a limb behind its ramp at which the ramp goes on at SLOWLY [N]."""
SLOWLY = 0.2
"""Least share of the rate: a limb that does not follow holds the others up for so long only."""
NEARLY_N = 2.0
"""Largest distance from the holding tension at which a limb counts as unloaded [N]."""


class Unloading:
    """Ramps the tensions of the trusted limbs down to the holding tension, then rests.

    All tensions go down in proportion, and only as fast as the slowest limb follows: then the
    wrench, too, goes straight from what it was to almost nothing, and no axis of it grows on the
    way. No limb winds in: one that pulls less than the holding tension stays as it is.

    Attributes:
        current: (n,) newest output [A].
        active: whether it is unloading; false when all limbs are unloaded, or after patience_s.
        down: (n,) limbs that it does not move: unloaded, or not trusted.
    """

    def __init__(self, rig: Rig, rate: float = 1000.0, patience_s: float = 1.0) -> None:
        """Start at rest.

        Args:
            rig: limbs and gains.
            rate: of the highest tension [N/s].
            patience_s: longest unloading; after it the currents are cut, whatever the tensions [s].
        """
        n = rig.geometry.cables
        self._law = LimbLaw(list(rig.gains.limbs), rig.control.current_limit)
        self._rate = rate
        self._patience = patience_s
        self._hold = 1.3 * rig.limbs.switch_tension
        self._goal = np.full(n, self._hold)
        self._start = np.zeros(n)
        self._share = 0.0
        self._trusted: BoolArray = np.zeros(n, dtype=np.bool_)
        self._end_s = -np.inf
        self._last_s = -np.inf
        self.current = np.zeros(n)
        self.active = False
        self.down: BoolArray = np.ones(n, dtype=np.bool_)

    def begin(
        self, now_s: float, tension: FloatArray, elongation: FloatArray, trusted: BoolArray
    ) -> None:
        """Start from the present (n,) tensions [N] and elongations [m], with the trusted limbs.

        Args:
            now_s: now [s].
            tension: (n,) [N].
            elongation: (n,) [m].
            trusted: (n,) whether the limb may be driven.
        """
        known = np.isfinite(tension) & np.isfinite(elongation)
        self._trusted = trusted & known
        self._start = np.where(self._trusted, tension, self._hold)
        self._goal = np.minimum(self._start, self._hold)
        self._share = 1.0
        self._end_s, self._last_s = now_s + self._patience, now_s
        self.current[:] = 0.0
        self.active = bool(self._trusted.any())
        self.down = ~self._trusted
        for i in np.flatnonzero(self._trusted):
            self._law.reset(int(i), float(elongation[i]), 0.0)

    def step(
        self, now_s: float, tension: FloatArray, elongation: FloatArray, speed: FloatArray
    ) -> FloatArray:
        """Return the (n,) currents [A] for one sample; zero once it is over.

        Args:
            now_s: now [s].
            tension: (n,) estimates [N].
            elongation: (n,) [m].
            speed: (n,) of the motors, winding in [m/s].
        """
        dt_s = now_s - self._last_s
        if not self.active or not dt_s > 0.0:
            return self.current
        self._last_s = now_s
        trusted = self._trusted
        self.down = ~trusted | (tension <= self._hold + NEARLY_N)
        if self.down.all() or now_s > self._end_s:
            return self.stop()
        way = self._start - self._goal
        behind = float(np.max(tension - self._goal - self._share * way, where=trusted, initial=0.0))
        pace = self._rate / max(float(way.max()), 1e-9)
        pace *= min(max(1.0 - behind / BEHIND_N, SLOWLY), 1.0)
        self._share = max(self._share - pace * dt_s, 0.0)
        setpoint = self._goal + self._share * way
        # An untrusted limb has no current: its law gets zero error.
        reference = np.where(trusted, self._law.tension_gain * (setpoint - tension), 0.0)
        position = np.where(trusted, elongation, 0.0)
        if not self._law.advance(reference, position, min(dt_s, LONGEST_STEP_S)):
            return self.stop()
        self.current[:] = pay_out_only(np.where(trusted, self._law.current, 0.0), speed)
        return self.current

    def warm_up(self, tension: FloatArray, elongation: FloatArray) -> None:
        """Compile what step() needs, for the arrays that it will get; ends at rest.

        Args:
            tension: (n,) [N].
            elongation: (n,) [m].
        """
        n = self.current.size
        self.begin(0.0, np.full(n, 50.0), np.zeros(n), np.ones(n, dtype=np.bool_))
        self.step(1e-3, tension, elongation, np.zeros(n))
        self.stop()

    def stop(self) -> FloatArray:
        """Rest: zero currents from now on."""
        self.active = False
        self.current[:] = 0.0
        return self.current
