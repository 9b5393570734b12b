# SPDX-License-Identifier: Apache-2.0
"""Tension setpoints in joint space: followed inside limits, ramped down when none arrive any more.

Section 4.3: a wrench may be infeasible, positive tensions never are. A campaign that needs only a
suitable wrench, and measures it, therefore loads the robot by tensions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.rig import Rig


@dataclass(frozen=True, eq=False)
class DesiredTension:
    """Newest desired tensions: (n,) [N], and their stamp."""

    stamp_s: float
    tension: FloatArray


class TensionReference:
    """Ramp of the tensions to their setpoints.

    Attributes:
        tension: (n,) in force [N]; meaningful only while active.
        active: whether tensions are commanded, not a wrench.
        limited: whether the setpoints lie outside the limits.
        stale: whether the tensions are being ramped down because the setpoints are too old.
    """

    def __init__(self, rig: Rig) -> None:
        """Start inactive."""
        control = rig.control
        self._limits = (control.tension_min, control.tension_max)
        self._rest = rig.holding_tension
        self._rate = control.unload_tension_rate
        self._timeout = control.desired_timeout
        self.tension = np.full(rig.geometry.cables, rig.holding_tension)
        self.active = False
        self.limited = False
        self.stale = False

    def reset(self) -> None:
        """Drop the setpoints: the next tensions start from rest."""
        self.tension[:] = self._rest
        self.active = self.limited = self.stale = False

    def step(
        self,
        stamp_s: float,
        dt_s: float,
        setpoint: DesiredTension | None,
        present: FloatArray | None,
    ) -> bool:
        """Advance by one sample.

        Args:
            stamp_s: of the sample [s].
            dt_s: since the one before [s].
            setpoint: newest desired tensions; None before the first.
            present: (n,) tensions that a wrench has commanded so far, where these take over [N];
                None: the limbs are at rest.

        Returns:
            Whether tensions are in command.
        """
        fresh = setpoint is not None and abs(stamp_s - setpoint.stamp_s) <= self._timeout
        if not fresh and not self.active:
            return False
        if not self.active:
            self.tension[:] = self._rest if present is None else present
            self.active = True
        goal = np.full_like(self.tension, self._rest)
        self.stale, self.limited = not fresh, False
        if fresh and setpoint is not None:
            np.clip(setpoint.tension, *self._limits, out=goal)
            self.limited = not np.array_equal(goal, setpoint.tension)
        reach = self._rate * dt_s
        self.tension += np.clip(goal - self.tension, -reach, reach)
        if self.stale and np.array_equal(self.tension, goal):
            self.reset()
        return self.active
