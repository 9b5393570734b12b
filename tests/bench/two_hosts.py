# SPDX-License-Identifier: Apache-2.0
"""One rig on two hosts: bridge and recorder on one, controllers and supervisor on the other.

The hosts are network namespaces of this machine, so that they share cores and clock: what a second
computer would add of its own, a clock that differs, is not seen here (no node compares another
host's clock with its own; ages count from a message's arrival). Each case is one run of
`multi_axis` under load in real time: on one host, on two that the kernel joins, and with delay and
loss between them. Where the network is too bad for the loop the rig has to stop and unload, or not
to start, and no cable may pass its limit. Finished cases are kept: another call goes on where it
was; --fresh begins anew.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from hosts import NoHostsError, Wire, carried, two_hosts
from record import write_figures

from cabols_control.bags.reader import BagError, read_bag
from cabols_control.command_line import USAGE, fail
from cabols_control.rig import load_rig
from cabols_control.run_report.judgement.figures_of_merit import summarise
from cabols_control.run_report.run import load_run
from cabols_sim.bench.run import (
    forgiving,
    isolated_environment,
    real_time_arguments,
    run_bench,
)
from cabols_sim.bringup_nodes import bench_graph

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))
from line_journal import LineJournal

AT_THE_RIG = ("plant", "recorder")
PROGRAM = "multi_axis"
END_LIMIT_S = 90.0
RUN_LIMIT_S = 240.0
LAST_TENSION_N = 10.0
HIGHEST_TENSION_N = 150.0
"""The springs' end: what no cable may pass in any case."""

SHOWN = {
    "round_trip_median_s": ("trip [us]", 1e6, 0),
    "round_trip_p99_s": ("p99 [us]", 1e6, 0),
    "lost_cycles_percent": ("lost [%]", 1.0, 3),
    "command_error_rms_force_n": ("error [N]", 1.0, 3),
    "command_error_rms_torque_nm": ("[N m]", 1.0, 4),
    "highest_tension_n": ("tension [N]", 1.0, 1),
    "last_tension_n": ("at end [N]", 1.0, 1),
}
"""Figures of a row: heading, factor on the value, digits."""
HEAD = f"{'':24}" + "".join(f"{head:>12}" for head, _, _ in SHOWN.values()) + "  outcome"


@dataclass(frozen=True)
class Case:
    """One run.

    Attributes:
        name: of the row.
        wire: between the hosts; None: one host.
        holds: whether the programme is to be completed; None: it may, or the rig may stop.
    """

    name: str
    wire: Wire | None
    holds: bool | None = None


CASES = (
    Case("one host", None, holds=True),
    Case("two hosts", Wire(), holds=True),
    Case("0.2 ms one way", Wire(delay_s=0.2e-3), holds=True),
    Case("0.5 ms, jitter 0.5 ms", Wire(delay_s=0.5e-3, jitter_s=0.5e-3)),
    Case("0.2 ms, 0.1 % lost", Wire(delay_s=0.2e-3, loss=1e-3)),
    Case("0.2 ms, 1 % lost", Wire(delay_s=0.2e-3, loss=1e-2)),
    Case("2 ms one way", Wire(delay_s=2e-3)),
    Case("10 ms one way", Wire(delay_s=10e-3)),
    Case("300 ms one way", Wire(delay_s=0.3), holds=False),
)


def main() -> int:
    """Run the cases, print the table and write it; 1 if a case did not end as it should."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add("--output", type=Path, default=Path("build/bench/two_hosts.json"))
    add("--short", action="store_true", help="the first two cases and the last")
    add("--fresh", action="store_true", help="forget the cases that there are")
    add("--most", type=int, default=len(CASES), help="new cases of this call")
    add("--plain", action="store_true", help="ask the kernel for nothing")
    add("--program", default=PROGRAM, help="that is run (default: %(default)s)")
    add("--child", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        return child(json.loads(arguments.child))
    folder = arguments.output.parent / "two_hosts"
    folder.mkdir(parents=True, exist_ok=True)
    asked = {} if arguments.plain else real_time_arguments()
    journal = LineJournal(folder / "cases.jsonl", fresh=arguments.fresh)
    cases = (*CASES[:2], CASES[-1]) if arguments.short else CASES
    rows, new = {}, 0
    for case in cases:
        key = f"{case.name}, {arguments.program}"
        if key not in journal.found:
            if (new := new + 1) > arguments.most:
                return 0
            print(f"{case.name} ...", flush=True)
            try:
                row = run_case(case, folder / "run", {"program": arguments.program, **asked})
            except NoHostsError as error:
                return fail(str(error), USAGE)
            journal.add(key, **row)
        rows[case.name] = journal.found[key]
        print(line(case.name, rows[case.name]), flush=True)
    figures = {"program": arguments.program, "asked_of_the_kernel": asked, "cases": rows}
    write_figures(arguments.output, figures)
    print("\n".join([HEAD, *(line(name, row) for name, row in rows.items())]))
    return 0 if all(row["as_expected"] for row in rows.values()) else 1


def child(given: dict[str, Any]) -> int:
    """Launch the nodes of one host; leave how they ended."""
    values = {**given["values"], "nodes": ",".join(given["nodes"])}
    ended = run_bench(values, log_folder=Path(given["log"]), environment=given["environment"])
    result = {"first": ended.first, "code": ended.code, "codes": ended.codes}
    Path(given["log"], "ended.json").write_text(json.dumps(result), encoding="utf-8")
    return 0


def run_case(case: Case, folder: Path, chosen: dict[str, Any]) -> dict[str, Any]:
    """Run the programme once, with chosen arguments; return the row of figures."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    values = {
        "record": True,
        "output": str(folder / "bag"),
        "auto_start": True,
        "exit_when_done": True,
        **forgiving(),
        **chosen,
    }
    every = [node.executable for node in bench_graph(robot=False)]
    rig = [name for name in every if name in AT_THE_RIG]
    control = [name for name in every if name not in AT_THE_RIG]
    environment = isolated_environment()
    with ExitStack() as stack:
        launches: list[tuple[list[str], list[str]]] = [([], every)]
        if case.wire is not None:
            hosts = stack.enter_context(two_hosts(case.wire))
            environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
            launches = list(zip(hosts, (rig, control), strict=True))
        ended = _launch(folder, values, environment, launches)
        sent = [carried(words) for words, _ in launches if words]
    row: dict[str, Any] = {"ended": ended, "frames_sent": sent}
    try:
        row.update(_figures(folder / "bag"))
    except BagError as error:
        # A run in which nothing can be read of what the cables did has shown nothing.
        return {**row, "bag": str(error), "completed": False, "as_expected": False}
    if case.wire is not None and not case.wire.plain:
        row["wire"] = asdict(case.wire)
    done = ended[-1]["codes"].get("load_program") == 0 and ended[-1]["first"] == "load_program"
    row["completed"] = done
    unloaded = row["last_current_a"] == 0.0 and row["last_tension_n"] <= LAST_TENSION_N
    bounded = row["highest_tension_n"] <= HIGHEST_TENSION_N
    row["as_expected"] = case.holds in (done, None) and unloaded and bounded
    return row


def _launch(
    folder: Path,
    values: dict[str, Any],
    environment: dict[str, str],
    launches: Sequence[tuple[list[str], list[str]]],
) -> list[dict[str, Any]]:
    """Run the launchers until the last, with the programme, ends; then end the others."""
    started, logs = [], []
    for number, (words, nodes) in enumerate(launches):
        log = folder / f"log_{number}"
        log.mkdir()
        given = {"values": values, "nodes": nodes, "environment": environment, "log": str(log)}
        command = [*words, sys.executable, __file__, "--child", json.dumps(given)]
        with (log / "launcher.log").open("w", encoding="utf-8") as output:
            started.append(
                subprocess.Popen(command, stdout=output, stderr=output, env=dict(os.environ))
            )
        logs.append(log)
    try:
        started[-1].wait(timeout=RUN_LIMIT_S)
    except subprocess.TimeoutExpired:
        started[-1].send_signal(signal.SIGINT)
    for process in reversed(started):
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.wait(timeout=END_LIMIT_S)
    return [json.loads((log / "ended.json").read_text(encoding="utf-8")) for log in logs]


def line(name: str, row: dict[str, Any]) -> str:
    """One row of the table."""
    cells = ""
    for key, (_, factor, digits) in SHOWN.items():
        value = row.get(key)
        cells += f"{'-' if value is None else f'{factor * value:.{digits}f}':>12}"
    outcome = "completed" if row["completed"] else "stopped"
    why = f" ({row['bag']})" if "bag" in row else ""
    return f"{name:24}{cells}  {outcome}{why}" + ("" if row["as_expected"] else ": NOT as expected")


def _figures(bag: Path) -> dict[str, Any]:
    """Figures of the run; without a load only how it ended."""
    states = read_bag(bag, ["limb_state", "motor_current", "mode"])
    # No number before a limb's zero is known; it has none as long as nothing was pulled.
    tension = np.nan_to_num(states["limb_state"]["tension"], nan=0.0)
    currents = states["motor_current"]["current"] if "motor_current" in states else np.zeros((1, 1))
    row: dict[str, Any] = {
        "last_current_a": float(np.abs(currents[-1]).max()),
        "last_tension_n": float(tension[-1].max()),
        "highest_tension_n": float(tension.max()),
    }
    if not (states["mode"]["mode"] == 2).any():
        return row
    summary = summarise(load_run(bag), load_rig())
    row.update({name: summary[name] for name in SHOWN if name in summary})
    return row


if __name__ == "__main__":
    sys.exit(main())
