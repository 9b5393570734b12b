"""Node: the bridge on a Quanser Q8 card with an ATI force/torque sensor."""

from __future__ import annotations

import sys

from cabols_control.errors import ConfigError
from cabols_control.rig import Rig
from cabols_control.ros.node import run_node
from cabols_control.ros.parameters import declare
from cabols_hw.card_config import CardConfig
from cabols_hw.daq import Daq
from cabols_hw.quanser import open_q8
from cabols_hw.ros.bridge_node import BridgeNode


def open_card(node: BridgeNode, rig: Rig, card: CardConfig) -> Daq:
    """Open the card that the parameters name."""
    board = declare(node, "board", "0", "number of the Q8 in this machine")
    if card.wiring.limbs != rig.geometry.cables:
        raise ConfigError(
            f"wiring.motors: expected {rig.geometry.cables} channels as the geometry has cables, "
            f"got {card.wiring.limbs}"
        )
    return open_q8(board, card)


def main() -> int:
    """Entry point."""
    return run_node(lambda: BridgeNode("q8_ati_bridge", open_card))


if __name__ == "__main__":
    sys.exit(main())
