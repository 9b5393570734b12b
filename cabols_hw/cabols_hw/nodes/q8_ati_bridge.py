# SPDX-License-Identifier: Apache-2.0
"""Node: the bridge on a Quanser Q8 card with an ATI force/torque sensor."""

from __future__ import annotations

import sys

import numpy as np

from cabols_control.rig import Rig
from cabols_control.ros.messages import topics
from cabols_control.ros.node import run_node
from cabols_control.ros.parameters import declare_row
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.bringup_nodes import NODES as HW_NODES
from cabols_hw.card.config import CardConfig
from cabols_hw.card.daq import CardSample, Daq
from cabols_hw.card.quanser import open_q8
from cabols_hw.ros.bridge_node import BridgeNode


def open_card(node: BridgeNode, rig: Rig, card: CardConfig) -> Daq:
    """Open the card that the parameters name."""
    board = declare_row(node, HW_NODES.argument("board"))
    node.hardware = f"Q8 card {board} with force/torque sensor"
    warm_up(rig, card)
    return open_q8(board, card)


def warm_up(rig: Rig, card: CardConfig) -> None:
    """Compile or load a sample's kernels: a running card does not wait for a compiler."""
    n = rig.geometry.cables
    bridge = Bridge(rig, card)
    # Arrays as they lie in the messages, for which numba compiles another kernel.
    state = topics.limb_state_layout(rig.geometry).record()
    wrench = topics.wrench_layout(rig.geometry.platform_frame).record()
    names = ("wound_length", "elongation", "tension", "switch_closed", "zeroed")
    bridge.bind({name: state[name] for name in names})
    bridge.bind({name: state[name] for name in ("cable_speed", "cable_acceleration")})
    bridge.bind({"wrench": wrench["wrench"]})
    bridge.hear_pose(0.0, rig.geometry.reference_position, rig.geometry.reference_rotation)
    sample = CardSample(0, np.zeros(n, dtype=np.int64), np.zeros(6), np.ones(n, dtype=np.bool_))
    bridge.take(sample, OperatingMode.STOPPED)
    bridge.volts(np.zeros(n))


def main() -> int:
    """Entry point."""
    return run_node(lambda: BridgeNode("q8_ati_bridge", open_card))


if __name__ == "__main__":
    sys.exit(main())
