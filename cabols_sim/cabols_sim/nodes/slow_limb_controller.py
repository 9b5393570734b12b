# SPDX-License-Identifier: Apache-2.0
"""Node: the limb controller with a millisecond burnt in every cycle; for the simulated bench alone.

It shows that slow software turns the demo red (`make demo ARGS=--slow-limb-law`). A rig's launch
file never starts it.
"""

from __future__ import annotations

import sys
import time

from cabols_control.nodes.limb_controller import LimbControllerNode
from cabols_control.ros.node import run_node
from cabols_control.supervision.modes import OperatingMode

BURN_NS = 1_000_000


class SlowLimbControllerNode(LimbControllerNode):
    """LimbControllerNode whose law takes a millisecond longer."""

    def _present_mode(self) -> OperatingMode:
        until = time.monotonic_ns() + BURN_NS
        while time.monotonic_ns() < until:
            pass
        return super()._present_mode()


def main() -> int:
    """Entry point."""
    return run_node(SlowLimbControllerNode)


if __name__ == "__main__":
    sys.exit(main())
