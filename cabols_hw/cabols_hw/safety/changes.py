# SPDX-License-Identifier: Apache-2.0
"""What the sensor tells of pre-tightened limbs while its bias is not known: changes; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.supervision.faults import FaultName
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.faults import BridgeFault


class ChangeWatch:
    """Compares how sensor and tension estimates have changed since all limbs have had zeros.

    A bias stays the same in the platform's axes, so that it falls out. Where the pose moves and the
    platform stands, the limbs follow the pose: the estimates stay, and the sensor feels it.
    """

    def __init__(self, config: SafetyConfig) -> None:
        """Start without a sample.

        Args:
            config: limits of the difference between sensor and estimates.
        """
        self._config = config
        self._first: FloatArray | None = None
        self._apart_s = 0.0

    def begin(self) -> None:
        """Forget: the next sample is compared with."""
        self._first, self._apart_s = None, 0.0

    def judge(self, dt_s: float, bridge: Bridge) -> BridgeFault | None:
        """Return a fault if the two have changed differently for too long.

        Args:
            dt_s: since the sample before [s].
            bridge: with the sample's values; all its limbs have zeros.
        """
        difference = bridge.structure @ bridge.tension
        difference[:3] = bridge.rotation.T @ difference[:3]
        difference[3:] = bridge.rotation.T @ difference[3:]
        difference -= bridge.wrench
        if self._first is None:
            self._first = difference
        change = difference - self._first
        most = self._config
        force, torque = np.linalg.norm(change[:3]), np.linalg.norm(change[3:])
        apart = not (force <= most.estimate_force and torque <= most.estimate_torque)
        self._apart_s = self._apart_s + dt_s if apart else 0.0
        if not self._apart_s > most.estimate_time:
            return None
        return BridgeFault(
            FaultName.ESTIMATE,
            f"the force/torque sensor has changed by {force:.0f} N or {torque:.1f} N m more than "
            f"the tension estimates have, {most.estimate_force:g} N or "
            f"{most.estimate_torque:g} N m allowed: is the platform's pose right?",
        )
