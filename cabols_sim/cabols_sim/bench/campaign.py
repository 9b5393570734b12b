# SPDX-License-Identifier: Apache-2.0
"""A stiffness campaign on the simulated rig: starts the bench in lockstep, runs it, analyses it."""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cabols_control.bringup.log_line import read_line
from cabols_control.bringup.processes import Ended, executable_path
from cabols_control.bringup.specs import NodeSpec
from cabols_control.command_line import (
    DONE,
    FAILED,
    INTERRUPTED,
    CommandParser,
    command,
    existing_file,
    fail,
    rig_option,
)
from cabols_control.files.output_folder import output_folder
from cabols_control.naming import number
from cabols_control.rig_folder import BENCH
from cabols_sim.bench.commission import ToolSpec
from cabols_sim.bench.run import forgiving, isolated_environment, real_time_arguments, run_bench
from cabols_sim.devices.robot.robot_config import load_robot_truth

TOOL = "run_campaign"
COMPLETE = "complete"
"""Marker file by which the next call starts a new campaign."""
STALE_S = 10.0
"""Time-out by the computer's clock [s]: in lockstep the rig's time may stand still for long."""
WITHIN = 0.02
TARGET_S = 300.0
SCATTER = (7.2, 4.5, 9.0, 8.3, 8.5, 11.4)
"""Of the source's ten configurations, standard deviations in percent (table 4.3)."""


@dataclass(frozen=True)
class BenchCampaign:
    """One call of the simulated rig with a campaign.

    Attributes:
        folder: of the campaign.
        campaign: its campaign.yaml; empty: the rig's.
        accuracy: to stop at; 0: none.
        seed: of the simulated rig's noise.
        robot_file: YAML of the simulated robot; empty: the rig's.
        real_time: by the wall clock instead of lockstep.
        rig: name or folder, see find_rig.
        rws_version: of the simulated robot's web services, 1 or 2.
        robot_maker: of the simulated controller, abb or ur.
    """

    folder: Path
    campaign: str = ""
    accuracy: float = 0.0
    seed: int = 0
    robot_file: str = ""
    real_time: bool = False
    rig: str = BENCH
    rws_version: int = 1
    robot_maker: str = "abb"

    def values(self) -> dict[str, Any]:
        """Arguments of the graph."""
        pace = {**forgiving(), **real_time_arguments()} if self.real_time else {}
        return {
            **pace,
            "rig": self.rig,
            "campaign": True,
            "robot": True,
            # The campaign itself records the data for its analysis.
            "record": False,
            "lockstep": not self.real_time,
            "seed": self.seed,
            "rws_version": self.rws_version,
            "robot_maker": self.robot_maker,
            "robot_file": self.robot_file,
            **({} if self.real_time else {"stale_after": STALE_S, "state_timeout": STALE_S}),
        }

    def tool(self) -> NodeSpec:
        """Return the client that starts the campaign, and whose end ends everything."""
        words = ["--folder", str(self.folder), "--accuracy", f"{self.accuracy:g}"]
        if self.campaign:
            words += ["--campaign", self.campaign]
        return ToolSpec("cabols_stiffness", TOOL, (), (), words=tuple(words))

    def run(self, on_line: Any, on_start: Any = None, environment: Any = None) -> Ended:
        """Run it to its end, or until one node ends, or Ctrl-C.

        Args:
            on_line: called with (node, line) for every line of output.
            on_start: called with the process ids once all have started.
            environment: variables to add.
        """
        return run_bench(
            self.values(),
            on_line,
            self.folder / "log",
            environment or isolated_environment(),
            on_start,
            tools=[self.tool()],
        )


def show(node: str, line: str) -> None:
    """Show the client's lines, and the other nodes' warnings and errors.

    Args:
        node: that said it.
        line: what it said.
    """
    if node == TOOL:
        print(line, flush=True)
    elif (read := read_line(line)).loud:
        print(f"  {node}: {read.words}", flush=True)


def analyse(folder: Path, quiet: bool = False) -> int:
    """Analyse a campaign's bags with the tool of its package; return its exit code.

    Args:
        folder: of the campaign.
        quiet: whether the tool's output is dropped.
    """
    command = [str(executable_path("cabols_stiffness", "analyze")), str(folder)]
    output = subprocess.DEVNULL if quiet else None
    return subprocess.run(command, check=False, stdout=output).returncode


def compare(folder: Path, robot_file: str = "", rig: str = BENCH) -> tuple[str, float]:
    """Return a table of results and the simulated robot's true values, and the worst error.

    Args:
        folder: of the campaign, analysed.
        robot_file: of the simulated robot; empty: the rig's.
        rig: name or folder, see find_rig.

    Returns:
        The table, and the largest relative error; infinite if a joint was not identified.
    """
    found = yaml.safe_load((folder / "result.yaml").read_text(encoding="utf-8"))
    truth = load_robot_truth(rig, robot_file)
    lines = ["joint    true [Nm/rad]   found [Nm/rad]    error   deviation   the source's scatter"]
    worst = 0.0
    for j, joint in enumerate(found["joints"]):
        value, deviation = joint["stiffness_nm_per_rad"], joint["standard_deviation_nm_per_rad"]
        true = truth.stiffness[j]
        if value is None:
            lines.append(f"{number(j):5d}  {true:15.0f}   not identifiable")
            worst = np.inf
            continue
        error = value / true - 1.0
        worst = max(worst, abs(error))
        lines.append(
            f"{number(j):5d}  {true:15.0f}  {value:15.0f}  {100 * error:+6.2f} %  "
            f"{100 * deviation / value:8.2f} %  {SCATTER[j]:18.1f} %"
        )
    return "\n".join(lines), float(worst)


@command
def main() -> int:
    """Run the campaign; 0 if every joint is within 2 %, 1 if not, 130 after Ctrl-C."""
    options = _arguments()
    anew = options.fresh or (options.output / COMPLETE).exists()
    with output_folder(options.output, "campaign_bench", keep=not anew) as folder:
        code = _run(options)
        if (options.output / COMPLETE).exists():
            folder.finish()
    return code


def _run(options: argparse.Namespace) -> int:
    """Run, analyse and compare."""
    complete = options.output / COMPLETE
    campaign = BenchCampaign(
        options.output,
        options.campaign,
        options.accuracy,
        options.seed,
        options.robot_file,
        options.real_time,
        options.rig,
        options.rws_version,
        options.robot_maker,
    )
    pace = "in real time" if options.real_time else "in lockstep"
    print(f"stiffness campaign on the simulated rig, {pace}, into {options.output}", flush=True)
    began = time.monotonic()
    ended = campaign.run(show)
    took_s = time.monotonic() - began
    if not ended.first or ended.code == 130:
        print(
            f"interrupted: all nodes ended, motors at zero; call again to go on ({options.output})"
        )
        return INTERRUPTED
    if ended.first != TOOL or ended.code != 0:
        log = options.output / "log" / f"{ended.first}.log"
        return fail(f"{ended.first} ended with code {ended.code}: {log}", FAILED)
    complete.touch()
    print(
        f"campaign: {took_s:.0f} s, with the start of all nodes, target {TARGET_S:.0f} s: "
        f"{'met' if took_s <= TARGET_S else 'NOT MET'}; {_processor_s():.0f} s of processor time "
        f"on {len(os.sched_getaffinity(0))} cores",
        flush=True,
    )
    code = analyse(options.output)
    if code != 0:
        return code
    table, worst = compare(options.output, options.robot_file, options.rig)
    print(table)
    verdict = "met" if worst <= WITHIN else "NOT MET"
    print(f"every joint within {100 * WITHIN:g} %: worst {100 * worst:.2f} %, {verdict}")
    print(f"all: {time.monotonic() - began:.0f} s")
    return DONE if worst <= WITHIN else FAILED


def _processor_s() -> float:
    """Return the processor time of all ended processes, i.e. of the nodes [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _arguments() -> argparse.Namespace:
    parser = CommandParser("campaign_bench", __doc__)
    rig_option(parser)
    add = parser.add_argument
    add("--output", type=Path, default=Path("build/campaign"), help="folder (default: %(default)s)")
    add("--campaign", type=existing_file, default="", help="campaign.yaml; default: the rig's")
    add("--accuracy", type=float, default=0.0, help="stop at this relative deviation; 0: never")
    add("--seed", type=int, default=0, help="of all noise of the simulated rig")
    add(
        "--robot-file",
        type=existing_file,
        default="",
        help="YAML of the simulated robot; default: the rig's",
    )
    add("--rws-version", type=int, choices=(1, 2), default=1, help="1: IRC5, 2: OmniCore")
    add("--robot-maker", choices=("abb", "ur"), default="abb", help="of its controller")
    add("--real-time", action="store_true", help="by the wall clock instead of lockstep")
    add("--fresh", action="store_true", help="do not go on with a campaign that was cut")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
