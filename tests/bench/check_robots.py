# SPDX-License-Identifier: Apache-2.0
"""Maps of the robots in examples/robots, one command and one file each, beside linear programmes.

Usage: python tests/bench/check_robots.py [--poses 500] [--output build/robots]

Each file is given to `workspace map`, whose table HiGHS then judges at random poses of it: for
every vertex of the required set the least and the largest multiple that tensions within the limits
give beside the weight. Exit code 1 if a flag differs, or a multiple by more than 1e-5 of itself.
It goes on where it was: answers are kept by robot beside the maps.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from pathlib import Path

import highspy
import numpy as np
import yaml
from record import write_figures
from scipy.spatial.transform import Rotation

from cabols_control.workspace.tool.command import main as workspace

ROBOTS = Path(__file__).resolve().parents[2] / "examples" / "robots"
WORDS = ("--scheduler", "inline", "--counts", "13", "13", "13", "--tilt", "10")
ROWS = {"spatial": range(6), "planar_xy": (0, 1, 5), "planar_xz": (0, 2, 4), "point": (0, 1, 2)}
GRAVITY = 9.80665
SAME_PRINTED = 1e-5
"""Of a multiple, which the table prints with six digits."""
NEAR = 1e-9
"""Distance of a multiple from 1, or of the two ends of its range, where rounding decides."""


class Multiples:
    """Range of s with A t - s v = held, low <= t <= high, s >= 0; one model, changed."""

    def __init__(self, rows, low, high):
        self.n, self.m = len(low), rows
        self.solver = highspy.Highs()
        self.solver.setOptionValue("output_flag", False)
        for name in ("primal_feasibility_tolerance", "dual_feasibility_tolerance"):
            self.solver.setOptionValue(name, 1e-10)
        self.low, self.high = low, high

    def pose(self, A, held, scale):
        """Pass a pose; forces in units of `scale` [N]."""
        lp, n, m = highspy.HighsLp(), self.n, self.m
        lp.num_col_, lp.num_row_ = n + 1, m
        lp.col_cost_ = np.r_[np.zeros(n), 1.0]
        lp.col_lower_ = np.r_[self.low / scale, 0.0]
        lp.col_upper_ = np.r_[self.high / scale, 1e4]
        lp.row_lower_ = lp.row_upper_ = held / scale
        lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
        lp.a_matrix_.start_ = np.arange(m + 1, dtype=np.int32) * (n + 1)
        lp.a_matrix_.index_ = np.tile(np.arange(n + 1, dtype=np.int32), m)
        lp.a_matrix_.value_ = np.c_[A, np.ones(m)].ravel()
        self.solver.passModel(lp)

    def range(self, vector, scale):
        """Least and largest multiple of a wrench; None where none is given."""
        for row in range(self.m):
            self.solver.changeCoeff(row, self.n, -vector[row] / scale)
        ends = []
        for sense in (highspy.ObjSense.kMinimize, highspy.ObjSense.kMaximize):
            self.solver.changeObjectiveSense(sense)
            self.solver.run()
            status = self.solver.getModelStatus()
            if status == highspy.HighsModelStatus.kInfeasible:
                return None
            assert status == highspy.HighsModelStatus.kOptimal, status
            ends.append(self.solver.getInfo().objective_function_value)
        return ends


def vertices_of(half):
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * len(half))).reshape(len(half), -1).T
    return signs * half


def compare(path, table, poses):
    """Differences between the map's rows and the programmes, at random rows."""
    robot = yaml.safe_load(path.read_text(encoding="utf-8"))
    base, points = np.array(robot["base_points"]), np.array(robot["platform_points"])
    rows = list(ROWS[robot.get("motion", "spatial")])
    low, high = (
        np.broadcast_to(np.array(robot[key], float), len(base))
        for key in ("tension_min", "tension_max")
    )
    weight, centre = (
        GRAVITY * robot.get("mass", 0.0),
        np.array(robot.get("centre_of_mass", [0.0] * 3)),
    )
    vertices = vertices_of(np.array(robot["required_wrench"])[rows])
    # Torques in units of the characteristic length, as HiGHS wants rows of one size.
    units = np.array([1.0] * 3 + [robot["characteristic_length"]] * 3)[rows]
    programmes, scale = Multiples(len(rows), low, high), float(high.max())
    chosen = np.random.default_rng(1).permutation(len(table))[:poses]
    flags = worst = feasible = undecided = 0
    for k in chosen:
        row = table[k]
        position = np.array([row["x_m"], row["y_m"], row["z_m"]])
        angles = [row["rx_deg"], row["ry_deg"], row["rz_deg"]]
        rotation = Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()
        arms = points @ rotation.T
        along = base - position - arms
        along /= np.linalg.norm(along, axis=1)[:, None]
        A = np.r_[along.T, np.cross(arms, along).T][rows] / units[:, None]
        force = np.array([0.0, 0.0, weight])
        held = np.r_[force, np.cross(rotation @ centre, force)][rows] / units
        programmes.pose(A, held, scale)
        least, largest = 0.0, np.inf
        for vertex in vertices / units:
            ends = programmes.range(vertex, scale)
            least, largest = (
                (np.inf, -np.inf) if ends is None else (max(least, ends[0]), min(largest, ends[1]))
            )
            if least > largest:
                break
        fits = least <= 1.0 <= largest
        feasible += fits
        rounding = min(abs(least - 1.0), abs(largest - 1.0), abs(largest - least)) < NEAR
        flags += bool(fits != (row["margin_n"] >= 0.0)) and not rounding
        undecided += rounding
        if rounding:
            continue
        if least <= largest < 1e3:
            # The table has six digits.
            gap = abs(row["factor_high"] - largest) / max(largest, 0.1)
            worst = max(worst, gap if np.isfinite(gap) else np.inf)
        elif least > largest + 1e-9 and not np.isnan(row["factor_high"]):
            worst = np.inf
    return {
        "poses": len(chosen),
        "feasible": int(feasible),
        "undecided_by_rounding": int(undecided),
        "flags_that_differ": int(flags),
        "largest_difference_of_multiple": float(worst),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--poses", type=int, default=500, help="of each robot")
    parser.add_argument("--output", type=Path, default=Path("build/robots"))
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    found = {}
    for path in sorted(ROBOTS.glob("*.yaml")):
        folder = options.output / path.stem
        kept = folder / f"programmes_{options.poses}.json"
        if not kept.exists():
            words = ["map", "--geometry", str(path), *WORDS, "--output", str(folder)]
            if workspace(words) != 0:
                return 1
            table = np.genfromtxt(folder / "workspace.csv", delimiter=",", names=True)
            kept.write_text(json.dumps(compare(path, table, options.poses)), encoding="utf-8")
        found[path.stem] = json.loads(kept.read_text(encoding="utf-8"))
    print(
        f"{'robot':10} poses  feasible  flags that differ  ties  largest difference of a multiple"
    )
    for name, row in found.items():
        print(
            f"{name:10} {row['poses']:5d}  {row['feasible']:8d}  {row['flags_that_differ']:17d}  "
            f"{row['undecided_by_rounding']:4d}  "
            f"{row['largest_difference_of_multiple']:.1e}"
        )
    equal = all(
        row["flags_that_differ"] == 0 and row["largest_difference_of_multiple"] < SAME_PRINTED
        for row in found.values()
    )
    print("equal to the linear programmes" if equal else "NOT equal")
    write_figures(options.output / "robots.json", {"robots": found, "equal": equal})
    return 0 if equal else 1


if __name__ == "__main__":
    sys.exit(main())
