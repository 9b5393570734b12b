# SPDX-License-Identifier: Apache-2.0
"""What a rig may do before its wiring has been checked: one limb, 0.1 A, 5 mm; pure.

The bridge holds it after all controllers: with motors, encoders or switches exchanged no other rule
knows which limb it looks at.
"""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.commissioning.first_power_on import CURRENT_A, TRAVEL_M
from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.safety.faults import BridgeFault

COASTING_M = 0.002
"""Way of a motor that was cut at 0.1 A's speed, beyond TRAVEL_M."""
UNCHECKED = (
    "the rig's wiring has not been checked as it is configured: run first_power_on, with slack "
    "cables; until then one limb moves at a time, at 0.1 A, for 5 mm"
)


class PowerOnBound:
    """Bounds the currents until the check has passed."""

    def __init__(self, cables: int) -> None:
        """Start at rest.

        Args:
            cables: number of the rig's.
        """
        self._start = np.zeros(cables)
        self._limb = -1
        self._inside = False
        self._output = np.zeros(cables)

    def judge(self, mode: OperatingMode, wound: FloatArray) -> BridgeFault | None:
        """Return a fault if an encoder went beyond its way since the mode was entered.

        Args:
            mode: newest mode.
            wound: (n,) [m].
        """
        inside = mode == OperatingMode.COMMISSIONING
        if not inside or not self._inside:
            self._start[:] = wound
            self._limb = -1
        self._inside = inside
        if not np.abs(wound - self._start).max() <= TRAVEL_M + COASTING_M:
            return BridgeFault(FaultName.FIRST_POWER_ON, f"beyond 5 mm: {UNCHECKED}")
        return None

    def bounded(self, mode: OperatingMode, current: FloatArray) -> FloatArray:
        """(n,) currents of at most 0.1 A, of one limb in a mode; zero in other modes [A].

        Args:
            mode: newest mode.
            current: (n,) commanded [A].
        """
        output = self._output
        output[:] = 0.0
        if mode != OperatingMode.COMMISSIONING:
            return output
        asked = np.flatnonzero(current)
        if self._limb < 0 and asked.size == 1:
            self._limb = int(asked[0])
        if self._limb >= 0:
            value = float(current[self._limb])
            output[self._limb] = min(max(value, -CURRENT_A), CURRENT_A)
        return output
