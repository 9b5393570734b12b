# SPDX-License-Identifier: Apache-2.0
"""Runs and figures behind the command fast_gains: programmes, drawn plants, the search."""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cabols_control.command_line import DONE, FAILED
from cabols_control.errors import CabolsError
from cabols_control.load_programs.programs import load_program
from cabols_control.rig import Rig, load_rig
from cabols_control.rig_folder import BENCH, find_rig, rig_file
from cabols_control.run_report.judgement.figures_of_merit import load_run, summarise
from cabols_control.run_report.pictures.run_figures import DPI, draw_overview
from cabols_sim.bench.run import run_bench
from cabols_sim.dynamics.bench_vibration import margin_numbers
from cabols_sim.plant.closed_loop import simulate
from cabols_sim.plant.config import PlantConfig
from cabols_sim.reproductions.common import bench
from cabols_sim.studies.gain_search import judge, program_samples, search

RISE_MAX_S, OVERSHOOT_MAX_PERCENT, CURRENT_MAX_A = 0.12, 5.0, 3.0
SPREAD = 0.1
"""Plants are drawn whose gains and time constants differ by up to this share."""
SEARCH_RISE_S = 0.114
"""Requirement of --search for the slowest step: 0.12 s with a margin."""
ROWS = (
    ("rise time 10-90 %, median", "rise_time_s", "s", 3, RISE_MAX_S),
    ("rise time, slowest step", "rise_time_max_s", "s", 3, RISE_MAX_S),
    ("overshoot", "overshoot_percent", "%", 2, OVERSHOOT_MAX_PERCENT),
    ("peak current", "current_peak_a", "A", 2, CURRENT_MAX_A),
    ("cross-coupling, of rated", "cross_coupling_percent", "%", 2, None),
    ("steady error, of rated", "steady_error_percent", "%", 3, None),
    ("lowest tension estimate", "tension_min_n", "N", 2, None),
    ("highest tension estimate", "tension_max_n", "N", 1, None),
)


class RunFailedError(CabolsError):
    """The graph ended before its programme."""


def prove(arguments: argparse.Namespace, design: str) -> int:
    """Run, judge, print and write everything.

    Args:
        arguments: of the command line, see cabols_sim.studies.fast_gains.
        design: file of the control design where the command line names none.

    Returns:
        Exit code: done, or failed where a promise is not kept.
    """
    folder = find_rig(arguments.rig)
    # The design does not depend on the rig: its gains do.
    control = rig_file(design, arguments.control_file, folder if folder.has(design) else BENCH)
    rig = load_rig(folder, control=control)
    numbers: dict[str, Any] = {"margins": margin_numbers(rig), "programs": {}}
    print(f"design {control.name}: poles {rig.control.poles}, zero {rig.control.zero:g} 1/s")
    if arguments.search:
        search_design(rig, arguments.rig)
    kept = True
    for program in arguments.program or ["steps", "multi_axis"]:
        summary = run_program(
            program, control, arguments.output / Path(program).stem, arguments.rig
        )
        numbers["programs"][program] = summary
        kept = show(summary) and kept
    if arguments.draws:
        numbers["drawn_plants"] = drawn = draw_plants(rig, arguments.draws, arguments.rig)
        kept = show_drawn(drawn) and kept
    arguments.json.parent.mkdir(parents=True, exist_ok=True)
    arguments.json.write_text(json.dumps(numbers, indent=2) + "\n", encoding="utf-8")
    print(f"figures are in {arguments.json}, bags and pictures in {arguments.output}")
    return DONE if kept else FAILED


def search_design(rig: Rig, name: str = BENCH) -> None:
    """Search poles and zero again on the programme `steps`, and print the result.

    Args:
        rig: whose control design is searched for.
        name: of the rig's folder, for its card and plant.
    """
    print("search: least peak current, generations of 40 designs ...", flush=True)

    def say(text: str) -> None:
        print(f"  {text}", flush=True)

    program = load_program("steps")
    args = (rig, bench(name).card, bench(name).plant, program, SEARCH_RISE_S)
    poles, zero, found = search(*args, progress=say)
    print(
        f"search: poles {[round(p, 1) for p in poles]}, zero {zero:.1f}: slowest step "
        f"{found.rise_time_max:.3f} s, overshoot {100.0 * found.overshoot:.2f} %, "
        f"{found.peak_current:.2f} A"
    )


def run_program(program: str, control: Path, folder: Path, rig: str = BENCH) -> dict[str, Any]:
    """Run a load programme through the real nodes in lockstep and reduce its bag to numbers.

    Args:
        program: built in, or the path of a .csv file.
        control: YAML of the control design.
        folder: for bag, picture and logs; without a bag so far.
        rig: name or folder, see find_rig.

    Returns:
        As cabols_control.run_report.judgement.figures_of_merit.summarise.

    Raises:
        RunFailedError: if the graph ended before the programme.
    """
    folder.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    print(f"{program}: running the nodes in lockstep ...", flush=True)
    ended = run_bench(
        {
            "rig": rig,
            "lockstep": True,
            "auto_start": True,
            "program": program,
            "preview": False,
            "exit_when_done": True,
            "control_file": str(control),
            "output": str(folder / "bag"),
        },
        lambda _node, _line: None,
        folder / "log",
    )
    if ended.first != "load_program" or ended.code != 0:
        raise RunFailedError(
            f"{program}: expected the programme's end, got {ended.first or 'an interruption'} "
            f"with code {ended.code}; see {folder / 'log'}"
        )
    print(f"{program}: done after {time.monotonic() - began:.0f} s")
    run = load_run(folder / "bag")
    summary = summarise(run, load_rig(rig, control=control))
    draw_overview(run, summary).savefig(folder / "overview.png", dpi=DPI)
    return summary


def show(summary: dict[str, Any]) -> bool:
    """Print a programme's table; return whether its limits are kept."""
    kept = True
    for label, key, unit, digits, most in ROWS:
        value = summary[key]
        number = float("nan") if value is None else float(value)
        text = f"  {label:28} {number:8.{digits}f} {unit}"
        if most is not None:
            # Below: a current at its limit would be a saturated one.
            met = number < most
            kept = kept and met
            text += f"   below {most:g} {unit}: {'met' if met else 'NOT MET'}"
        print(text)
    return kept and not summary["faults"]


def draw_plants(rig: Rig, draws: int, name: str = BENCH) -> dict[str, Any]:
    """Vary the plant's gains and time constants about the identified ones; programme `steps`.

    Args:
        rig: with the design.
        draws: number of plants, each with noise of its own.
        name: of the plants' rig, see find_rig.

    Returns:
        Largest values over all draws.
    """
    card, nominal = bench(name).card, bench(name).plant
    desired = program_samples(load_program("steps"))
    random = np.random.default_rng(20261125)
    found = [
        judge(simulate(rig, card, _vary(nominal, random), desired, seed=seed), rig)
        for seed in range(draws)
    ]
    rises = [each.rise_time for each in found]
    return {
        "draws": draws,
        "spread_percent": 100.0 * SPREAD,
        "rise_time_median_max_s": max(rises),
        "rise_time_median_min_s": min(rises),
        "overshoot_max_percent": 100.0 * max(each.overshoot for each in found),
        "current_peak_max_a": max(each.peak_current for each in found),
    }


def _vary(plant: PlantConfig, random: np.random.Generator) -> PlantConfig:
    def each(values: list[float]) -> list[float]:
        return [value * float(random.uniform(1.0 - SPREAD, 1.0 + SPREAD)) for value in values]

    limbs = plant.limbs
    return replace(
        plant,
        limbs=replace(limbs, gain=each(limbs.gain), time_constant=each(limbs.time_constant)),
    )


def show_drawn(drawn: dict[str, Any]) -> bool:
    """Print the drawn plants' extremes; return whether overshoot and current keep their limits."""
    print(
        f"{drawn['draws']} plants, gains and time constants within "
        f"+-{drawn['spread_percent']:g} %, compiled loop:\n"
        f"  rise time, median of steps   {drawn['rise_time_median_min_s']:.3f} to "
        f"{drawn['rise_time_median_max_s']:.3f} s\n"
        f"  overshoot, largest           {drawn['overshoot_max_percent']:.2f} %\n"
        f"  peak current, largest        {drawn['current_peak_max_a']:.2f} A"
    )
    return bool(
        drawn["overshoot_max_percent"] < OVERSHOOT_MAX_PERCENT
        and drawn["current_peak_max_a"] < CURRENT_MAX_A
    )
