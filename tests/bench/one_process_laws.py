# SPDX-License-Identifier: Apache-2.0
"""Limb and wrench controller in one process, the wrench law called directly: for a benchmark only.

Both nodes are there, with their topics, services and reports; one control thread, that of the limb
controller, does the work of both. ORDER says which law goes first: the limbs', which then uses the
tensions of the sample before, as separate processes do; or the wrench law, whose tensions the limbs
follow at once.
"""

from __future__ import annotations

import os
import sys

import numpy as np

from cabols_control.limb_control.controller import TensionSetpoint
from cabols_control.nodes.limb_controller import LimbControllerNode
from cabols_control.nodes.wrench_controller import WrenchControllerNode
from cabols_control.ros.loop import make_wait_set, wait
from cabols_control.ros.node import run_node

ORDER = "CABOLS_LAWS_ORDER"
LIMBS_FIRST, WRENCH_FIRST = "limbs", "wrench"
WAIT_NS = 400_000
"""For the wrench of a sample, which the bridge sends after the limbs' state."""


class BothLawsNode(LimbControllerNode):
    """The limb controller, with the wrench controller beside it in its executor and thread."""

    def __init__(self):
        super().__init__()
        self._other = WrenchControllerNode()
        self._wait_set = make_wait_set(self, 1)
        self._turns = 0
        self._wrench_first = os.environ.get(ORDER) == WRENCH_FIRST

    def begin(self):
        self.executor.add_node(self._other)
        super().begin()

    def end(self):
        super().end()
        self._other.end()

    def end_asked(self):
        super().end_asked()
        self._other.end_asked()

    def _hear_command(self):
        return self._setpoint

    def _step(self):
        if self._wrench_first:
            self._wrench_law()
        super()._step()
        if not self._wrench_first:
            self._wrench_law()

    def _wrench_law(self):
        """Step the wrench controller; its tensions are the limbs' setpoint."""
        other = self._other
        if not other._wrench.take():
            wait(self._wait_set, (other._wrench,), WAIT_NS)
            if not other._wrench.take():
                return
        self._turns += 1
        for companion in other._loop._companions:
            if self._turns % companion.every == 0:
                companion.take()
        other._step()
        law = other._controller
        self._command.count = 1
        tension = np.array(law.tension)[self._controller.limbs]
        stamp_s = 1e-9 * other._wrench.stamp_ns
        self._setpoint = TensionSetpoint(stamp_s, tension, bool(law.active))
        self._tension_sequence = other._wrench.dds_sequence


if __name__ == "__main__":
    sys.exit(run_node(BothLawsNode))
