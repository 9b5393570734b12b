# SPDX-License-Identifier: Apache-2.0
"""Runs the generated campaign: goes on where it was interrupted; a short form for CI."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

from cabols_sim.fault_campaign.in_process.kinds import generated_kinds
from cabols_sim.fault_campaign.in_process.summary import (
    generated_holds,
    generated_text,
    summarise_generated,
)
from cabols_sim.fault_campaign.in_process.trials import Bench, run_trial
from cabols_sim.fault_campaign.table import read_trials

LOG = "generated.jsonl"
SEEDS = 6
"""Trials of each kind; in the short form one."""


def run_generated(
    folder: Path, rig: str = "", seeds: int = SEEDS, only: str = "", until_s: float = math.inf
) -> bool:
    """Make the trials that are left, print the table and write it to generated.json.

    Args:
        folder: exists; holds the log.
        rig: name or folder; empty: the reference bench.
        seeds: trials of each kind.
        only: part of the names of the kinds; empty: all.
        until_s: when to end, on time.monotonic() [s]; what is left, another call makes.

    Returns:
        Whether its claims hold.
    """
    log = folder / LOG
    kinds = [kind for kind in generated_kinds() if only in kind.name]
    done = {(trial["kind"], trial["seed"]) for trial in read_trials(log)}
    todo = [
        (kind, seed) for seed in range(seeds) for kind in kinds if (kind.name, seed) not in done
    ]
    print(f"fault campaign: {len(todo)} generated trials in one process", flush=True)
    bench, told_s = Bench(rig), time.monotonic()
    with log.open("a", encoding="utf-8") as file:
        for number, (kind, seed) in enumerate(todo, start=1):
            file.write(json.dumps(run_trial(bench, kind, seed)) + "\n")
            file.flush()
            if time.monotonic() > until_s:
                print(f"time is over: {len(todo) - number} generated trials are left")
                break
            if time.monotonic() - told_s > 10.0:
                told_s = time.monotonic()
                print(f"  {number}/{len(todo)}", flush=True)
    names = {kind.name for kind in kinds}
    summary = summarise_generated([t for t in read_trials(log) if t["kind"] in names])
    (folder / "generated.json").write_text(json.dumps(summary, indent=2) + "\n", "utf-8")
    print(generated_text(summary))
    return generated_holds(summary)
