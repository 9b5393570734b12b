# SPDX-License-Identifier: Apache-2.0
"""A wrench held while the platform moves, over pulleys that control knows or neglects.

Bridge, guard, controllers and full plant in one process, deterministic: 50 N and 5 N m, held in
platform axes about a point 100 mm off, while the platform goes 120 mm along x and z at 50 mm/s.
Errors of the wrench that the cables really give, and of the tensions that the bridge believes in.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from bench_moving import HELD, PEAK, WAY_M, frame_off, rms
from record import write_figures

from cabols_control.rig import Rig, load_rig
from cabols_hw.card.config import load_card
from cabols_sim.plant.card import SimulatedQ8
from cabols_sim.plant.config import load_plant
from cabols_sim.plant.plant import Plant
from moving_rig import MovingRig, TrippedError

SPEED_M_S = 0.05
POINTS, KNOWN, NEGLECTED = "points", "pulleys_known", "pulleys_neglected"


def figures_of(believed: Rig, true: Rig) -> dict[str, float]:
    """Run one pair of rigs.

    Args:
        believed: by bridge and controllers.
        true: of the plant.
    """
    rig = MovingRig(believed)
    card = load_card()
    rig.plant = Plant(true, card, load_plant(), 0, rig.target)
    rig.card = SimulatedQ8(rig.plant, card, believed.geometry.cables, lockstep=True)
    rig.card.start(card.watchdog)
    rig.frame = frame_off(believed)
    rig.load(HELD)
    rig.run(1.0)
    duration = PEAK * np.sqrt(2.0) * WAY_M / SPEED_M_S
    rig.target.move([WAY_M, 0.0, WAY_M, 0.0, 0.0, 0.0], duration)
    errors, tensions, tripped = [], [], 0.0
    for _ in range(40):
        try:
            errors.append(rig.errors(duration / 40.0))
        except TrippedError as error:
            print(f"    {error}")
            tripped = 1.0
            break
        tensions.append(np.abs(rig.bridge.tension - rig.plant.tension).max())
    if not errors:
        return {"tripped": tripped}
    force, torque = rms(np.concatenate(errors))
    return {
        "force_rms_n": force,
        "torque_rms_nm": torque,
        "tension_error_max_n": float(max(tensions)),
        "tripped": tripped,
        "share_of_way_loaded": len(errors) / 40.0,
    }


def main() -> int:
    """Run the three pairs; print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--radius", type=float, default=0.04, help="of the pulleys [m]")
    parser.add_argument("--output", type=Path, default=Path("build/bench/pulley_loop.json"))
    options = parser.parse_args()
    points = load_rig()
    over = replace(points, geometry=replace(points.geometry, pulley_radius=options.radius))
    figures = {"radius_m": options.radius}
    for name, believed, true in (
        (POINTS, points, points),
        (KNOWN, over, over),
        (NEGLECTED, points, over),
    ):
        print(f"{name}", flush=True)
        figures[name] = found = figures_of(believed, true)
        print("    " + ", ".join(f"{key} {value:.3g}" for key, value in found.items()), flush=True)
    write_figures(options.output, figures)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
