# SPDX-License-Identifier: Apache-2.0
"""Methods of tension distribution in one run: time, equilibrium, limits, continuity.

Usage: python tests/bench/bench_methods.py [--output build/bench/methods.json] [--calls 20000]

Calls are timed one by one, in blocks taken in turn, as in bench_tension.py, so that whatever else
the machine does hits all alike. Every method goes through the same compiled entry, that of the
controller's loop. Continuity: largest change of a tension between neighbours on a loop through
the workspace (tension_path.py), sampled finer and finer: it must shrink with the samples'
distance; a jump would stay. Leaves a figure beside the figures' file.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from bench_tension import time_calls
from record import write_figures

from cabols_control.geometry import load_geometry
from cabols_control.kinematics import structure_matrix
from cabols_control.tension import (
    CHOICES,
    DEFAULT_WEIGHTS,
    choose_prepared,
    prepare_pose,
    set_method,
    work_size,
)
from tension_path import BOX, largest_jump, tensions_along

LOW, HIGH = 1.0, 150.0
OFFSET_M, TURN_DEG = np.array([0.03, -0.05, 0.02]), [4.0, -6.0, 5.0]
"""Off the reference pose, whose symmetry makes polygons simple and branches predictable."""
LOAD = 0.6
"""Share of the bench's rated box of wrenches that the timed wrenches come from."""
COUNTS = (1001, 4001, 16001)
EQUILIBRIUM_N = 1e-9


def prepared_works(matrix):
    """A work array for each method at one pose."""
    works = {}
    for method in CHOICES:
        works[method] = np.zeros(work_size(8))
        limits = (np.full(8, LOW), np.full(8, HIGH))
        prepare_pose(matrix, *limits, np.array(DEFAULT_WEIGHTS), works[method])
        set_method(works[method], 8, method)
    return works


def timing(matrix, wrenches, calls):
    """Nanoseconds of every call, by method."""
    tension, residual = np.zeros(8), np.zeros(6)
    rows = list(wrenches)
    return time_calls(
        {
            method: lambda i, work=work: choose_prepared(work, rows[i], tension, residual)
            for method, work in prepared_works(matrix).items()
        },
        calls,
    )


def answers(matrix, wrenches, method):
    """Worst equilibrium error, limits kept, least distance to a limit (median)."""
    work = prepared_works(matrix)[method]
    tension, residual = np.zeros(8), np.zeros(6)
    worst, inside, slack = 0.0, True, []
    for wrench in wrenches:
        if choose_prepared(work, wrench, tension, residual) == 0:
            worst = max(worst, float(np.abs(matrix @ tension - wrench).max()))
        inside = inside and bool(((tension >= LOW) & (tension <= HIGH)).all())
        slack.append(min((tension - LOW).min(), (HIGH - tension).min()))
    return worst, inside, float(np.median(slack))


def draw(geometry, path):
    """Tensions of all cables along the loop, a panel for each method."""
    figure = Figure(figsize=(9.0, 6.2), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    share = np.linspace(0.0, 1.0, COUNTS[0])
    for axes, method in zip(panels.ravel(), CHOICES, strict=True):
        tensions, _ = tensions_along(geometry, method, COUNTS[0], LOW, HIGH)
        axes.plot(share, tensions, linewidth=1.1)
        for limit in (LOW, HIGH):
            axes.axhline(limit, color="#b2182b", linewidth=1.2, linestyle="--")
        jump = largest_jump(tensions)
        axes.set_title(f"{method}: largest step {jump:.2f} N", fontsize=10)
        axes.grid(visible=True, color="#dddddd", linewidth=0.7)
    for axes in panels[1]:
        axes.set_xlabel("share of the loop [-]")
    for axes in panels[:, 0]:
        axes.set_ylabel("cable tension [N]")
    figure.suptitle("The same wrenches along one loop (dashed: limits)", fontsize=11)
    figure.savefig(path, dpi=80)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/methods.json"))
    parser.add_argument("--calls", type=int, default=20_000)
    options = parser.parse_args()
    geometry = load_geometry()
    turn = Rotation.from_euler("XYZ", TURN_DEG, degrees=True).as_matrix()
    matrix = structure_matrix(geometry, geometry.reference_position + OFFSET_M, turn)
    rng = np.random.default_rng(6)
    wrenches = rng.uniform(-LOAD, LOAD, (max(options.calls, 200), 6)) * BOX
    taken = timing(matrix, wrenches, options.calls)
    base = float(np.median(taken["min_norm"]))
    figures = {}
    head = f"{'':16} median us  ratio   p99 us  equilibrium N  least slack N   largest step N"
    print(head + f" at {COUNTS} samples")
    for method, times in taken.items():
        worst, inside, slack = answers(matrix, wrenches[:5000], method)
        jumps = []
        for count in COUNTS:
            tensions, error = tensions_along(geometry, method, count, LOW, HIGH)
            worst = max(worst, error)
            inside = inside and bool(((tensions >= LOW) & (tensions <= HIGH)).all())
            jumps.append(largest_jump(tensions))
        median, tail = float(np.median(times)), float(np.percentile(times, 99))
        figures[method] = {
            "median_us": median / 1e3,
            "p99_us": tail / 1e3,
            "ratio_to_min_norm": median / base,
            "equilibrium_error_n": worst,
            "limits_kept": inside,
            "least_slack_median_n": slack,
            "largest_steps_n": jumps,
            "step_ratio": jumps[-1] / jumps[-2],
            "met": bool(worst <= EQUILIBRIUM_N and inside and jumps[-1] <= 0.35 * jumps[-2]),
        }
        print(
            f"{method:16} {median / 1e3:9.2f} {median / base:6.1f} {tail / 1e3:8.2f} "
            f"{worst:14.1e} {slack:14.2f}   "
            + " ".join(f"{jump:8.4f}" for jump in jumps)
            + f"  {'met' if figures[method]['met'] else 'NOT met'}"
        )
    print(
        f"met: equilibrium to {EQUILIBRIUM_N:g} N, limits kept, and four times as many samples "
        "give steps at most 0.35 times as large (a jump would stay)"
    )
    write_figures(options.output, figures)
    draw(geometry, options.output.with_suffix(".png"))


if __name__ == "__main__":
    main()
