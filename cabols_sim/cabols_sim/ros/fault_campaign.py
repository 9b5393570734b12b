# SPDX-License-Identifier: Apache-2.0
"""Executable fault_campaign: every fault, many times, in the simulated rig.

It continues where it was interrupted; build/faults/trials.jsonl holds every trial.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import sys
import threading
import time
from pathlib import Path

from cabols_control.command_line import DONE, FAILED, INTERRUPTED, command, fail
from cabols_control.files.output_folder import output_folder
from cabols_control.ros.rig_client import AbandonedError, RigError
from cabols_sim.bench.run import isolated_environment, real_time_arguments, run_bench
from cabols_sim.fault_campaign.command import fault_campaign_parser
from cabols_sim.fault_campaign.crossed import CROSSED, crossed_claims
from cabols_sim.fault_campaign.in_process.command import run_generated
from cabols_sim.fault_campaign.in_process.hanging_trials import HANGING_SEEDS, run_hanging_campaign
from cabols_sim.fault_campaign.kinds import KINDS, Kind
from cabols_sim.fault_campaign.table import holds, read_trials, summarise, text
from cabols_sim.ros.fault_trials import RESTART_S, Trials
from cabols_sim.ros.rig_watch import RigWatch

TRIALS, CROSSED_TRIALS = "trials.jsonl", "crossed.jsonl"
ATTEMPTS = 3
"""Most attempts of a trial whose rig could not be loaded, or was disturbed before the fault; after
them the whole rig is restarted."""
PATIENCE_S = 15.0
"""Longest end of a trial after Ctrl-C [s]."""
RIGS = 10
"""Most rigs in a row without a completed trial; after them the campaign gives up.

After many kills the middleware may fail to discover a process that was started again.
"""


class Campaign:
    """Runs the remaining trials while the graph runs."""

    def __init__(
        self, options: argparse.Namespace, todo: list[tuple[Kind, int]], log: Path, until_s: float
    ) -> None:
        """Plan; the folder exists. It ends in order after until_s of time.monotonic()."""
        self._options = options
        self._until_s = until_s
        self._todo = todo
        self._log = log
        self._watch: RigWatch | None = None
        self._abandoned = False
        self.failure = ""

    def body(self, domain: int, pids: dict[str, int]) -> None:
        """Do the trials, then end the graph."""
        watch = self._watch = RigWatch(domain, self._options.speed, self._options.rig)
        trials = Trials(watch, pids, self._options.speed, self._options.output)
        began = time.monotonic()
        try:
            watch.wait(
                lambda: watch.now_s > 0.0, "the rig's first sample", 120.0, even_in_fault=True
            )
            time.sleep(2.0)
            for number, (kind, seed) in enumerate(self._todo, start=1):
                if time.monotonic() > self._until_s:
                    break
                self._trial(trials, kind, seed)
                rate = (time.monotonic() - began) / number
                left = rate * (len(self._todo) - number)
                print(f"  {number}/{len(self._todo)}, {left / 60.0:.0f} min left", flush=True)
        except RigError as error:
            self.failure = str(error)
        except AbandonedError:
            pass
        finally:
            watch.close()
            if not self._abandoned:
                os.kill(os.getpid(), signal.SIGTERM)

    def abandon(self) -> None:
        """Let body end at once, from another thread; the graph has ended."""
        self._abandoned = True
        if self._watch is not None:
            self._watch.abandon()

    def _trial(self, trials: Trials, kind: Kind, seed: int) -> None:
        for attempt in range(1, ATTEMPTS + 1):
            try:
                result = trials.run(kind, seed)
            except RigError as error:
                print(f"{kind.name}, seed {seed}: {error}", flush=True)
                if attempt == ATTEMPTS:
                    raise
                if attempt > 1:
                    trials.renew()
                continue
            with self._log.open("a", encoding="utf-8") as file:
                file.write(json.dumps({**result.as_dict(), "disturbed": attempt - 1}) + "\n")
            found = (
                f"{1e3 * result.detection_time_s:.0f} ms, safe after "
                f"{1e3 * result.safe_time_s:.0f} ms, {result.detection}"
                if result.detected
                else "NOT DETECTED"
            )
            print(f"{kind.name}, seed {seed}: {found}", flush=True)
            return


@command
def main() -> int:
    """Run the campaign; 0 if its claims hold, 1 if not, 130 after Ctrl-C."""
    options = fault_campaign_parser().parse_args()
    until_s = time.monotonic() + 60.0 * options.minutes if options.minutes else math.inf
    with output_folder(options.output, "fault_campaign", keep=not options.fresh) as folder:
        seeds, held = 1 if options.short else options.generated, True
        if options.part in ("all", "hanging") and not (options.short and options.part == "all"):
            held = run_hanging_campaign(options.output, HANGING_SEEDS, options.only, until_s)
        if options.part == "hanging":
            return DONE if held else FAILED
        if options.part in ("all", "generated"):
            plan = options.rig, seeds, options.only, until_s
            held = run_generated(options.output, *plan) and held
        if options.short or options.part == "generated":
            return DONE if held else FAILED
        code = DONE if held else FAILED
        for part in ("nodes", "crossed"):
            if options.part in ("all", part) and code != INTERRUPTED:
                made = _campaign(options, part == "crossed", until_s)
                code = made if made != DONE else code
        if not (_todo(options, False) or _todo(options, True)):
            folder.finish()
    return code


def _campaign(options: argparse.Namespace, crossed: bool, until_s: float) -> int:
    """Make the trials that are left, with as many rigs as it takes, and judge them all."""
    log = _log(options, crossed)
    failure, barren = "", 0
    while (todo := _todo(options, crossed)) and barren < RIGS and time.monotonic() < until_s:
        print(f"fault campaign: {len(todo)} trials, rig at {options.speed:g} of real time")
        campaign = Campaign(options, todo, log, until_s)
        if not _run(options, campaign):
            print(f"interrupted; the trials done are in {log}")
            return INTERRUPTED
        failure = campaign.failure
        barren = barren + 1 if len(_todo(options, crossed)) == len(todo) else 0
    trials = read_trials(log)
    summary = summarise(trials, [kind.name for kind in (CROSSED if crossed else KINDS)])
    claims = crossed_claims(trials) if crossed else {}
    figures = log.with_suffix(".json") if crossed else options.output / "faults.json"
    figures.write_text(json.dumps({**summary, **claims}, indent=2) + "\n", "utf-8")
    print(text(summary))
    if crossed:
        print(f"of kinds in which neither an amplifier drives nor the robot has to brake: {claims}")
    print(f"  {figures}")
    missing = len(_todo(options, crossed))
    if missing and time.monotonic() > until_s:
        print(f"time is over: {missing} trials are left; another call makes them")
    elif missing:
        return fail(f"{missing} trials could not be made: {failure}", FAILED)
    held = not any(claims.values()) if crossed else holds(summary)
    return DONE if held and trials else FAILED


def _log(options: argparse.Namespace, crossed: bool) -> Path:
    return Path(options.output) / (CROSSED_TRIALS if crossed else TRIALS)


def _todo(options: argparse.Namespace, crossed: bool) -> list[tuple[Kind, int]]:
    """Trials that are still to be made."""
    done = {(trial["kind"], trial["seed"]) for trial in read_trials(_log(options, crossed))}
    of_all = CROSSED if crossed else KINDS
    kinds = [kind for kind in of_all if not options.only or options.only in kind.name]
    # A kind that is only checked once more needs one trial.
    every = [(kind, seed) for seed in range(1 if crossed else options.seeds) for kind in kinds]
    return [(kind, seed) for kind, seed in every if (kind.name, seed) not in done]


def _run(options: argparse.Namespace, campaign: Campaign) -> bool:
    """Run the graph and the campaign beside it; False after Ctrl-C."""
    environment = isolated_environment()
    finished = threading.Event()

    def start(pids: dict[str, int]) -> None:
        def body() -> None:
            campaign.body(int(environment["ROS_DOMAIN_ID"]), pids)
            finished.set()

        threading.Thread(target=body, daemon=True).start()

    log = options.output / "log"
    values = {
        "rig": options.rig,
        "robot": True,
        "record": False,
        "truth": True,
        "speed": options.speed,
        "stale_after": 0.05 / options.speed,
        **real_time_arguments(),
    }
    restart_s = RESTART_S / options.speed
    run_bench(values, lambda *_: None, log, environment, start, respawn_s=restart_s)
    if finished.wait(2.0):
        return True
    campaign.abandon()
    finished.wait(PATIENCE_S)
    return False


if __name__ == "__main__":
    sys.exit(main())
