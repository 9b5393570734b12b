"""Compile and cache the simulation's kernels once, so that no run waits for that."""

from __future__ import annotations

import numpy as np

from cabols_control.configuration import load_config
from cabols_control.rig import load_rig
from cabols_control.rig_folder import rig_file
from cabols_hw.card.config import CardConfig
from cabols_sim.plant.closed_loop import simulate
from cabols_sim.plant.config import PlantConfig


def main() -> None:
    """Call the compiled closed loop once."""
    card = load_config(CardConfig, rig_file("card.yaml"))
    plant = load_config(PlantConfig, rig_file("plant.yaml"))
    simulate(load_rig(), card, plant, np.zeros((5, 6)))


if __name__ == "__main__":
    main()
