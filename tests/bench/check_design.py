# SPDX-License-Identifier: Apache-2.0
"""Check a designed geometry by other means: linear programmes, and the bench that runs it.

Usage: python tests/bench/check_design.py GEOMETRY.yaml [--output build/bench/geometry_design.json]

Feasible volume: HiGHS asks for tensions at every vertex of the box of wrenches, at every position
and orientation of a grid, for the reference bench and for the design; nothing of the hyperplane
test is used. Then both run a load programme in the compiled closed loop with the full plant.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from record import write_figures

from cabols_control.geometry import load_geometry
from cabols_control.kinematics import structure_matrix
from cabols_control.load_programs.programs import load_program
from cabols_control.rig import load_rig
from cabols_control.workspace.capacity import capacity_along
from cabols_control.workspace.grid import box_grid, tilts
from cabols_control.workspace.wrench_set import wrench_box
from cabols_hw.card.config import load_card
from cabols_sim.plant.closed_loop import PERIOD_S, simulate
from cabols_sim.plant.config import load_plant
from wrench_lps import VertexPrograms, box_vertices

BOX = [50.0, 50.0, 50.0, 5.0, 5.0, 5.0]
HALF_WIDTHS, COUNTS, TILT_DEG = [0.6, 0.5, 0.5], (13, 11, 11), 15.0
TARGET = 1.5


def volume_by_programmes(geometry, grid, low, high, name):
    """Volume of the positions feasible at all orientations [m^3], and the positions."""
    programs, vertices = VertexPrograms(geometry.cables, low, high), box_vertices(BOX)
    began, answers = time.monotonic(), []
    for k, position in enumerate(grid.positions):
        answers.append(
            all(
                programs.feasible(structure_matrix(geometry, position, rotation), vertices)
                for rotation in grid.rotations
            )
        )
        if k % 100 == 0:
            print(
                f"\r{name}: {k} of {len(grid.positions)} positions, {programs.solved} linear "
                f"programmes, {time.monotonic() - began:.0f} s",
                end="",
                flush=True,
            )
    print()
    return sum(answers) * grid.cell_volume, np.array(answers)


def agrees(geometry, grid, low, high, answers):
    """Positions where the hyperplane test says otherwise."""
    repeat = len(grid.rotations)
    found = capacity_along(
        geometry,
        np.repeat(grid.positions, repeat, axis=0),
        np.tile(grid.rotations, (len(grid.positions), 1, 1)),
        low,
        high,
        wrench_box(BOX),
    )
    return int((found.feasible.reshape(-1, repeat).all(axis=1) != answers).sum())


def run_bench(rig, seed=1):
    """Figures of the multi-axis programme in the closed loop."""
    card = load_card()
    plant = load_plant()
    program = load_program("multi_axis")
    desired = np.array([program.at(t) for t in np.arange(0.0, program.duration, PERIOD_S)])
    trace = simulate(rig, card, plant, desired, seed=seed)
    error = np.abs(trace.wrench - trace.desired)[500:] / rig.control.rated
    return {
        "infeasible_cycles": int((trace.status != 0).sum()),
        "tracking_error_rms_of_rated": float(np.sqrt((error**2).mean())),
        "tension_min_after_start_n": float(trace.tension[500:].min()),
        "tension_max_n": float(trace.tension.max()),
        "current_max_a": float(np.abs(trace.current).max()),
    }


def main() -> int:
    """Print and write; 1 if the design does not beat the bench by TARGET."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("geometry", type=Path)
    parser.add_argument("--output", type=Path, default=Path("build/bench/geometry_design.json"))
    options = parser.parse_args()
    rig = load_rig()
    low, high = rig.control.tension_min, rig.control.tension_max
    grid = box_grid(rig.geometry.reference_position, HALF_WIDTHS, COUNTS, tilts(TILT_DEG))
    figures = {"box": BOX, "tilt_deg": TILT_DEG}
    rigs = {"bench": rig, "design": replace(rig, geometry=load_geometry(options.geometry))}
    for name, each in rigs.items():
        volume, answers = volume_by_programmes(each.geometry, grid, low, high, name)
        figures[name] = {
            "feasible_volume_m3": volume,
            "hyperplanes_differ_at": agrees(each.geometry, grid, low, high, answers),
            **run_bench(each),
        }
        for key, value in figures[name].items():
            print(f"  {key:30} {value:.4g}")
    factor = figures["design"]["feasible_volume_m3"] / figures["bench"]["feasible_volume_m3"]
    figures["volume_factor"] = factor
    figures["met"] = bool(factor >= TARGET)
    print(
        f"feasible volume by linear programmes: {factor:.2f} times the bench's >= {TARGET:g}: "
        f"{'met' if figures['met'] else 'NOT met'}"
    )
    write_figures(options.output, figures)
    return 0 if figures["met"] else 1


if __name__ == "__main__":
    sys.exit(main())
