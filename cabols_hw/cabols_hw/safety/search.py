# SPDX-License-Identifier: Apache-2.0
"""What the sensor says while limbs search for their switches: a pull that grows; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.naming import limb_name
from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.safety.faults import BridgeFault


class SearchWatch:
    """Finds limbs that keep winding in because their switches do not close.

    A cable that is slack changes no force. A load that the gears hold since a cut is present from
    the start: only what is added to it counts.
    """

    def __init__(self, cables: int, most_n: float) -> None:
        """Start without a search.

        Args:
            cables: number of the rig's.
            most_n: growth of the force that is allowed [N].
        """
        self._most_n = most_n
        self._lowest_n = np.inf
        self._began: FloatArray | None = None
        self._wound = np.zeros(cables)
        self._force = np.zeros(3)

    def begin(self) -> None:
        """Forget the search before."""
        self._lowest_n, self._began = np.inf, None

    def judge(self, bridge: Bridge, mode: OperatingMode) -> BridgeFault | None:
        """Return a fault if the pull has grown too much.

        Args:
            bridge: with the sample's values.
            mode: in which limbs search.
        """
        force = bridge.rotation @ bridge.wrench[:3]
        grown, pull = self._grown(bridge, force)
        if not grown > self._most_n:
            return None
        # Of the limbs whose switch is still open, the one that pulls in this direction.
        along = np.where(bridge.zeroed, -np.inf, bridge.structure[:3].T @ pull)
        i = int(np.argmax(along))
        return BridgeFault(
            FaultName.SWITCH,
            f"{limb_name(i)}: the pull has grown to {np.linalg.norm(pull):.0f} N in {mode.name}, "
            f"by more than {self._most_n:g} N, and its switch is open: stuck, or exchanged with "
            "another limb's, or, where all are, switch_active_low of card.yaml the wrong way "
            "round?",
            i,
        )

    def _grown(self, bridge: Bridge, force: FloatArray) -> tuple[float, FloatArray]:
        """Growth of the pull [N], and (3,) the pull [N].

        Without a bias the sensor tells changes alone. What counts then is the change along what
        the limbs that have wound in would pull, if their cables had been taut from the start: limbs
        that pay out change the force, too.
        """
        if bridge.tared:
            size = float(np.linalg.norm(force))
            self._lowest_n = min(self._lowest_n, size)
            return size - self._lowest_n, force
        if self._began is None:
            self._began, self._wound[:] = force, bridge.wound_length
        wound_in = np.maximum(bridge.wound_length - self._wound, 0.0)
        pull = bridge.structure[:3] @ (bridge.limbs["stiffness"] * wound_in)
        size = float(np.linalg.norm(pull))
        along = float((force - self._began) @ pull) / max(size, 1e-9)
        return min(size, along), pull
