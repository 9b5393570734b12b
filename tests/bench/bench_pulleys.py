# SPDX-License-Identifier: Apache-2.0
"""Time of a new pose with its decomposition: cables over pulleys against cables between points.

Both in turn in one run, as the median of blocks; writes build/bench/pulleys.json.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from record import write_figures
from scipy.spatial.transform import Rotation

from cabols_control.cable_kernels import structure_matrix_into
from cabols_control.geometry import RigGeometry, load_geometry
from cabols_control.tension import DEFAULT_WEIGHTS, RigTensionResolver, prepare_pose, work_size

RADIUS_M = 0.04
LOW, HIGH = 1.0, 150.0
BLOCKS, CALLS = 60, 500


class Pose:
    """One geometry's calls at the same poses."""

    def __init__(self, geometry: RigGeometry, positions: np.ndarray, rotations: np.ndarray) -> None:
        """Prepare arrays and compile."""
        n = geometry.cables
        self.cables, self.at = geometry.records(), list(zip(positions, rotations, strict=True))
        self.matrix, self.work = np.zeros((6, n)), np.zeros(work_size(n))
        self.limits = (np.full(n, LOW), np.full(n, HIGH), np.array(DEFAULT_WEIGHTS))
        self.resolver = RigTensionResolver(
            geometry.base_points,
            geometry.platform_points,
            LOW,
            HIGH,
            pulley_radius=geometry.pulley_radius,
            pulley_axes=geometry.pulley_axes,
        )
        self.wrench, self.tension = np.array([20.0, -10.0, 15.0, 1.0, 0.5, -1.0]), np.zeros(n)

    def decompose(self) -> None:
        """Structure matrix and what the wrench controller does with it at a new pose."""
        for position, rotation in self.at:
            structure_matrix_into(self.cables, position, rotation, self.matrix)
            prepare_pose(self.matrix, *self.limits, self.work)

    def solve(self) -> None:
        """Tensions at a new pose in one call."""
        for position, rotation in self.at:
            self.resolver.solve_into(position, rotation, self.wrench, self.tension)


def main() -> int:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/pulleys.json"))
    options = parser.parse_args()
    rng, bench = np.random.default_rng(5), load_geometry()
    positions = bench.reference_position + rng.uniform(-0.15, 0.15, (CALLS, 3))
    rotations = Rotation.from_rotvec(rng.uniform(-0.2, 0.2, (CALLS, 3))).as_matrix()
    kinds = {
        "points": Pose(bench, positions, rotations),
        "pulleys": Pose(replace(bench, pulley_radius=RADIUS_M), positions, rotations),
    }
    figures: dict[str, float] = {}
    for task in ("decompose", "solve"):
        taken: dict[str, list[float]] = {name: [] for name in kinds}
        for block in range(BLOCKS + 3):
            for name, kind in kinds.items():
                start = time.perf_counter_ns()
                getattr(kind, task)()
                if block >= 3:
                    taken[name].append((time.perf_counter_ns() - start) / CALLS)
        for name, times in taken.items():
            figures[f"{task}_{name}_ns"] = float(np.median(times))
        ratio = np.median(np.array(taken["pulleys"]) / np.array(taken["points"]))
        figures[f"{task}_ratio"] = float(ratio)
        print(
            f"{task:10} points {figures[f'{task}_points_ns']:7.0f} ns, pulleys "
            f"{figures[f'{task}_pulleys_ns']:7.0f} ns, ratio {ratio:.2f} (at most 1.5)"
        )
    write_figures(options.output, figures)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
