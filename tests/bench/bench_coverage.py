# SPDX-License-Identifier: Apache-2.0
"""Whether 95 % intervals hold the truth: whole, partial, and of configurations that differ.

Every run draws configurations, loads and noise anew; the loaded robot is a product of homogeneous
matrices (tests/harness/stiffness_lab.py), none of the estimator's code. A run that is stopped goes
on where it was; figures are of all runs in build/bench/coverage.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

import numpy as np
from record import write_figures
from scipy.stats import binom

import independent_arm as arm
import stiffness_lab as lab
from cabols_stiffness import identify
from cabols_stiffness.table.laboratory import Stated, to_samples
from cabols_stiffness.table.reading import Table
from line_journal import LineJournal

FOLDER = Path("build/bench/coverage")
BAND = (0.92, 0.98)
LEAST = 0.90
"""Of configurations that differ."""
CERTAIN = 0.999
POINTS = lab.Design(configurations=8, loads=6, size=1.0, spread=0.9)
REFLECTOR = np.array([0.08, 0.05, 0.02])
ANCHOR = np.array([0.9, -0.6, 0.1])


def points(rng):
    """Three reflectors."""
    return lab.measure(POINTS, rng)


def poses(rng):
    """Positions and rotations."""
    return lab.measure(replace(POINTS, reflectors=0, configurations=6), rng)


def positions(rng):
    """Positions of the tool without rotations: NaN."""
    samples, robot, true = lab.measure(
        replace(POINTS, reflectors=0, robot="ur10", configurations=10), rng
    )
    deflection = samples.deflection.copy()
    deflection[:, 3:] = np.nan
    return replace(samples, deflection=deflection), robot, true


def one_axis(rng):
    """One coordinate of one reflector: the others' deviations are stated as boundless."""
    samples, robot, true = lab.measure(replace(POINTS, reflectors=1, configurations=15), rng)
    covariance = samples.position_covariance.copy()
    covariance[:, 0, 0] = covariance[:, 2, 2] = 1e6
    return replace(samples, position_covariance=covariance), robot, true


def distances(rng):
    """A ball bar: the change of one length for each load."""
    body, robot, stiffness = lab.robot_of("iiwa")
    force, torque = lab.FORCE["iiwa"]
    count, loads, sigma = 30, 6, 5e-6
    q = np.repeat(rng.uniform(-1.2, 1.2, (count, body.n)), loads, axis=0)
    wrench = np.tile(arm.loads(rng, loads, force, torque), (count, 1))
    lengths = []
    for pose in (body.poses(q)[0], body.settle(q, wrench, stiffness, follows=False)):
        seen = pose[:, :3, :3] @ REFLECTOR + pose[:, :3, 3]
        lengths.append(np.linalg.norm(seen - ANCHOR, axis=1))
    change = lengths[1] - lengths[0] + sigma * rng.normal(size=len(q))
    noise = rng.normal(size=wrench.shape) * ([0.2] * 3 + [0.02] * 3)
    columns = {"distance": change, "configuration": np.repeat(np.arange(count), loads) * 1.0}
    table = Table(columns, q, wrench + noise, (), ())
    stated = Stated(
        position_m=sigma, force_n=0.2, torque_nm=0.02, reflector=tuple(REFLECTOR),
        anchor=tuple(ANCHOR),
    )  # fmt: skip
    first = identify(to_samples(table, robot, stated), robot, judged=False)
    return to_samples(table, robot, stated, first), robot, stiffness[None]


def heterogeneous(rng):
    """Stiffness that scatters by 10 % from configuration to configuration; ten of them."""
    return lab.measure(replace(POINTS, configurations=10, loads=5, scatter=0.10), rng)


def scattered_poses(rng):
    """Likewise by 20 %, whole poses, twelve configurations."""
    return lab.measure(replace(POINTS, configurations=12, loads=5, reflectors=0, scatter=0.20), rng)


CASES = {
    "three reflectors": points,
    "whole poses": poses,
    "positions only": positions,
    "one axis": one_axis,
    "distances": distances,
    "configurations differ by 10 %": heterogeneous,
    "configurations differ by 20 %, poses": scattered_poses,
}
DIFFER = frozenset(name for name in CASES if "differ" in name)


def run(journal, name, seed):
    """One identification."""
    rng = np.random.default_rng([seed, list(CASES).index(name)])
    samples, robot, _ = CASES[name](rng)
    result = identify(samples, robot, judged=name in DIFFER)
    # The stiffness of a robot whose configurations scatter is that of the mean they scatter about.
    pooled = lab.robot_of("iiwa")[2] if name == "distances" else None
    if pooled is None:
        pooled = lab.robot_of("ur10" if name == "positions only" else "irb1600")[2]
    low, high = result.interval.T
    inside = (low <= pooled) & (pooled <= high)
    usable = result.identifiable & (result.adequate or name not in DIFFER)
    journal.add(seed, inside=inside.tolist(), shown=usable.tolist(), rms=result.residual_rms)


def summary(journals):
    """Print a row for each case; return figures and whether all claims hold."""
    print(f"{'case':40s}{'runs':>6s}{'shown':>9s}  covered, pooled and by joint [%]")
    figures, right = {}, True
    for name, journal in journals.items():
        if not journal.found:
            continue
        entries = list(journal.found.values())
        inside, shown = (np.array([one[key] for one in entries]) for key in ("inside", "shown"))
        hits, total = int((inside & shown).sum()), int(shown.sum())
        share = hits / max(total, 1)
        each = (inside & shown).sum(axis=0) / np.maximum(shown.sum(axis=0), 1)
        low = LEAST if name in DIFFER else BAND[0]
        high = 1.0 if name in DIFFER else BAND[1]
        runs, tail = len(entries), 0.5 * (1.0 - CERTAIN)
        reach = (binom.ppf(tail, total, low) / total, binom.isf(tail, total, high) / total)
        held = low <= share <= high if runs >= 1000 else reach[0] <= share <= reach[1]
        right &= bool(held)
        joints = " ".join(f"{100 * one:.1f}" for one in each)
        print(f"{name:40s}{runs:6d}{100 * shown.mean():7.1f} %  {100 * share:5.1f}   {joints}   "
              f"{'holds' if held else 'DOES NOT HOLD'}: {100 * low:.0f} to {100 * high:.0f}"
              + ("" if runs >= 1000 else f", with {runs} runs {100 * reach[0]:.1f} to "
                 f"{100 * reach[1]:.1f}"))  # fmt: skip
        figures[name] = {
            "runs": runs,
            "covered": share,
            "by_joint": each.tolist(),
            "holds": bool(held),
        }
    return figures, right


def main():
    """Run the bench; 1 if an interval covers too seldom or too often."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1000, help="of each case, in all")
    parser.add_argument("--short", action="store_true", help="100 runs: about five minutes")
    parser.add_argument("--minutes", type=float, default=1e9, help="stop then, with the figures")
    parser.add_argument("--fresh", action="store_true", help="forget earlier runs")
    options = parser.parse_args()
    runs = 100 if options.short else options.runs
    journals = {
        name: LineJournal(FOLDER / f"{index}.jsonl", options.fresh)
        for index, name in enumerate(CASES)
    }
    began = time.monotonic()
    for seed in range(runs):
        if time.monotonic() - began > 60.0 * options.minutes:
            break
        for name, journal in journals.items():
            if seed not in journal.found:
                run(journal, name, seed)
        if (seed + 1) % 25 == 0:
            print(f"  {seed + 1} of {runs} runs", file=sys.stderr, flush=True)
    figures, right = summary(journals)
    write_figures(Path("build/bench/coverage.json"), figures)
    return int(not right)


if __name__ == "__main__":
    sys.exit(main())
