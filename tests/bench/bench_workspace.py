# SPDX-License-Identifier: Apache-2.0
"""Wrench-feasible grid of 100 000 poses: hyperplanes on two cores beside linear programmes.

Usage: python tests/bench/bench_workspace.py [--output build/bench/workspace.json]

The opponent asks HiGHS for tensions at each of the 64 vertices of the same box of wrenches, with
a reused model that starts warm, and stops at a pose's first infeasible vertex (wrench_lps.py);
scipy's linprog is timed beside it and is slower. It takes a random part of the same poses, and
its time is scaled to all of them; both must agree on every pose of that part. The workers are
started and have their compiled code loaded before the clock starts.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from scipy.optimize import linprog

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from record import write_figures

from cabols_control.geometry import load_geometry
from cabols_control.kinematics import structure_matrix
from cabols_control.workspace.capacity import capacity_task
from cabols_control.workspace.grid import box_grid, tilts
from cabols_control.workspace.tool.workers import workers
from cabols_control.workspace.wrench_set import wrench_box
from wrench_lps import box_vertices, feasible_poses

LOW, HIGH = 1.0, 150.0
BOX = [50.0, 50.0, 50.0, 5.0, 5.0, 5.0]
HALF_WIDTHS = [0.6, 0.5, 0.5]
TILT_DEG = 15.0
UNDECIDED_N = 1e-6
"""A margin this near to zero is within the linear programmes' own tolerance."""


def timed(call):
    """Seconds and result of a call."""
    start = time.perf_counter()
    result = call()
    return time.perf_counter() - start, result


def feasible_of(found):
    """(poses,) flags in the order of the grid's positions, then orientations."""
    return found.feasible.reshape(-1), found.capacity.margin.reshape(-1)


def measure(task, grid, large, repeats):
    """Best seconds of the small grid on two workers, of the large one on one and two, in turn."""
    times = {"grid_two": [], "large_one": [], "large_two": []}
    with workers("local", 1) as one, workers("local", 2) as two:
        for pool in (one, two):
            pool.evaluate(grid, task)
        for _ in range(repeats):
            seconds, found = timed(lambda: two.evaluate(grid, task))
            times["grid_two"].append(seconds)
            times["large_one"].append(timed(lambda: one.evaluate(large, task))[0])
            times["large_two"].append(timed(lambda: two.evaluate(large, task))[0])
    return {name: min(values) for name, values in times.items()}, found


def linprog_seconds(geometry, positions, rotations, vertices, count=40):
    """Seconds per linear programme of scipy's linprog (HiGHS)."""
    matrices = [
        structure_matrix(geometry, p, r)
        for p, r in zip(positions[:count], rotations[:count], strict=True)
    ]
    seconds, _ = timed(
        lambda: [
            linprog(np.zeros(8), A_eq=A, b_eq=w, bounds=(LOW, HIGH), method="highs")
            for A, w in zip(matrices, vertices, strict=False)
        ]
    )
    return seconds / count


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/workspace.json"))
    parser.add_argument("--poses-by-programmes", type=int, default=10_000)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    geometry = load_geometry()
    task = capacity_task(geometry, LOW, HIGH, wrench_box(BOX))
    centre = geometry.reference_position
    grid = box_grid(centre, HALF_WIDTHS, (25, 24, 24), tilts(TILT_DEG))
    large = box_grid(centre, HALF_WIDTHS, (53, 52, 52), tilts(TILT_DEG))
    seconds, found = measure(task, grid, large, options.repeats)
    feasible, margin = feasible_of(found)
    rng = np.random.default_rng(5)
    some = rng.choice(grid.poses, options.poses_by_programmes, replace=False)
    positions = grid.positions[some // len(grid.angles_deg)]
    rotations = grid.rotations[some % len(grid.angles_deg)]
    vertices = box_vertices(BOX)
    lp_seconds, (answers, programmes) = timed(
        lambda: feasible_poses(geometry, positions, rotations, vertices, LOW, HIGH)
    )
    scaled = lp_seconds / len(some) * grid.poses
    decided = np.abs(margin[some]) > UNDECIDED_N
    differ = int((answers != feasible[some])[decided].sum())
    figures = {
        "poses": grid.poses,
        "feasible_share": float(feasible.mean()),
        "two_workers_s": seconds["grid_two"],
        "two_workers_us_per_pose": 1e6 * seconds["grid_two"] / grid.poses,
        "poses_by_programmes": len(some),
        "programmes": programmes,
        "programme_us": 1e6 * lp_seconds / programmes,
        "linprog_us": 1e6 * linprog_seconds(geometry, positions, rotations, vertices),
        "programmes_measured_s": lp_seconds,
        "programmes_scaled_one_core_s": scaled,
        "programmes_scaled_two_cores_s": scaled / 2.0,
        "ratio_to_one_core": scaled / seconds["grid_two"],
        "ratio_to_two_cores": scaled / 2.0 / seconds["grid_two"],
        "disagreements": differ,
        "undecided": int((~decided).sum()),
        "large_poses": large.poses,
        "large_one_worker_s": seconds["large_one"],
        "large_two_workers_s": seconds["large_two"],
        "speedup_of_two_workers": seconds["large_one"] / seconds["large_two"],
    }
    rows = [
        ("hyperplanes on two cores against HiGHS on two: ratio", "ratio_to_two_cores", 100.0),
        ("speed-up from one to two workers", "speedup_of_two_workers", 1.7),
    ]
    print(
        f"{grid.poses} poses, {100 * figures['feasible_share']:.1f} % feasible: "
        f"{figures['two_workers_s']:.3f} s on two workers "
        f"({figures['two_workers_us_per_pose']:.2f} us a pose)"
    )
    print(
        f"HiGHS, {programmes} warm programmes for {len(some)} of the poses: {lp_seconds:.2f} s "
        f"({figures['programme_us']:.0f} us each; linprog {figures['linprog_us']:.0f} us); scaled "
        f"to all: {scaled:.0f} s on one core, {scaled / 2:.0f} s on two"
    )
    print(
        f"agreement on {len(some)} poses: {differ} differ, {figures['undecided']} within "
        f"{UNDECIDED_N:g} N of the boundary"
    )
    print(
        f"{large.poses} poses: one worker {seconds['large_one']:.2f} s, "
        f"two {seconds['large_two']:.2f} s"
    )
    for name, key, limit in rows:
        met = figures[key] >= limit
        figures[f"{key}_met"] = bool(met)
        print(f"{name}: {figures[key]:.2f} >= {limit:g}: {'met' if met else 'NOT met'}")
    print(f"against HiGHS on one core: {figures['ratio_to_one_core']:.0f}")
    write_figures(options.output, figures)


if __name__ == "__main__":
    main()
