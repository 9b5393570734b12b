# SPDX-License-Identifier: Apache-2.0
"""Leads the limbs' tensions along the campaign's trajectory: topic desired_tension."""

from __future__ import annotations

import threading

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.ros.messages import topics
from cabols_control.ros.node import ControlNode


class TensionLeader:
    """Publishes the tension setpoints, which move to a goal at a limited rate.

    While it is silent the wrench controller ramps the tensions down by itself.
    """

    def __init__(self, node: ControlNode) -> None:
        """Advertise desired_tension; silent until lead()."""
        layout = topics.desired_tension_layout(node.rig.geometry)
        self._record = layout.record()
        self._record["limb"][:] = np.arange(node.rig.geometry.cables)
        self._output = node.advertise("desired_tension")
        self._sessions = node.status.sessions
        self.rest = np.full(node.rig.geometry.cables, node.rig.holding_tension)
        self._lock = threading.Lock()
        self._goal = self.rest.copy()
        self._setpoint = self.rest.copy()
        self._rate = 0.0
        self._newest_ns = -1
        self._leading = False

    def lead(self, rate: float) -> None:
        """Start, at rest, to change tensions at a rate [N/s]."""
        with self._lock:
            self._goal, self._setpoint = self.rest.copy(), self.rest.copy()
            self._rate, self._leading = rate, True

    def silence(self) -> None:
        """Stop publishing."""
        with self._lock:
            self._leading = False

    def go(self, tension: FloatArray) -> None:
        """Set another goal (n,) [N]."""
        with self._lock:
            self._goal = np.array(tension)

    @property
    def arrived(self) -> bool:
        """Whether the setpoints have reached the goal."""
        with self._lock:
            return bool(np.array_equal(self._goal, self._setpoint))

    def step(self, now_ns: int) -> None:
        """Move on to the rig's time [ns] and publish."""
        with self._lock:
            elapsed_s = 1e-9 * (now_ns - self._newest_ns) if self._newest_ns >= 0 else 0.0
            self._newest_ns = now_ns
            if not self._leading or now_ns < 0:
                return
            reach = self._rate * max(elapsed_s, 0.0)
            self._setpoint += np.clip(self._goal - self._setpoint, -reach, reach)
            self._record.stamp(now_ns)
            self._record["tension"][:] = self._setpoint
            self._record["session"][0] = self._sessions.session
            raw = self._record.raw()
        self._output.publish(raw)
