# SPDX-License-Identifier: Apache-2.0
"""What the operator's console costs the rig: the same run without and with it, 1 kHz, all bridges.

With: two pages open at 20 Hz, spoken to as a browser does, but not drawn: a browser draws on the
operator's machine, or with a graphics card. `--browser` opens a real one here instead.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import bench_realtime
from console_page import is_served
from record import write_figures

from cabols_control.files.output_folder import claim
from cabols_sim.bench.run import isolated_environment, real_time_arguments

PAGE = Path(__file__).with_name("console_page.py")
PAGES = 2
PORT = 8146
CPU_TARGET = 25.0
RUNS = {"without": False, "with": True}
FIGURES = (
    ("round_trip_median_s", 1e6, "round trip, median [us]"),
    ("round_trip_p99_s", 1e6, "round trip, p99 [us]"),
    ("late_percent", 1.0, "late cycles [%]"),
)
SAME = 1.15
"""A figure may be so much larger with a console: two equal runs differ by that here."""
SAME_POINTS = 0.5
"""Or, for late cycles, by so many points: the target of bench-realtime."""


def main() -> int:
    """Run, print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/console.json"))
    parser.add_argument("--seconds", type=float, default=40.0, help="of each run")
    parser.add_argument("--pairs", type=int, default=2, help="runs without and with, in turn")
    parser.add_argument("--plain", action="store_true", help="ask the kernel for nothing")
    parser.add_argument("--browser", action="store_true", help="a real Chromium instead")
    arguments = parser.parse_args()
    folder = arguments.output.parent / "console"
    claimed = claim(folder, "bench_console")
    environment = isolated_environment()
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in RUNS}
    for pair in range(arguments.pairs):
        for name, console in RUNS.items():
            print(f"run {pair + 1} of {arguments.pairs}, {name} console", flush=True)
            found[name].append(_run(folder / f"{name}_{pair}", environment, arguments, console))
    claimed.finish()
    figures = _summary(found)
    write_figures(arguments.output, figures)
    print(_table(figures))
    return 0


def _run(
    folder: Path, environment: dict[str, str], arguments: argparse.Namespace, console: bool
) -> dict[str, Any]:
    asked = {} if arguments.plain else real_time_arguments()
    values: dict[str, Any] = {"robot": True, **asked}
    if not console:
        return _figures(bench_realtime._graph(folder, environment, arguments.seconds, values))
    values |= {
        "console": True,
        "console_port": PORT,
        "campaigns": str(folder / "campaigns"),
        "uploads": str(folder / "programs"),
    }
    # Pages read for as long as the CPU shares are measured, and a little longer.
    length = str(arguments.seconds + 5.0)
    core = str(asked.get("other_cpu", -1))
    pages: list[dict[str, float]] = []
    with ExitStack() as stack:
        if arguments.browser:
            thread = threading.Thread(target=_browse, args=(float(length), pages), daemon=True)
            thread.start()
        started = [
            stack.enter_context(
                subprocess.Popen(
                    [sys.executable, str(PAGE), str(PORT), length, core],
                    stdout=subprocess.PIPE,
                    env={**os.environ, **environment},
                )
            )
            for _ in range(0 if arguments.browser else PAGES)
        ]
        figures = _figures(bench_realtime._graph(folder, environment, arguments.seconds, values))
        for process in started:
            # A page whose console ends first has no last line.
            text = process.communicate()[0].decode().strip()
            if text:
                pages.append(json.loads(text.splitlines()[-1]))
    figures["pages"] = pages
    return figures


def _browse(seconds: float, pages: list[dict[str, float]]) -> None:
    """Show the page in a real browser; its drawing without a graphics card takes a core."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))
    from browser import chromium

    with tempfile.TemporaryDirectory() as profile, chromium(Path(profile)) as browser:
        page = browser.pages[0]
        give_up = time.monotonic() + 60.0
        while not is_served(f"http://127.0.0.1:{PORT}"):
            assert time.monotonic() < give_up, "no console"
            time.sleep(0.2)
        page.goto(f"http://127.0.0.1:{PORT}")
        page.wait_for_function("window.cabolsFrames > 0")
        began, first = time.monotonic(), page.evaluate("window.cabolsFrames")
        time.sleep(max(seconds - 12.0, 4.0))
        frames = page.evaluate("window.cabolsFrames") - first
        pages.append({"frames": frames, "rate_hz": frames / (time.monotonic() - began)})


def _figures(run: dict[str, Any]) -> dict[str, Any]:
    none = {"echo_median_s": 1.0, "timer_late_percent": 0.0}
    found = bench_realtime._figures(run, none, robot=True)
    kept = [name for name, _, _ in FIGURES] + ["cycles", "cpu_percent", "recorder_lost"]
    return {name: found[name] for name in kept}


def _summary(found: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Means over the runs, and whether the targets are met."""
    means: dict[str, Any] = {"runs": found}
    for name, runs in found.items():
        means[name] = {key: sum(r[key] for r in runs) / len(runs) for key, _, _ in FIGURES}
        nodes = runs[0]["cpu_percent"]
        means[name]["cpu_percent"] = {
            node: round(sum(r["cpu_percent"].get(node, 0.0) for r in runs) / len(runs), 1)
            for node in nodes
        }
    without, with_console = means["without"], means["with"]
    rates = [page["rate_hz"] for run in found["with"] for page in run["pages"]]
    means["page_rate_hz"] = rates
    means["console_cpu_percent"] = with_console["cpu_percent"]["console"]
    means["console_cpu_target_percent"] = CPU_TARGET
    means["console_cpu_met"] = means["console_cpu_percent"] <= CPU_TARGET and bool(rates)
    means["loop_met"] = {
        key: with_console[key] <= SAME * without[key]
        or (key == "late_percent" and with_console[key] - without[key] <= SAME_POINTS)
        for key, _, _ in FIGURES
    }
    return means


def _table(f: dict[str, Any]) -> str:
    lines = [f"{'':34}{'without':>12}{'with':>12}"]
    for key, factor, label in FIGURES:
        pair = (f["without"][key], f["with"][key])
        met = "met" if f["loop_met"][key] else "NOT met"
        cells = "".join(f"{factor * value:>12.2f}" for value in pair)
        lines.append(f"{label:34}{cells}  {met}, target {SAME:g} times")
    for node, share in f["with"]["cpu_percent"].items():
        before = f["without"]["cpu_percent"].get(node)
        lines.append(f"{'CPU [%]: ' + node:34}{'-' if before is None else before:>12}{share:>12}")
    rates = ", ".join(f"{rate:.1f}" for rate in f["page_rate_hz"]) or "none"
    met = "met" if f["console_cpu_met"] else "NOT met"
    lines.append(f"frames a second at the pages: {rates}")
    lines.append(
        f"console: {f['console_cpu_percent']:.1f} % of a core, "
        f"target {f['console_cpu_target_percent']:g} %: {met}"
    )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
