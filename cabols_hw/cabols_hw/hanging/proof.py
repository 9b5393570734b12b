# SPDX-License-Identifier: Apache-2.0
"""The proof, on the stand and at every start, that gears hold their pulls without current; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.naming import limb_name
from cabols_control.rig import Rig
from cabols_control.supervision.faults import FaultName
from cabols_control.workspace.suspension import payout_speeds
from cabols_hw.safety.faults import BridgeFault

SETTLED_S, WITHOUT_S = 0.3, 0.5
"""How long all limbs pull enough before the currents are taken away, and for how long."""
TOLERANCE_M = 1e-4
"""Motion of a cable beyond what its gear may give: a gear's play turns back, counts are whole."""


class GearProof:
    """Takes all currents away while every limb pulls, and looks whether a motor is turned back.

    Attributes:
        done: whether all gears have held.
        running: whether the currents are to be zero.
    """

    def __init__(self, rig: Rig, pull: float, largest_pull: float) -> None:
        """Start without a proof.

        Args:
            rig: with what is known of its gears.
            pull: of each limb, at which gears are proven [N].
            largest_pull: that a limb may have meanwhile [N].
        """
        self._pull = pull
        payout = payout_speeds(rig.limbs, np.full(rig.geometry.cables, largest_pull))
        self._given = payout * WITHOUT_S + TOLERANCE_M
        self._began = np.zeros(rig.geometry.cables)
        self._tension = np.zeros(rig.geometry.cables)
        self.done = self.running = False
        self._passed_s = 0.0

    def forget(self) -> None:
        """Drop the proof: another one is due."""
        self.done = False
        self.rest()

    def rest(self) -> None:
        """End what runs."""
        self.running, self._passed_s = False, 0.0

    def step(
        self, dt_s: float, wound: FloatArray, tension: FloatArray, switch: BoolArray
    ) -> BridgeFault | None:
        """Take a sample in LOADING, on the stand.

        Args:
            dt_s: since the one before [s].
            wound: (n,) lengths by the encoders [m].
            tension: (n,) estimates [N].
            switch: (n,) whether the limbs' switches are closed.

        Returns:
            The fault of a gear that does not hold.
        """
        if self.done:
            return None
        if not self.running:
            enough = bool((tension >= self._pull).all() and switch.all())
            self._passed_s = self._passed_s + dt_s if enough else 0.0
            if self._passed_s >= SETTLED_S:
                self.running, self._passed_s = True, 0.0
                self._began[:], self._tension[:] = wound, tension
            return None
        self._passed_s += dt_s
        beyond = self._began - wound - self._given
        worst = int(np.argmax(beyond))
        if beyond[worst] > 0.0:
            self.rest()
            return BridgeFault(
                FaultName.GEAR,
                f"{limb_name(worst)}: without current its pull of {self._tension[worst]:.0f} N "
                f"turned the motor back by {1e3 * (self._began - wound)[worst]:.2f} mm, "
                f"{1e3 * self._given[worst]:.2f} mm are what limbs.yaml says: its gear does not "
                "hold the platform",
                worst,
            )
        if self._passed_s >= WITHOUT_S:
            self.rest()
            self.done = True
        return None
