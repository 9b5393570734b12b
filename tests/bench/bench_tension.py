# SPDX-License-Identifier: Apache-2.0
"""How fast redundancy resolution is, beside DAQP and scipy, on the reference rig.

Usage: python tests/bench/bench_tension.py [--output build/bench/tension.json] [--calls 20000]

Single calls are taken in turn in one run, in blocks of BLOCK (ours, DAQP, ours infeasible, ...):
whatever else the machine does hits all alike, and each runs with warm caches as in a loop of its
own. Every call is timed by itself. DAQP's arrays are filled outside its timed part.
"""

from __future__ import annotations

import argparse
import gc
import platform
import time
from collections.abc import Callable
from pathlib import Path

import daqp
import numpy as np
from record import write_figures
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from cabols_control.cable_kernels import cable_records, structure_matrix_into
from cabols_control.tension import (
    DEFAULT_WEIGHTS,
    RigTensionResolver,
    TensionResolver,
    distribute,
)

LOW, HIGH, N = 1.0, 150.0, 8
CENTRE = np.array([0.0, 1.234615, 0.792718])
BOX = np.array([94.0, 94.0, 94.0, 9.4, 9.4, 9.4])
INFEASIBLE_SCALE = 2.0
BATCH = 100_000
BLOCK = 50
SENSE = np.concatenate([np.zeros(N, np.int32), np.full(6, 5, np.int32)])
EYE, ZERO = np.eye(N), np.zeros(N)
Call = Callable[[int], object]


def reference_points():
    """Reference geometry: frame 1.8 x 1.6 x 1.6 m, platform radius 0.15 m."""
    base, points = [], []
    for level, swirl in ((1.0, (1, -1, 1, -1)), (-1.0, (-1, 1, -1, 1))):
        for corner, s in zip((45.0, 135.0, 225.0, 315.0), swirl, strict=True):
            side = np.sign([np.cos(np.deg2rad(corner)), np.sin(np.deg2rad(corner))])
            angle = np.deg2rad(corner + 45.0 * s)
            base.append([0.9 * side[0], 0.8 * side[1], 0.8 * level])
            points.append([0.15 * np.cos(angle), 0.15 * np.sin(angle), -0.10 * level])
    return np.array(base) + CENTRE, np.array(points)


class Inputs:
    """Random wrenches and poses: feasible ones, and ones from twice the box that are not."""

    def __init__(self, count: int) -> None:
        rng = np.random.default_rng(20)
        self.base, self.points = reference_points()
        self.A = self.matrix(CENTRE, np.eye(3))
        self.positions = CENTRE + rng.uniform(-0.1, 0.1, (count, 3))
        turns = rng.uniform(-10.0, 10.0, (count, 3))
        self.rotations = Rotation.from_euler("xyz", turns, degrees=True).as_matrix()
        self.wrenches = rng.uniform(-1.0, 1.0, (count, 6)) * BOX
        resolver = TensionResolver(self.A, LOW, HIGH)
        draws = rng.uniform(-1.0, 1.0, (4 * count, 6)) * BOX * INFEASIBLE_SCALE
        self.outside = draws[resolver.solve_batch(draws)[1] == 1][:count]
        self.outside = np.ascontiguousarray(np.resize(self.outside, (count, 6)))
        self.matrices = np.array(
            [self.matrix(p, r) for p, r in zip(self.positions, self.rotations, strict=True)]
        )
        filler = np.ones((count, N))
        self.upper = np.hstack([HIGH * filler, self.wrenches])
        self.lower = np.hstack([LOW * filler, self.wrenches])

    def matrix(self, position, rotation):
        A = np.empty((6, N))
        structure_matrix_into(cable_records(self.base, self.points), position, rotation, A)
        return A


def daqp_checked(A, wrench):
    """`daqp.solve` as who checks would call it: shapes, finite numbers, order of the limits."""
    matrix = np.ascontiguousarray(A, dtype=np.float64)
    target = np.ascontiguousarray(wrench, dtype=np.float64)
    if matrix.shape != (6, N) or target.shape != (6,):
        raise ValueError("expected (6, n) and (6,)")
    if not (np.isfinite(matrix).all() and np.isfinite(target).all() and LOW <= HIGH):
        raise ValueError("expected finite numbers, limits in order")
    upper, lower = np.empty(N + 6), np.empty(N + 6)
    upper[:N], lower[:N] = HIGH, LOW
    upper[N:] = lower[N:] = target
    tension, _, status, _ = daqp.solve(EYE, ZERO, matrix, upper, lower, SENSE)
    return tension, status == 1, matrix @ tension - target


def time_calls(calls: dict[str, Call], count: int) -> dict[str, np.ndarray]:
    """Nanoseconds of every call, the calls taken in turn."""
    clock, taken = time.perf_counter_ns, {name: np.empty(count) for name in calls}
    for i in range(200):
        for call in calls.values():
            call(i)
    gc.disable()
    for first in range(0, count, BLOCK):
        for name, call in calls.items():
            for i in range(first, min(first + BLOCK, count)):
                start = clock()
                call(i)
                taken[name][i] = clock() - start
    gc.enable()
    return taken


def single_calls(inputs: Inputs, count: int) -> dict[str, np.ndarray]:
    """Times of single calls from Python."""
    fixed = TensionResolver(inputs.A, LOW, HIGH)
    moving = RigTensionResolver(inputs.base, inputs.points, LOW, HIGH)
    model = daqp.Model()
    model.setup(EYE, ZERO, inputs.A, inputs.upper[0], inputs.lower[0], SENSE)
    upper, lower = list(inputs.upper), list(inputs.lower)
    inside, outside = list(inputs.wrenches), list(inputs.outside)
    positions, rotations = list(inputs.positions), list(inputs.rotations)
    matrices = list(inputs.matrices)

    tension = np.empty(N)

    def daqp_warm(i: int) -> object:
        model.update(bupper=upper[i], blower=lower[i])
        return model.solve()

    return time_calls(
        {
            "fixed_into": lambda i: fixed.solve_into(inside[i], tension),
            "fixed_feasible": lambda i: fixed.solve(inside[i]),
            "daqp_warm": daqp_warm,
            "fixed_infeasible": lambda i: fixed.solve(outside[i]),
            "detect_feasible": lambda i: fixed.feasible(inside[i]),
            "detect_infeasible": lambda i: fixed.feasible(outside[i]),
            "pose_into": lambda i: moving.solve_into(
                positions[i], rotations[i], inside[i], tension
            ),
            "pose_feasible": lambda i: moving.solve(positions[i], rotations[i], inside[i]),
            "daqp_cold": lambda i: daqp.solve(EYE, ZERO, matrices[i], upper[i], lower[i], SENSE),
            "distribute": lambda i: distribute(matrices[i], inside[i], LOW, HIGH),
            "daqp_checked": lambda i: daqp_checked(matrices[i], inside[i]),
            "pose_infeasible": lambda i: moving.solve(positions[i], rotations[i], outside[i]),
            "nothing": lambda i: None,
        },
        count,
    )


def nearest_calls(inputs: Inputs, count: int) -> dict[str, np.ndarray]:
    """Times of the nearest feasible wrench beside scipy's lsq_linear."""
    fixed, weights = TensionResolver(inputs.A, LOW, HIGH), np.array(DEFAULT_WEIGHTS)
    matrix, targets = weights[:, None] * inputs.A, weights * inputs.outside
    return time_calls(
        {
            "nearest": lambda i: fixed.solve(inputs.outside[i]),
            "lsq_linear": lambda i: lsq_linear(matrix, targets[i], (LOW, HIGH), method="bvls"),
        },
        count,
    )


def best_of(repeats: int, call: Callable[[], object]) -> float:
    """Least seconds of a few runs."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def batches(inputs: Inputs, loop_calls: int) -> dict[str, float]:
    """Seconds per wrench in batches of 100 000, and of loops over DAQP."""
    repeat = -(-BATCH // len(inputs.wrenches))
    tile = [
        np.tile(a, (repeat,) + (1,) * (a.ndim - 1))[:BATCH]
        for a in (inputs.wrenches, inputs.positions, inputs.rotations, inputs.outside)
    ]
    wrenches, positions, rotations, outside = tile
    fixed = TensionResolver(inputs.A, LOW, HIGH)
    moving = RigTensionResolver(inputs.base, inputs.points, LOW, HIGH)
    model = daqp.Model()
    model.setup(EYE, ZERO, inputs.A, inputs.upper[0], inputs.lower[0], SENSE)

    def warm_loop() -> None:
        for i in range(loop_calls):
            model.update(bupper=inputs.upper[i], blower=inputs.lower[i])
            model.solve()

    def cold_loop() -> None:
        for i in range(loop_calls):
            upper, lower = inputs.upper[i], inputs.lower[i]
            daqp.solve(EYE, ZERO, inputs.matrices[i], upper, lower, SENSE)

    out = (np.empty((BATCH, N)), np.empty(BATCH, dtype=np.int64))
    places = (positions, rotations, wrenches, out)
    return {  # least of a few runs each: a batch is long enough to be interrupted
        "fixed": best_of(5, lambda: fixed.solve_batch(wrenches, out)) / BATCH,
        "fixed_infeasible": best_of(3, lambda: fixed.solve_batch(outside, out)) / BATCH,
        "poses": best_of(5, lambda: moving.solve_batch(*places)) / BATCH,
        "daqp_warm_loop": best_of(5, warm_loop) / loop_calls,
        "daqp_cold_loop": best_of(5, cold_loop) / loop_calls,
    }


def target(name: str, value: float, limit: float, *, least: bool) -> dict[str, object]:
    """One target: a ratio beside its limit."""
    met = value >= limit if least else value <= limit
    return {"name": name, "ratio": value, "limit": limit, "least": least, "met": bool(met)}


def judge(
    singles: dict[str, np.ndarray], nearest: dict[str, np.ndarray], batch: dict[str, float]
) -> list[dict[str, object]]:
    """Ratios beside their targets."""
    middle = {k: float(np.median(v)) for k, v in {**singles, **nearest}.items()}
    tail = {k: float(np.percentile(v, 99)) for k, v in {**singles, **nearest}.items()}
    rows = []
    for label, figure in (("median", middle), ("p99", tail)):
        rows += [
            (f"fixed pose vs warm daqp.Model, {label}", "daqp_warm", "fixed_into", 4.0, True),
            (f"the same, new arrays each call, {label}", "daqp_warm", "fixed_feasible", 4.0, True),
            (f"new pose vs daqp.solve, {label}", "daqp_cold", "pose_into", 3.5, True),
            (f"the same, new arrays each call, {label}", "daqp_cold", "pose_feasible", 3.5, True),
            (
                f"distribute vs daqp.solve and checks, {label}",
                "daqp_checked",
                "distribute",
                2.5,
                True,
            ),
            (f"distribute vs daqp.solve alone, {label}", "daqp_cold", "distribute", 2.5, True),
        ]
        if label == "median":
            rows += [
                (
                    "infeasible vs feasible, detection",
                    "detect_infeasible",
                    "detect_feasible",
                    1.2,
                    False,
                ),
                (
                    "infeasible vs feasible, with nearest wrench",
                    "fixed_infeasible",
                    "fixed_feasible",
                    1.2,
                    False,
                ),
                (
                    "infeasible vs feasible, new pose",
                    "pose_infeasible",
                    "pose_feasible",
                    1.2,
                    False,
                ),
                ("nearest wrench vs lsq_linear", "lsq_linear", "nearest", 20.0, True),
            ]
        for name, top, bottom, limit, least in rows:
            yield target(name, figure[top] / figure[bottom], limit, least=least)
        rows = []
    fixed, poses = batch["fixed"], batch["poses"]
    yield target("batch, fixed pose, vs loop", batch["daqp_warm_loop"] / fixed, 30.0, least=True)
    yield target("batch, new poses, vs loop", batch["daqp_cold_loop"] / poses, 10.0, least=True)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/tension.json"))
    parser.add_argument("--calls", type=int, default=20_000)
    options = parser.parse_args()
    inputs = Inputs(max(options.calls, 5000))
    loop_calls = 5000
    singles = single_calls(inputs, options.calls)
    nearest = nearest_calls(inputs, min(options.calls, 1000))
    batch = batches(inputs, loop_calls)
    figures: dict[str, float] = {}
    for name, taken in {**singles, **nearest}.items():
        figures[f"{name}_median_us"] = float(np.median(taken)) / 1e3
        figures[f"{name}_p99_us"] = float(np.percentile(taken, 99)) / 1e3
        print(
            f"{name:20s} median {np.median(taken) / 1e3:9.3f} us   "
            f"p99 {np.percentile(taken, 99) / 1e3:9.3f} us"
        )
    for name, seconds in batch.items():
        figures[f"batch_{name}_us"] = seconds * 1e6
        print(f"batch {name:18s} {seconds * 1e6:9.3f} us each")
    targets = list(judge(singles, nearest, batch))
    for row in targets:
        sign = ">=" if row["least"] else "<="
        print(
            f"{row['name']:46s} {row['ratio']:8.2f} {sign} {row['limit']:5.1f}  "
            f"{'met' if row['met'] else 'NOT MET'}"
        )
    result = {
        "machine": f"{platform.machine()}, Python {platform.python_version()}",
        "calls": options.calls,
        "block": BLOCK,
        "batch_size": BATCH,
        "batch_note": f"DAQP loops extrapolated from {loop_calls} calls",
        "infeasible_note": f"random wrenches from {INFEASIBLE_SCALE:g} times the feasible box",
        "figures": figures,
        "targets": targets,
    }
    write_figures(options.output, result)


if __name__ == "__main__":
    main()
