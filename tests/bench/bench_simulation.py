# SPDX-License-Identifier: Apache-2.0
"""How much faster than real time the closed loop runs in one process, without DDS, on one core."""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

import numpy as np
from record import write_figures

from cabols_control.load_programs.programs import load_program
from cabols_control.rig import load_rig
from cabols_hw.card.config import load_card
from cabols_sim.plant.closed_loop import PERIOD_S, simulate
from cabols_sim.plant.config import load_plant

TARGET = 50.0


def main() -> None:
    """Print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/simulation.json"))
    parser.add_argument("--repeats", type=int, default=7)
    arguments = parser.parse_args()
    core = min(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {core})
    rig = load_rig()
    card = load_card()
    plant = load_plant()
    program = load_program("multi_axis")
    time_s = np.arange(0.0, program.duration, PERIOD_S)
    desired = np.array([program.at(t) for t in time_s])
    simulate(rig, card, plant, desired[:100])
    ratios = []
    for seed in range(arguments.repeats):
        began = time.perf_counter()
        simulate(rig, card, plant, desired, seed=seed)
        ratios.append(time_s.size * PERIOD_S / (time.perf_counter() - began))
    figures = {
        "simulated_s": time_s.size * PERIOD_S,
        "substeps_per_cycle": plant.substeps,
        "times_real_time_median": float(np.median(ratios)),
        "times_real_time_min": float(np.min(ratios)),
        "times_real_time_max": float(np.max(ratios)),
        "target": TARGET,
        "met": bool(np.median(ratios) >= TARGET),
    }
    write_figures(arguments.output, figures)
    print(
        f"closed loop, full plant, 8 limbs, one core: "
        f"{figures['times_real_time_median']:.0f} times real time (median of {len(ratios)}; "
        f"{figures['times_real_time_min']:.0f} to "
        f"{figures['times_real_time_max']:.0f}); target {TARGET:.0f}: "
        f"{'met' if figures['met'] else 'NOT met'}"
    )


if __name__ == "__main__":
    main()
