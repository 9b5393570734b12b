# SPDX-License-Identifier: Apache-2.0
"""Trials of a rig whose platform hangs on its cables: how far and how fast it sinks, what pulls."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from cabols_control.rig import load_rig
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety
from cabols_sim.fault_campaign.in_process.hanging_kinds import HANGING_KINDS, HangingKind
from cabols_sim.fault_campaign.in_process.hanging_rig import HangingRig
from cabols_sim.fault_campaign.in_process.rig import PERIOD_S, SPRING_END_N
from cabols_sim.fault_campaign.table import read_trials
from cabols_sim.plant.config import load_plant
from cabols_sim.plant.stand import Stand

HANGING = "hanging"
"""The installed rig whose platform hangs on its cables."""
LOG = "hanging.jsonl"
WATCHED_S, WINDOW_S = 3.0, 0.5
COAST_M = 0.012
"""Way by which the weight may sink besides: motors that pay out at 16 mm/s coast, cables give."""
NET_GIVES_M = 0.08
PLANTS = 3
HANGING_SEEDS = 3
"""Trials of each kind in each of its states."""


class HangingBench:
    """Makes rigs in the state that a trial begins in."""

    def __init__(self, rig_name: str = HANGING) -> None:
        """Read a rig's files.

        Args:
            rig_name: name or folder.
        """
        self._files = load_rig(rig_name), load_card(rig_name)
        self._plant, self.safety = load_plant(rig_name), load_safety(rig_name)
        suspension = self.safety.suspension
        depth = None if suspension is None else suspension.net_depth
        self.net_depth = math.inf if depth is None else depth
        self.sinking_speed = 0.0 if suspension is None else suspension.sinking_speed
        self._up: dict[int, HangingRig] = {}

    def made(self, seed: int) -> HangingRig:
        """Return a rig at rest on its stand.

        Args:
            seed: of the plant.
        """
        stand = Stand(net_depth=self.net_depth)
        return HangingRig(*self._files, self._plant, self.safety, seed, stand=stand)

    def lifted(self, seed: int) -> HangingRig:
        """Return a rig whose platform hangs 60 mm above its stand.

        Args:
            seed: of the trial.
        """
        number = seed % PLANTS
        if number not in self._up:
            rig = self.made(number)
            rig.prepare()
            rig.go(np.array([0.0, 0.0, 0.06]))
            self._up[number] = rig
        return self._up[number].fork()

    def prepare(self, state: str, seed: int, random: np.random.Generator) -> HangingRig:
        """Return a rig in one of the states.

        Args:
            state: its name.
            seed: of the trial.
            random: of the trial.
        """
        rig = self.lifted(seed)
        direction = random.normal(size=3)
        rig.desired[:3] = random.uniform(0.0, 5.0) * direction / np.linalg.norm(direction)
        rig.run(0.6)
        if state == "rises":
            place = rig.guard.watch.hoist.position
            aside = np.r_[random.uniform(-0.05, 0.05, 2), 0.06]
            rig.guard.watch.go(place + aside, rig.guard.watch.hoist.rotation.copy())
            rig.run(random.uniform(0.3, 2.0))
        if state in ("stopped", "after a stop"):
            rig.mode = OperatingMode.STOPPED
            rig.run(1.0 if state == "stopped" else random.uniform(0.002, 0.1))
        return rig


def run_hanging(bench: HangingBench, kind: HangingKind, state: str, seed: int) -> dict[str, Any]:
    """Break a rig, and tell what its platform does by the plant.

    Args:
        bench: makes the rig.
        kind: what breaks.
        state: in which.
        seed: of all that is drawn.
    """
    random = np.random.default_rng([seed, *f"{kind.name} {state}".encode()])
    rig = bench.prepare(state, seed, random)
    seat = float(rig.rig.geometry.reference_position[2])
    rig.watch()
    struck_s = rig.now_s
    kind.strike(rig, random)
    found_s: float | None = None
    for _ in range(round(WATCHED_S / PERIOD_S)):
        rig.cycle()
        if found_s is None and rig.guard.fault is not None:
            found_s = rig.now_s - struck_s
    heights = np.array(rig.heights)
    window = round(WINDOW_S / PERIOD_S)
    fault = rig.guard.fault
    return {
        "kind": kind.name,
        "state": state,
        "seed": seed,
        "fault": "" if fault is None else str(fault.name),
        "found_s": found_s,
        "sank_m": float((np.maximum.accumulate(heights) - heights).max()),
        "sinking_m_s": float((heights[:-window] - heights[window:]).max()) / WINDOW_S,
        "below_m": float(seat - rig.body.position[2]),
        "peak_n": rig.peak,
    }


def why_wrong(bench: HangingBench, trial: dict[str, Any]) -> str:
    """Say what a trial shows against the rig; empty: nothing.

    Args:
        bench: with the bounds.
        trial: of run_hanging.
    """
    kind = next(kind for kind in HANGING_KINDS if kind.name == trial["kind"])
    if not trial["peak_n"] <= SPRING_END_N:
        return f"a cable pulled {trial['peak_n']:.1f} N"
    if kind.found and trial["found_s"] is None:
        return "it was not found"
    if kind.falls:
        deepest = bench.net_depth + NET_GIVES_M
        return "" if trial["below_m"] <= deepest else "the net did not end the fall"
    if not trial["sank_m"] <= COAST_M + bench.sinking_speed * WATCHED_S:
        return f"the weight sank by {1e3 * trial['sank_m']:.1f} mm"
    if not trial["sinking_m_s"] <= bench.sinking_speed + COAST_M / WINDOW_S:
        return f"the weight sank at {1e3 * trial['sinking_m_s']:.1f} mm/s"
    return ""


def hanging_table(bench: HangingBench, trials: list[dict[str, Any]]) -> str:
    """Tell the trials by kinds.

    Args:
        bench: with the bounds.
        trials: of run_hanging.
    """
    lines = [
        f"{'a platform that hangs':34} {'trials':>6} {'found':>6} {'sank':>8} {'over 0.5 s':>11} "
        f"{'pull':>7}  fault"
    ]
    for kind in HANGING_KINDS:
        own = [trial for trial in trials if trial["kind"] == kind.name]
        if not own:
            continue
        found = sum(trial["found_s"] is not None for trial in own)
        names = sorted({trial["fault"] for trial in own if trial["fault"]})
        lines.append(
            f"{kind.name:34} {len(own):6} {found:6} "
            f"{1e3 * max(trial['sank_m'] for trial in own):5.1f} mm "
            f"{1e3 * max(trial['sinking_m_s'] for trial in own):6.1f} mm/s "
            f"{max(trial['peak_n'] for trial in own):5.1f} N  {', '.join(names)}"
        )
    judged = ((trial, why_wrong(bench, trial)) for trial in trials)
    lines += [
        f"{t['kind']}, {t['state']}, seed {t['seed']}: {wrong}" for t, wrong in judged if wrong
    ]
    return "\n".join(lines)


def run_hanging_campaign(
    folder: Path, seeds: int, only: str = "", until_s: float = math.inf
) -> bool:
    """Make the trials that are left, and print the table.

    Args:
        folder: exists; holds the log.
        seeds: trials of each kind in each state.
        only: part of the names of the kinds; empty: all.
        until_s: when to end, on time.monotonic() [s].

    Returns:
        Whether its claims hold.
    """
    log, bench = folder / LOG, HangingBench()
    done = {(trial["kind"], trial["state"], trial["seed"]) for trial in read_trials(log)}
    todo = [
        (kind, state, seed)
        for seed in range(seeds)
        for kind in HANGING_KINDS
        for state in kind.states
        if only in kind.name and (kind.name, state, seed) not in done
    ]
    print(
        f"fault campaign: {len(todo)} trials of a platform that hangs, in one process", flush=True
    )
    with log.open("a", encoding="utf-8") as file:
        for kind, state, seed in todo:
            file.write(json.dumps(run_hanging(bench, kind, state, seed)) + "\n")
            file.flush()
            if time.monotonic() > until_s:
                break
    trials = [trial for trial in read_trials(log) if only in trial["kind"]]
    print(hanging_table(bench, trials))
    return not any(why_wrong(bench, trial) for trial in trials)
