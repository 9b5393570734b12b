# SPDX-License-Identifier: Apache-2.0
"""Kills (-9) each node in turn during short campaigns on the simulated rig; nothing may be lost."""

from __future__ import annotations

import argparse
import csv
import json
import os
import signal
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cabols_control.command_line import (
    DONE,
    FAILED,
    INTERRUPTED,
    CommandParser,
    command,
    fail,
    rig_option,
)
from cabols_control.files.output_folder import output_folder
from cabols_control.rig_folder import rig_file
from cabols_sim.bench.campaign import TOOL, BenchCampaign, analyse
from cabols_sim.bench.run import isolated_environment

NODES = (
    "stiffness_campaign",
    "stiffness_identifier",
    "plant",
    "limb_controller",
    "wrench_controller",
    "supervisor",
    "abb_tracker_bridge",
    "device_simulator",
    "load_program",
)
PATIENCE_S = 300.0
WORST_DEVIATIONS = 4.0
"""Most standard deviations between the results of a disturbed and the undisturbed campaign."""


@dataclass(frozen=True)
class Trial:
    """Outcome of a kill.

    Attributes:
        victim: node that was killed; empty: none.
        loads_before: finished when it was.
        loads: finished in the end.
        kept: whether the finished ones are still there, byte for byte.
        complete: whether every load was measured in the end.
        difference: from the undisturbed campaign, worst joint, in standard deviations.
        downtime_s: from the kill to the first load of the second run.
    """

    victim: str
    loads_before: int
    loads: int
    kept: bool
    complete: bool
    difference: float
    downtime_s: float

    @property
    def unharmed(self) -> bool:
        """Whether the kill did no harm."""
        return self.kept and self.complete and self.difference <= WORST_DEVIATIONS


def short_campaign(path: Path, configurations: list[int], paths: int, rig: str = "") -> None:
    """Write a part of a rig's campaign.

    Args:
        path: of the file that is written.
        configurations: indices from 0 of the robot's stored configurations.
        paths: number of load paths.
        rig: name or folder, see find_rig; empty: the bench.
    """
    whole = yaml.safe_load(rig_file("campaign.yaml", rig=rig).read_text("utf-8"))
    for key in ("validation_configurations", "validation_paths"):
        del whole[key]
    whole.update(configurations=configurations, paths=whole["paths"][:paths])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(whole, default_flow_style=None), encoding="utf-8")


def finished(folder: Path) -> list[dict[str, str]]:
    """Lines of a campaign's samples.csv."""
    file = folder / "samples.csv"
    if not file.exists():
        return []
    text = file.read_text(encoding="utf-8")
    return list(csv.DictReader(text[: text.rfind("\n") + 1].splitlines()))


def keys(folder: Path) -> set[tuple[int, int, int]]:
    """Return a campaign's loads without its references."""
    names = ("configuration_index", "reflector_index", "load_index")
    lines = finished(folder)
    return {tuple(int(line[name]) for name in names) for line in lines if line["branch"] != "0"}  # type: ignore[misc]


class Killer:
    """Kills one process after a number of finished loads."""

    def __init__(self, campaign: BenchCampaign, victim: str, after: int) -> None:
        """Prepare; start() begins."""
        self._campaign = campaign
        self._victim = victim
        self._after = after
        self.killed_at = np.nan
        self.before: bytes = b""

    def start(self, pids: dict[str, int]) -> None:
        """Start to watch; for run_bench's on_start."""
        threading.Thread(target=self._watch, args=(pids,), daemon=True).start()

    def _watch(self, pids: dict[str, int]) -> None:
        folder, give_up = self._campaign.folder, time.monotonic() + PATIENCE_S
        while len(finished(folder)) < self._after and time.monotonic() < give_up:
            time.sleep(0.02)
        with suppress(ProcessLookupError):
            # A process that has already ended shows in the run's outcome: this kill did not end it.
            os.kill(pids[self._victim], signal.SIGKILL)
        self.killed_at = time.monotonic()
        # A line that is being written at this instant counts as finished if it is complete.
        self.before = (folder / "samples.csv").read_bytes()


def run_trial(campaign: BenchCampaign, victim: str, after: int) -> tuple[int, bool, float]:
    """Kill, then continue; KeyboardInterrupt after Ctrl-C.

    Args:
        campaign: that is interrupted.
        victim: node that is killed.
        after: number of loads after which it is killed.

    Returns:
        Loads before, whether they were kept (False, too, if the victim did not end by the kill),
        and the time lost [s].
    """
    killer = Killer(campaign, victim, after)
    ended = campaign.run(lambda *_: None, killer.start, isolated_environment())
    if not ended.first:
        raise KeyboardInterrupt
    killed = ended.codes.get(victim) == -signal.SIGKILL
    before = killer.before[: killer.before.rfind(b"\n") + 1]
    count = before.count(b"\n") - 1
    first: list[float] = []

    def look(_: dict[str, int]) -> None:
        def body() -> None:
            give_up = time.monotonic() + PATIENCE_S
            while len(finished(campaign.folder)) <= count and time.monotonic() < give_up:
                time.sleep(0.05)
            first.append(time.monotonic())

        threading.Thread(target=body, daemon=True).start()

    if not campaign.run(lambda *_: None, look, isolated_environment()).first:
        raise KeyboardInterrupt
    kept = (campaign.folder / "samples.csv").read_bytes().startswith(before)
    return count, kept and killed, (first[0] if first else np.nan) - killer.killed_at


def stiffness(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """(6,) stiffness and (6,) standard deviation of an analysed campaign [N m/rad]."""
    joints = yaml.safe_load((folder / "result.yaml").read_text(encoding="utf-8"))["joints"]
    names = ("stiffness_nm_per_rad", "standard_deviation_nm_per_rad")
    value, deviation = (np.array([j[name] for j in joints], dtype=float) for name in names)
    return value, deviation


@command
def main() -> int:
    """Run all trials; 0 if no kill did harm, 130 after Ctrl-C."""
    options = _arguments()
    with output_folder(options.output, "campaign_kills") as folder:
        try:
            code = _run(options)
        except KeyboardInterrupt:
            print("interrupted: all nodes ended, motors at zero", flush=True)
            return INTERRUPTED
        folder.finish()
    return code


def _run(options: argparse.Namespace) -> int:
    output: Path = options.output
    file = output / "campaign.yaml"
    short_campaign(
        file, [typed - 1 for typed in options.configuration or [10]], options.paths, options.rig
    )
    undisturbed = BenchCampaign(output / "undisturbed", str(file), rig=options.rig)
    print(
        f"kills: a short campaign, undisturbed, then {len(options.node)} nodes in turn", flush=True
    )
    ended = undisturbed.run(lambda *_: None)
    if not ended.first:
        raise KeyboardInterrupt
    if ended.first != TOOL or ended.code != 0 or analyse(undisturbed.folder, True) != 0:
        return fail(f"undisturbed: {ended.first} ended with code {ended.code}", FAILED)
    wanted, (value, deviation) = keys(undisturbed.folder), stiffness(undisturbed.folder)
    trials: list[Trial] = []
    for number, victim in enumerate(options.node):
        campaign = BenchCampaign(output / victim, str(file), rig=options.rig)
        after = 2 + (3 * number) % max(len(finished(undisturbed.folder)) - 4, 1)
        before, kept, downtime_s = run_trial(campaign, victim, after)
        complete = keys(campaign.folder) == wanted
        difference = np.inf
        if analyse(campaign.folder, True) == 0:
            found, spread = stiffness(campaign.folder)
            difference = float(np.nanmax(np.abs(found - value) / np.hypot(spread, deviation)))
        total = len(finished(campaign.folder))
        trials.append(Trial(victim, before, total, kept, complete, difference, downtime_s))
        print(_line(trials[-1]), flush=True)
    return _report(trials, options.json)


def _line(trial: Trial) -> str:
    return (
        f"  {trial.victim:<21} killed after {trial.loads_before:2d} loads; "
        f"{'all kept' if trial.kept else 'LOST SOME'}, "
        f"{'complete' if trial.complete else 'INCOMPLETE'} with {trial.loads} loads; "
        f"{trial.difference:.1f} deviations from undisturbed; "
        f"the next load came {trial.downtime_s:.0f} s after the kill"
    )


def _report(trials: list[Trial], path: Path) -> int:
    unharmed = sum(trial.unharmed for trial in trials)
    print(f"{unharmed} of {len(trials)} kills did no harm")
    content: dict[str, Any] = {
        "kills": len(trials),
        "unharmed": unharmed,
        "trials": [{**trial.__dict__, "unharmed": trial.unharmed} for trial in trials],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return DONE if unharmed == len(trials) else FAILED


def _arguments() -> argparse.Namespace:
    parser = CommandParser("campaign_kills", __doc__)
    rig_option(parser)
    add = parser.add_argument
    add("node", nargs="*", default=list(NODES), help="to kill (default: each in turn)")
    add("--output", type=Path, default=Path("build/campaign_kills"), help="folder")
    add(
        "--configuration",
        type=int,
        action="append",
        help="from 1; repeat (default: 10)",
    )
    add("--paths", type=int, default=2, help="ways of tension at each configuration")
    add("--json", type=Path, default=Path("build/bench/campaign_kills.json"), help="figures")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
