# SPDX-License-Identifier: Apache-2.0
"""Records limb states and wrenches during an action, for figures."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from cabols_control.rig import Rig
from cabols_control.ros.loop import Input, make_wait_set, wait_for
from cabols_control.ros.messages import topics

IDLE_NS = 50_000_000
ROW = np.dtype(
    [
        ("phase", np.float64),
        ("time", np.float64),  # [s]
        ("current", np.float64),  # [A]
        ("wound_length", np.float64),  # [m]
        ("elongation", np.float64),  # [m]
        ("tension", np.float64),  # [N]
        ("wrench", np.float64, (6,)),  # platform axes [N, N m]
    ]
)


class LimbTrace:
    """Keeps one limb's states and the wrench at the control rate, in a thread of its own."""

    def __init__(self, node: Any, rig: Rig) -> None:
        """Subscribe; start() begins."""
        self._state = Input(node, "limb_state", topics.limb_state_layout(rig.geometry))
        frame = rig.geometry.platform_frame
        self._wrench = Input(node, "wrench", topics.wrench_layout(frame))
        self._wait_set = make_wait_set(node, 1)
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._limb = -1
        self._rows: list[tuple] = []
        self._thread = threading.Thread(target=self._body, daemon=True)
        self.phase = 0

    def start(self) -> None:
        """Start to receive."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join(timeout=1.0)

    def begin(self, limb: int) -> None:
        """Drop all rows; record this limb's states from now on."""
        with self._lock:
            self._rows, self._limb, self.phase = [], limb, 0

    def restart(self) -> None:
        """Drop all rows; go on with the same limb."""
        self.begin(self._limb)

    def rows(self) -> np.ndarray:
        """(k,) records of ROW; the current of a row was on the motor until the row's time."""
        with self._lock:
            return np.array(self._rows, dtype=ROW)

    def _body(self) -> None:
        while not self._stop.is_set():
            if wait_for(self._wait_set, (self._state,), IDLE_NS) and self._state.take():
                self._wrench.take()
                with self._lock:
                    if self._limb >= 0:
                        self._keep(self._limb)

    def _keep(self, limb: int) -> None:
        state, wrench = self._state.record, self._wrench.record
        names = ("current", "wound_length", "elongation", "tension")
        values = [float(state[name][limb]) for name in names]
        forces = [float("nan")] * 6 if wrench is None else wrench["wrench"].tolist()
        self._rows.append((self.phase, 1e-9 * self._state.stamp_ns, *values, forces))
