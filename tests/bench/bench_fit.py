# SPDX-License-Identifier: Apache-2.0
"""Speed of the fit against scipy.optimize.least_squares, and time and memory of large tables.

The yardstick minimises the same residual: both solve the loaded arm's balance exactly, weight it
by covariances and take out the same offsets. It gets the same start and its scale. Both run in turn
in one process, and its processor time counts, so that what the machine does besides hits both.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

import numpy as np
from record import write_figures
from scipy.optimize import least_squares

import stiffness_lab as lab
from cabols_stiffness import identify
from cabols_stiffness.identification.observations import (
    Observations,
    start_stiffness,
    whiten,
)
from cabols_stiffness.model.balance import Law

TARGET = 8.0
MEMORY = 1 << 30
SIZES = (1_000, 10_000, 100_000)


def samples_of(count, seed=0):
    """About `count` samples of points, three reflectors, 12 configurations or more."""
    design = lab.Design(configurations=12, loads=3)
    if count > 200:
        design = lab.Design(configurations=count // 50, loads=15)
    return lab.measure(design, np.random.default_rng(seed))


def residual_of(samples, robot):
    """Whitened residual (numbers,) by compliances relative to the start; start (n,)."""
    observations = Observations(samples, robot)
    begin = 1.0 / start_stiffness(observations)
    weights, nothing = np.ones(len(samples)), np.zeros(robot.n)
    # The weights are those of the start, as a user of least_squares would fix them.
    first = observations.linearise(Law(1.0 / begin, nothing))
    covariance = first.covariance

    def residual(relative):
        line = observations.linearise(Law(1.0 / (begin * relative), nothing))
        fixed = type(line)(line.residual, line.motion, covariance, line.balance, line.partial)
        return whiten(fixed, line.motion[..., :0], samples, weights).residual.ravel()

    return residual, begin


def compare(rounds):
    """Median times of identify and of least_squares on 180 samples, in turn."""
    samples, robot, _ = samples_of(180)
    ours, judged, theirs, same = [], [], [], []
    for _ in range(rounds):
        start = time.process_time()
        found = identify(samples, robot, judged=False)
        ours.append(time.process_time() - start)
        start = time.process_time()
        identify(samples, robot)
        judged.append(time.process_time() - start)
        start = time.process_time()
        residual, begin = residual_of(samples, robot)
        other = least_squares(residual, np.ones(robot.n), xtol=1e-10, ftol=1e-12, gtol=1e-10)
        theirs.append(time.process_time() - start)
        same.append(float(np.abs(1.0 / (begin * other.x) / found.stiffness - 1.0).max()))
    ratios = [b / a for a, b in zip(ours, theirs, strict=True)]
    figures = {
        "samples": len(samples),
        "rounds": rounds,
        "identify_median_s": statistics.median(ours),
        "identify_with_verdict_median_s": statistics.median(judged),
        "least_squares_median_s": statistics.median(theirs),
        "least_squares_evaluations": int(other.nfev),
        "ratio_median": statistics.median(ratios),
        "largest_difference_relative": max(same),
    }
    print(f"{len(samples)} samples, linear model, {rounds} rounds in turn:")
    print(f"  identify                 {1e3 * figures['identify_median_s']:8.1f} ms "
          f"(with verdict {1e3 * figures['identify_with_verdict_median_s']:.1f} ms)")  # fmt: skip
    print(f"  scipy least_squares      {1e3 * figures['least_squares_median_s']:8.1f} ms, "
          f"{figures['ratio_median']:.1f} times as long (at least {TARGET:.0f}); "
          f"largest difference {figures['largest_difference_relative']:.1e}")  # fmt: skip
    return figures


def large(count):
    """One process: time of an identification with its verdict, and its memory."""
    samples, robot, _ = samples_of(count)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.process_time()
    result = identify(samples, robot, judged=False)
    bare = time.process_time() - start
    start = time.process_time()
    judged = identify(samples, robot)
    print(json.dumps({
        "samples": len(samples),
        "process_s": bare,
        "process_with_verdict_s": time.process_time() - start,
        "memory_before_bytes": 1024 * before,
        "memory_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "converged": bool(result.converged),
        "grade": judged.verdict.grade.value,
    }))  # fmt: skip


def main():
    """Run the bench; 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--large", type=int, help="of one process, for its memory")
    options = parser.parse_args()
    if options.large:
        large(options.large)
        return 0
    figures = compare(options.rounds)
    tables = []
    print(f"{'samples':>10s}{'fit':>12s}{'with verdict':>14s}{'us a sample':>13s}{'memory':>12s}")
    for size in SIZES:
        command = [sys.executable, __file__, "--large", str(size)]
        text = subprocess.run(command, check=True, capture_output=True, text=True, env=os.environ)
        one = json.loads(text.stdout)
        tables.append(one)
        fit, judged = one["process_s"], one["process_with_verdict_s"]
        print(f"{one['samples']:10d}{fit:10.2f} s{judged:12.2f} s"
              f"{1e6 * judged / one['samples']:13.0f}"
              f"{one['memory_bytes'] / (1 << 20):8.0f} MiB")  # fmt: skip
    each = [one["process_with_verdict_s"] / one["samples"] for one in tables]
    met = {
        "speed": figures["ratio_median"] >= TARGET,
        "memory": tables[-1]["memory_bytes"] <= MEMORY,
        "linear": each[-1] <= 1.5 * each[-2],
    }
    for what, held in met.items():
        print(f"  {what}: {'met' if held else 'NOT MET'}")
    write_figures(Path("build/bench/fit.json"), {**figures, "large": tables, "met": met})
    return int(not all(met.values()))


if __name__ == "__main__":
    sys.exit(main())
