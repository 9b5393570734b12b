# SPDX-License-Identifier: Apache-2.0
"""Loads that an optimal campaign saves against ten arbitrary configurations and tensions."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from record import write_figures

from cabols_control.kinematics import structure_matrix
from cabols_control.rig import load_rig
from cabols_stiffness import identify
from cabols_stiffness.design import (
    Candidates,
    Information,
    candidate_configurations,
    candidate_loads,
    choose,
    tensions_of,
)
from stiffness_bench import (
    TENSION,
    WRENCH_LIMIT,
    Bench,
    bench_configurations,
    bench_robot,
    bench_setup,
    bench_truth,
    ramps,
    random_peaks,
)

CONFIGURATIONS = 10
POOL = 40
DIRECTIONS = 24
MOST = 60
"""Arbitrary loads at each configuration, at most."""


def arbitrary(robot, seed, draws=MOST):
    """Candidates: ten arbitrary configurations with arbitrary tensions, in random order."""
    rig = load_rig()
    start = bench_configurations()[0]
    joints = candidate_configurations(robot, rig.geometry, start, CONFIGURATIONS, seed=1000 + seed)
    peaks = random_peaks(robot, joints, draws, seed)
    matrices = [structure_matrix(rig.geometry, *robot.forward(q)) for q in joints]
    wrench = [t @ m.T for t, m in zip(peaks, matrices, strict=True)]
    which = np.repeat(np.arange(CONFIGURATIONS), draws)
    return Candidates(joints, which, np.concatenate(peaks), np.concatenate(wrench))


def measures(information):
    """Worst and root mean square relative deviation, and that of the ellipsoid's volume."""
    deviation = np.sqrt(np.diagonal(np.linalg.inv(information)))
    volume = np.exp(-0.5 * np.linalg.slogdet(information)[1] / len(information))
    return np.array([deviation.max(), np.sqrt(np.mean(deviation**2)), volume])


def loads_needed(information, wanted):
    """(3,) arbitrary loads, as many at each configuration, until each measure is reached."""
    needed = np.full(3, np.inf)
    for each in range(1, MOST + 1):
        counts = np.zeros(information.configuration.size)
        for c in range(CONFIGURATIONS):
            counts[np.flatnonzero(information.configuration == c)[:each]] = 1.0
        reached = measures(information.of(counts)) <= wanted
        needed[reached & np.isinf(needed)] = CONFIGURATIONS * each
    return needed


def confirmed(robot, candidates, design, campaigns):
    """Predicted deviations against the scatter of simulated campaigns."""
    peaks = tensions_of(candidates, design, TENSION[0])
    used = [i for i, rows in enumerate(peaks) if len(rows)]
    plan = ramps(candidates.configurations[used], [peaks[i] for i in used], (1.0,))
    bench, truth = Bench(robot, plan), np.array(bench_truth().stiffness)
    register = len(used) > 3
    found = [identify(bench.draw(i, register), robot).stiffness for i in range(campaigns)]
    return (np.std(found, axis=0, ddof=1) / truth).tolist()


def main():
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loads", type=int, default=20)
    parser.add_argument("--arbitrary", type=int, default=10, help="arbitrary campaigns")
    parser.add_argument("--campaigns", type=int, default=30, help="simulated, to confirm")
    arguments = parser.parse_args()
    robot, rig, setup = bench_robot(), load_rig(), bench_setup()
    start = time.perf_counter()
    pool = candidate_configurations(robot, rig.geometry, bench_configurations()[0], POOL, seed=1)
    stored = bench_configurations()[:CONFIGURATIONS]
    cases = {}
    for name, joints in (("any configurations", pool), ("the ten stored", stored)):
        limits = {"tension": TENSION, "wrench_limit": WRENCH_LIMIT}
        found = candidate_loads(robot, rig.geometry, joints, DIRECTIONS, **limits)
        cases[name] = found, Information(setup, found)
    others = [Information(setup, arbitrary(robot, seed)) for seed in range(arguments.arbitrary)]
    each = -(-arguments.loads // CONFIGURATIONS)
    print(
        f"{arguments.loads} optimal loads, and the arbitrary ones (at {CONFIGURATIONS} "
        f"configurations, median of {arguments.arbitrary} campaigns) for the same accuracy"
    )
    print(
        "design                             worst joint          rms           volume    exchanges"
    )
    rows, worst_ratio = [], np.inf
    for name, most, criterion in (
        ("any configurations", None, "D"), ("any configurations", None, "A"),
        ("any configurations", each, "D"), ("any configurations", each, "A"),
        ("the ten stored", each, "D"), ("the ten stored", each, "A"),
    ):  # fmt: skip
        candidates, information = cases[name]
        design = choose(information, arguments.loads, CONFIGURATIONS, criterion, most)
        wanted = measures(design.information)
        needed = np.median([loads_needed(other, wanted) for other in others], axis=0)
        ratio = needed / arguments.loads
        worst_ratio = min(worst_ratio, float(ratio.min()))
        count = int(np.unique(candidates.configuration[design.chosen]).size)
        label = f"{criterion}, {name} ({count} used)"
        cells = "   ".join(
            f"{100 * w:5.3f} % {n:4.0f}" for w, n in zip(wanted, needed, strict=True)
        )
        print(f"{label:33s}{cells}   {design.exchanges}")
        rows.append({
            "criterion": criterion, "candidates": name, "configurations": count,
            "loads": arguments.loads, "deviation_relative": design.deviation.tolist(),
            "arbitrary_loads_needed": [float(n) if np.isfinite(n) else None for n in needed],
        })  # fmt: skip
        if name == "the ten stored" and criterion == "D":
            scatter = confirmed(robot, candidates, design, arguments.campaigns)
            rows[-1]["scatter_relative"] = scatter
    stated = next(row for row in rows if "scatter_relative" in row)
    print("\nD, the ten stored: predicted deviation and scatter of simulated campaigns, %")
    for key in ("deviation_relative", "scatter_relative"):
        print("  " + " ".join(f"{100 * v:7.3f}" for v in stated[key]))
    met = worst_ratio >= 2.0
    print(f"\narbitrary loads for one optimal load, least of all: {worst_ratio:.1f}, target 2: "
          f"{'met' if met else 'NOT MET'} ({time.perf_counter() - start:.0f} s)")  # fmt: skip
    report = {"designs": rows, "least_ratio": worst_ratio, "met": bool(met)}
    write_figures(Path("build/bench/design.json"), report)


if __name__ == "__main__":
    main()
