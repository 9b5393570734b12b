# SPDX-License-Identifier: Apache-2.0
"""Memory and time of analysing bags of different lengths, each in a process of its own."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import yaml
from long_bag import TRUE, write_bag
from record import write_figures

from cabols_control.bringup.processes import executable_path
from cabols_control.files.output_folder import output_folder

GIB = 1 << 30
LINEAR = 0.3
"""The time of a cycle may differ so much between the lengths, start of the process left out."""


def main() -> int:
    """Print and write the figures; 0 if the targets are met."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/analysis.json"))
    parser.add_argument("--folder", type=Path, default=Path("build/bench/bags"))
    parser.add_argument("--minutes", type=float, nargs="+", default=[5.0, 20.0, 60.0])
    parser.add_argument("--recorder", action="store_true", help="with the recorder's 1 kHz topics")
    parser.add_argument("--keep", action="store_true", help="keep the bags")
    options = parser.parse_args()
    with output_folder(options.folder, "bench_analysis") as folder:
        runs = [_run(options, minutes) for minutes in sorted(options.minutes)]
        folder.finish()
    figures = summarise(runs, options.recorder)
    write_figures(options.output, figures)
    print(
        f"an hour: {figures['longest_cycles']} cycles, peak memory "
        f"{figures['longest_peak_memory_gib']:.2f} GiB, target 1: {_met(figures['memory_met'])}"
    )
    print(
        f"time of a cycle differs by {100 * figures['nonlinearity']:.0f} % between the lengths, "
        f"target {100 * LINEAR:.0f} %: {_met(figures['linear_met'])}"
    )
    return 0 if figures["memory_met"] and figures["linear_met"] else 1


def _run(options: argparse.Namespace, minutes: float) -> dict[str, float]:
    bag = options.folder / f"bag_{minutes:g}_minutes"
    began = time.perf_counter()
    cycles = write_bag(bag, round(60.0 * minutes), options.recorder)
    wrote_s = time.perf_counter() - began
    size = sum(file.stat().st_size for file in bag.glob("*.mcap"))
    output = bag.with_name(bag.name + "_analysis")
    command = [str(executable_path("cabols_stiffness", "analyze")), str(bag)]
    began = time.perf_counter()
    process = subprocess.Popen(
        [*command, "--output", str(output)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    text = process.stdout.read().decode()
    _, status, usage = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - began
    if os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit(text)
    joints = yaml.safe_load((output / "result.yaml").read_text("utf-8"))["joints"]
    found = np.array([joint["stiffness_nm_per_rad"] for joint in joints])
    if not options.keep:
        # Some GiB; made above, in a folder that is this run's alone.
        for file in bag.glob("*.mcap"):
            file.unlink()
    figures = {
        "minutes": minutes,
        "cycles": cycles,
        "bag_size_gib": size / GIB,
        "writing_s": wrote_s,
        "analysis_wall_s": wall_s,
        "analysis_cpu_s": usage.ru_utime + usage.ru_stime,
        "peak_memory_gib": 1024.0 * usage.ru_maxrss / GIB,
        "worst_error": float(np.abs(found / TRUE - 1.0).max()),
    }
    print(
        f"{minutes:5.1f} min, {cycles:8d} cycles, {size / GIB:.2f} GiB written in {wrote_s:.0f} s: "
        f"analysed in {figures['analysis_cpu_s']:.1f} s of processor time ({wall_s:.1f} s), peak "
        f"{figures['peak_memory_gib']:.2f} GiB, worst joint "
        f"{100 * figures['worst_error']:.2f} % off",
        flush=True,
    )
    return figures


def summarise(runs: list[dict[str, float]], recorder: bool) -> dict[str, object]:
    """Judge the runs, shortest first."""
    cycles = np.array([run["cycles"] for run in runs])
    cpu_s = np.array([run["analysis_cpu_s"] for run in runs])
    slopes = np.diff(cpu_s) / np.diff(cycles)
    rising = slopes.size > 1 and slopes.min() > 0.0
    nonlinearity = float(slopes.max() / slopes.min() - 1.0) if rising else float("inf")
    longest = runs[-1]
    return {
        "recorder_topics": recorder,
        "longest_cycles": longest["cycles"],
        "longest_peak_memory_gib": longest["peak_memory_gib"],
        "longest_analysis_cpu_s": longest["analysis_cpu_s"],
        "time_per_million_cycles_s": [1e6 * float(slope) for slope in slopes],
        "nonlinearity": nonlinearity,
        "memory_met": bool(longest["peak_memory_gib"] < 1.0),
        "linear_met": bool(nonlinearity <= LINEAR),
        "runs": runs,
    }


def _met(met: object) -> str:
    return "met" if met else "NOT met"


if __name__ == "__main__":
    sys.exit(main())
