# SPDX-License-Identifier: Apache-2.0
"""Compile and cache the simulation's kernels once, so that no run waits for the compiler."""

from __future__ import annotations

import numpy as np

from cabols_control.rig import load_rig
from cabols_hw.card.config import load_card
from cabols_sim.plant.closed_loop import simulate
from cabols_sim.plant.config import load_plant


def main() -> None:
    """Call the compiled closed loop once."""
    card = load_card()
    plant = load_plant()
    simulate(load_rig(), card, plant, np.zeros((5, 6)))


if __name__ == "__main__":
    main()
