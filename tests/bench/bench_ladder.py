# SPDX-License-Identifier: Apache-2.0
"""Whether each rung's 95 % intervals hold the truth, and how long the ladder takes.

Robots are independent_arm's plain homogeneous matrices, none of the estimator's code. For each
rung a robot that needs it is measured again and again with fresh noise, and the rung is fitted by
name. Counted is how often the stated 95 % intervals hold the truth: of the joints' stiffness, where
the rung leaves it a meaning of its own, and of deflections under loads at other configurations.
Runs that are done are not done again: the command goes on where it was, also with more runs.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from scipy.stats import binom

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from record import write_figures

import independent_arm as arm
from cabols_stiffness import identify
from cabols_stiffness.ladder.identified import identify_ladder
from cabols_stiffness.model.elastic.prediction import predict_elastic

FOLDER = Path("build/bench")
CONFIGURATIONS, LOADS, ELSEWHERE = 12, 6, 10
REACH = 0.15 * np.array([1.3e-4, 2.1e-4, 3e-4, 1.6e-3, 2.9e-3, 4.7e-3])
FRICTION = 0.02 * arm.STIFFNESS * REACH / 0.15


def stiff(matrix):
    """Settling of a robot with a stiffness matrix."""
    return lambda chain, q, w: chain.settle(q, w, matrix)[0]


def coupled():
    """A parallelogram and a wrist that is coupled."""
    motors = np.eye(6)
    motors[2, 1], motors[4, 3], motors[5, 4] = 1.0, 0.2, 0.3
    return motors.T @ np.diag(arm.STIFFNESS) @ motors


def soft(base, links):
    """Settling of a robot whose base or bearings give way."""
    bearings = np.full((7, 6), np.inf)
    if base:
        bearings[0] = [5e7, 5e7, 5e7, 1.5e6, 1.5e6, np.inf]

    def settle(chain, q, w):
        if links:
            for j, stiffness in enumerate(arm.STIFFNESS):
                across = np.abs(chain.joints[j][1]) < 0.5
                bearings[j + 1, 3:][across] = 20.0 * stiffness
        return chain.settle(q, w, bearings=bearings)[0]

    return settle


def varied(chain, q, w):
    """Joints 2 and 5 vary with their own angles."""
    factor = np.r_[1, 1 + 0.15 * np.sin(q[1]), 1, 1, 1 + 0.1 * np.cos(q[4]), 1]
    return chain.settle(q, w, arm.STIFFNESS * factor)[0]


class Dahl:
    """Friction that is drawn exponentially; each configuration begins relaxed."""

    def __init__(self):
        self._state, self._at = np.zeros(6), np.zeros(6)
        self._q = None

    def __call__(self, chain, q, w):
        if self._q is None or (q != self._q).any():
            self._state, self._at, self._q = np.zeros(6), np.zeros(6), q.copy()
        state, deflection = self._state, self._at
        for _ in range(60):
            sign = np.sign(deflection - self._at)
            left = np.exp(-3.0 / REACH * np.abs(deflection - self._at))
            state = sign + (self._state - sign) * left
            pose, new = chain.settle(q, w, friction=FRICTION * state)
            done = np.abs(new - deflection).max() < 1e-12
            deflection = deflection + 0.7 * (new - deflection)
            if done:
                break
        self._state, self._at = state, deflection
        return pose


RUNGS = {
    "joints": (stiff(arm.STIFFNESS), arm.STIFFNESS),
    "coupling": (stiff(coupled()), 1.0 / np.diag(np.linalg.inv(coupled()))),
    "base": (soft(True, False), arm.STIFFNESS),
    "links": (soft(False, True), None),
    "varying": (varied, None),
    "friction": (None, arm.STIFFNESS),
}
"""Robot that needs the rung, and the joints' stiffness; None: it has no value of its own."""


class Bench:
    """Noise-free truth of one rung."""

    def __init__(self, rung):
        self.rung = rung
        settle, self.stiffness = RUNGS[rung]
        chain, random = arm.Chain(), np.random.default_rng(11)
        Q, W = arm.configurations(random, CONFIGURATIONS), arm.loads(random, LOADS)
        fresh = settle or Dahl()
        self.columns = arm.truth(
            Q, W, lambda i, q, w: (fresh(chain, q, w),), down=rung == "friction"
        )
        self.joints, self.wrench = (
            arm.configurations(random, ELSEWHERE),
            arm.loads(random, ELSEWHERE),
        )
        moved = []
        for q, w in zip(self.joints, self.wrench, strict=True):
            there = settle or Dahl()
            start = there(chain, q, np.zeros(6))[:3, 3]
            moved.append(there(chain, q, w)[:3, 3] - start)
        self.moved = np.array(moved)

    def run(self, seed):
        """(stiffness intervals that hold, of how many; deflections that are held, of how many)."""
        samples = arm.noisy(self.columns, np.random.default_rng([seed, 7]))
        name = "joints" if self.rung == "joints" else f"joints+{self.rung}"
        found = identify_ladder(samples, arm.robot(), name)
        holds = shown = 0
        if self.stiffness is not None:
            low, high = found.result.interval.T
            known = found.result.identifiable
            holds = int(((low <= self.stiffness) & (self.stiffness <= high) & known).sum())
            shown = int(known.sum())
        told = predict_elastic(found.elastic, self.joints, self.wrench, follows=True)
        band = 1.96 * np.sqrt(np.einsum("kii->ki", told.covariance))[:, :3]
        inside = np.abs(told.deflection[:, :3] - self.moved) <= band
        return holds, shown, int(inside.sum()), inside.size


def speed():
    """Seconds of the whole ladder by seconds of a linear fit, 180 samples, in turn."""
    chain, random = arm.Chain(), np.random.default_rng(12)
    Q, W = arm.configurations(random, 10), arm.loads(random, 4)
    samples = arm.noisy(arm.truth(Q, W, lambda i, q, w: chain.settle(q, w, coupled())), random)
    robot, ratios = arm.robot(), []
    for _ in range(7):
        began = time.process_time()
        identify(samples, robot, robust=False, hysteresis=False, judged=False)
        middle = time.process_time()
        identify_ladder(samples, robot)
        ratios.append((time.process_time() - middle) / (middle - began))
    return len(samples), float(np.median(ratios))


def line_of(name, hits, of, runs):
    """A printed line and whether the share is within 92 to 98 %, or its binomial band of 99.9 %."""
    if of == 0:
        return f"  {name:24s}      -"
    rate = hits / of
    low, high = binom.ppf([0.0005, 0.9995], runs, 0.95) / runs
    word = "met" if 0.92 <= rate <= 0.98 else "MISSED"
    band = f"{100 * low:.1f} to {100 * high:.1f} %"
    return f"  {name:24s} {100 * rate:6.2f} % of {of:6d}  {word}; {runs} runs at 95 %: {band}"


def main():
    """Run what is not done yet, and print all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=40, help="of each rung; the full form is 1000")
    parser.add_argument("--first", type=int, default=0, help="seed of the first run of each rung")
    parser.add_argument("--rungs", nargs="*", default=list(RUNGS), choices=list(RUNGS))
    options = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    place, figures = FOLDER / "ladder.jsonl", {}
    seeds = range(options.first, options.first + options.runs)
    for rung in options.rungs:
        text = place.read_text(encoding="utf-8") if place.exists() else ""
        done = [json.loads(line) for line in text.splitlines() if line.endswith("}")]
        mine = {row["seed"]: row["counts"] for row in done if row["rung"] == rung}
        bench = None
        with place.open("a", encoding="utf-8") as stream:
            for seed in sorted(set(seeds) - set(mine)):
                bench = bench or Bench(rung)
                mine[seed] = bench.run(seed)
                row = {"rung": rung, "seed": seed, "counts": mine[seed]}
                stream.write(json.dumps(row) + "\n")
                stream.flush()
        counts = [mine[seed] for seed in seeds]
        holds, shown, inside, of = (sum(part) for part in zip(*counts, strict=True))
        print(f"{rung}: {len(counts)} runs")
        print(line_of("stiffness intervals", holds, shown, len(counts)))
        print(line_of("bands of deflections", inside, of, len(counts)), flush=True)
        figures[rung] = {
            "runs": len(counts),
            "stiffness_covered": holds / shown if shown else None,
            "deflection_covered": inside / of,
        }
    size, ratio = speed()
    print(f"whole ladder, {size} samples: {ratio:.1f} of its linear fits (at most 30)")
    write_figures(FOLDER / "ladder.json", {**figures, "ladder_in_linear_fits": ratio})


if __name__ == "__main__":
    main()
