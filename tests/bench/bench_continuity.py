# SPDX-License-Identifier: Apache-2.0
"""Change of tensions from one control cycle to the next, near the boundary of the wrenches.

Usage: python tests/bench/bench_continuity.py [--output build/bench/continuity.json] [--wrenches N]

Constant random wrenches of 0.9 to 1.3 times what the cables can give at the bench's reference pose,
through the compiled entry of the control loop, with a pose that carries a tracker's noise and a
wrench that carries that of a sensor, new in every cycle. Then wrenches that go smoothly out to 1.3
times the boundary and back, on a smooth path of poses, on robots of others: sampled four times as
finely, the largest step must shrink; a jump would stay.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from continuity_node import node_changes
from record import write_figures

from cabols_control.geometry import load_geometry
from cabols_control.kinematics import structure_matrix
from cabols_control.tension import (
    CHOICES,
    DEFAULT_WEIGHTS,
    TensionResolver,
    choose_prepared,
    prepare_pose,
    set_method,
    work_size,
)
from case_robots import load

LOW, HIGH = 1.0, 150.0
NOISE = np.repeat((16e-6, 136e-6), 3)
"""Of the tracker's pose: position [m], rotation [rad]."""
WRENCH_NOISE = np.full(6, 0.01)
"""Of the wrench [N], [N m]; a torque of 0.01 N m is 0.067 N in the metric of the nearest wrench."""
EVEN_NOISE = 0.01 / np.array(DEFAULT_WEIGHTS)
"""0.01 N in that metric, for torque too."""
SHARES = (0.9, 1.3)
CYCLES = 6
MOST_N, USUAL_N, SHARE_USUAL = 5.0, 2.0, 0.999
PUBLIC = (
    "cogiro", "ipanema1", "ipanema2", "caroca", "macarm", "pocaboss", "swin_full", "robocrane",
)  # fmt: skip
COUNTS = (4000, 16000)
SHRINKS = 0.75
"""Share that is left of the largest step at four times as many samples; a jump keeps 1."""


class Loop:
    """The compiled entry of the control loop with a new pose in every cycle, for one method."""

    def __init__(self, geometry, method, low, high):
        n = geometry.cables
        self.geometry, self.method, self.limits = geometry, method, (low, high)
        self.work, self.weights = np.zeros(work_size(n)), np.array(DEFAULT_WEIGHTS)
        self.tension, self.residual = np.zeros(n), np.zeros(6)

    def __call__(self, position, rotation, wrench):
        """(n,) tensions [N]."""
        matrix = structure_matrix(self.geometry, position, rotation)
        prepare_pose(matrix, *self.limits, self.weights, self.work)
        set_method(self.work, self.geometry.cables, self.method)
        choose_prepared(self.work, wrench, self.tension, self.residual)
        return self.tension.copy()


def boundary(geometry, low, high, inside, rng, count):
    """(count, 6) random directions and how far along each from `inside` a wrench is feasible."""
    directions = rng.standard_normal((count, 6)) / DEFAULT_WEIGHTS
    directions /= np.linalg.norm(directions * DEFAULT_WEIGHTS, axis=1)[:, None]
    matrix = structure_matrix(geometry, geometry.reference_position, np.eye(3))
    resolver, ends = TensionResolver(matrix, low, high), []
    for direction in directions:
        near, far = 0.0, float(2.0 * np.sum(high))
        for _ in range(50):
            middle = 0.5 * (near + far)
            if resolver.feasible(inside + middle * direction):
                near = middle
            else:
                far = middle
        ends.append(near)
    return directions, np.array(ends)


def noisy_changes(loop, directions, ends, wrench_noise=WRENCH_NOISE):
    """Largest change of a tension from cycle to cycle [N], over all wrenches."""
    rng, changes = np.random.default_rng(1), []
    at = loop.geometry.reference_position
    for direction, end in zip(directions, ends, strict=True):
        wrench, found = rng.uniform(*SHARES) * end * direction, []
        for offset in rng.normal(0.0, 1.0, (CYCLES, 6)) * NOISE:
            turn = Rotation.from_rotvec(offset[3:]).as_matrix()
            shaken = wrench + rng.normal(0.0, 1.0, 6) * wrench_noise
            found.append(loop(at + offset[:3], turn, shaken))
        changes.append(np.abs(np.diff(found, axis=0)).max(axis=1))
    return np.concatenate(changes)


def largest_step(loop, inside, direction, end, count):
    """Largest step of a tension along a smooth path of poses and wrenches, out and back."""
    s = np.linspace(0.0, 2.0 * np.pi, count)
    points = loop.geometry.base_points
    reach = 0.02 * float(np.ptp(points, axis=0).max())
    offsets = reach * np.column_stack([np.sin(s), np.cos(s) - 1.0, np.sin(2.0 * s)])
    turns = Rotation.from_rotvec(
        0.03 * np.column_stack([np.sin(2.0 * s), np.sin(s), np.cos(s) - 1.0])
    ).as_matrix()
    out = 0.5 * SHARES[1] * (1.0 - np.cos(s))
    found = [
        loop(
            loop.geometry.reference_position + offsets[k],
            turns[k],
            inside + out[k] * end * direction,
        )
        for k in range(count)
    ]
    return float(np.abs(np.diff(found, axis=0)).max())


def bench_figures(count):
    """Figures of the bench's tensions under noise, by method."""
    geometry = load_geometry()
    low, high = np.full(geometry.cables, LOW), np.full(geometry.cables, HIGH)
    directions, ends = boundary(geometry, low, high, np.zeros(6), np.random.default_rng(0), count)
    figures = {}
    print(f"bench, {count} wrenches of {SHARES[0]} to {SHARES[1]} times the boundary, change [N]")
    print(f"{'method':16} {'below 2 N':>10} {'99.9 %':>8} {'largest':>8}")
    for method in CHOICES:
        loop = Loop(geometry, method, low, high)
        changes, even = (
            noisy_changes(loop, directions, ends, noise) for noise in (WRENCH_NOISE, EVEN_NOISE)
        )
        usual = float((changes < USUAL_N).mean())
        largest, tail = float(changes.max()), float(np.quantile(changes, 0.999))
        met = usual >= SHARE_USUAL and largest <= MOST_N
        figures[method] = {
            "share_below_2_n": usual, "p999_n": tail, "largest_n": largest, "met": met,
            "even_share_below_2_n": float((even < USUAL_N).mean()),
            "even_largest_n": float(even.max()),
        }  # fmt: skip
        print(
            f"{method:16} {100.0 * usual:8.3f} % {tail:8.2f} {largest:8.2f}"
            f"  {'met' if met else 'NOT met'}   torque's noise as force at 0.15 m: "
            f"{100.0 * (even < USUAL_N).mean():.3f} %, {even.max():.2f} N"
        )
    return figures


def node_figures(count, methods):
    """Figures of the wrench controller's real node, by method."""
    geometry = load_geometry()
    low, high = np.full(geometry.cables, LOW), np.full(geometry.cables, HIGH)
    directions, ends = boundary(geometry, low, high, np.zeros(6), np.random.default_rng(4), count)
    figures = {}
    print(f"the real node: {count} wrenches, held and ramped from inside to beyond [N]")
    print(f"{'method':16} {'wrench':7} {'below 2 N':>10} {'99.9 %':>8} {'largest':>8}")
    for method in methods:
        changes, ramped, feasible, lost = node_changes(
            geometry, method, directions, ends, NOISE, WRENCH_NOISE
        )
        for name, some in (("held", changes[~ramped]), ("ramped", changes[ramped])):
            usual, largest = float((some < USUAL_N).mean()), float(some.max())
            tail, met = float(np.quantile(some, 0.999)), usual >= SHARE_USUAL and largest <= MOST_N
            figures[f"{method}_{name}"] = {
                "share_below_2_n": usual, "p999_n": tail, "largest_n": largest, "met": met,
                "cycles": some.size, "feasible": feasible, "lost": lost,
            }  # fmt: skip
            print(
                f"{method:16} {name:7} {100.0 * usual:8.3f} % {tail:8.2f} {largest:8.2f}"
                f"  {'met' if met else 'NOT met'}  ({some.size} cycles, {lost} lost)",
                flush=True,
            )
    return figures


def public_figures(count):
    """Figures of smooth paths on robots of others, by robot and method."""
    figures = {}
    print("smooth paths beyond the boundary and back: largest step, share of the largest limit")
    print(f"{'robot':12} {'method':16} " + " ".join(f"{c:>8}" for c in COUNTS) + "   ratio")
    for name in PUBLIC:
        geometry, low, high, weight = load(name)
        directions, ends = boundary(geometry, low, high, weight, np.random.default_rng(2), count)
        for method in CHOICES:
            loop = Loop(geometry, method, low, high)
            steps = [
                max(
                    largest_step(loop, weight, d, e, samples)
                    for d, e in zip(directions, ends, strict=True)
                ) / float(np.max(high))
                for samples in COUNTS
            ]  # fmt: skip
            ratio = steps[1] / steps[0]
            figures[f"{name}_{method}"] = {
                "steps": steps, "ratio": ratio, "met": ratio <= SHRINKS,
            }  # fmt: skip
            print(
                f"{name:12} {method:16} {steps[0]:8.4f} {steps[1]:8.4f} {ratio:7.2f}"
                f"  {'met' if ratio <= SHRINKS else 'NOT met'}"
            )
    return figures


def main() -> int:
    """Measure, print, write; 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/continuity.json"))
    parser.add_argument("--wrenches", type=int, default=2000, help="random wrenches on the bench")
    parser.add_argument("--paths", type=int, default=4, help="smooth paths on each public robot")
    parser.add_argument("--nodes", type=int, default=0, help="only this many through the real node")
    parser.add_argument("--methods", nargs="+", default=list(CHOICES), help="with --nodes")
    options = parser.parse_args()
    if options.nodes:
        figures = {"nodes": node_figures(options.nodes, options.methods)}
    else:
        bench, public = bench_figures(options.wrenches), public_figures(options.paths)
        figures = {"bench": bench, "public": public}
    write_figures(options.output, figures)
    return 0 if all(f["met"] for part in figures.values() for f in part.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
