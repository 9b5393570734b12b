# SPDX-License-Identifier: Apache-2.0
"""Both laws in one process against separate processes: the round trip, and the tensions' age.

The graph of `bench-realtime` runs in turn with limb and wrench controller as separate processes and
in one (one_process_laws.py), the limbs' law first or the wrench law first. Finished runs are kept:
another call goes on where it was; --fresh begins anew.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

import bench_realtime
import numpy as np
from one_process_laws import LIMBS_FIRST, ORDER, WRENCH_FIRST
from record import write_figures

from cabols_control.bags.reader import read_bag
from cabols_sim.bench.run import isolated_environment, real_time_arguments, run_bench
from cabols_sim.bringup_nodes import bench_graph
from line_journal import LineJournal

FOLDER = Path("build/bench/one_process")
SEPARATE = "separate"
KINDS = (SEPARATE, LIMBS_FIRST, WRENCH_FIRST)
WORDS = {
    SEPARATE: "separate processes",
    LIMBS_FIRST: "one process, limbs first",
    WRENCH_FIRST: "one process, wrench first",
}
LAWS = Path(__file__).with_name("one_process_laws.py")
STAND_IN = ("one_process", "laws")
SETTLE_NS = 2_000_000_000
"""From the beginning of LOADING to the first cycle that counts [ns]."""


def one_run(kind, robot, seconds):
    """Run the graph once; return its figures."""
    folder = FOLDER / "run"
    shutil.rmtree(folder, ignore_errors=True)
    environment = isolated_environment()
    values = {"robot": robot, **real_time_arguments()}
    stand_ins = {}
    if kind != SEPARATE:
        environment[ORDER] = kind
        names = [node.executable for node in bench_graph(robot=robot)]
        values["nodes"] = ",".join(name for name in names if name != "wrench_controller")
        stand_ins = {"limb_controller": STAND_IN}

    def run(*arguments):
        return run_bench(*arguments, stand_ins=stand_ins)

    bench_realtime.run_bench = run
    graph = bench_realtime._graph(folder, environment, seconds, values)
    bag = read_bag(graph["bag"], ("mode", "loop_status", "motor_current"))
    begin = bag["mode"].stamp_ns[bag["mode"]["mode"] == 2].min() + SETTLE_NS
    status, current = bag["loop_status"], bag["motor_current"]
    plant = (np.array(status["node"]) == "plant") & (status.stamp_ns > begin)
    used = current.stamp_ns > begin
    age = current["sequence"][used].astype(int) - current["tension_sequence"][used].astype(int)
    lost, cycles = status["lost"][plant], status["cycles"][plant]
    return {
        "median_s": float(np.median(status["round_trip"][plant])),
        "p99_s": float(np.median(status["round_trip_p99"][plant])),
        "lost_percent": 100.0 * float(lost[-1] - lost[0]) / float(cycles[-1] - cycles[0]),
        "tensions_behind": float(np.median(age)),
    }


def install_stand_in():
    """Let the process of both laws be found where executables are looked for."""
    prefix = FOLDER.absolute() / "prefix"
    path = prefix / "lib" / STAND_IN[0] / STAND_IN[1]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'#!/bin/sh\nexec {sys.executable} {LAWS} "$@"\n')
    path.chmod(0o755)
    there = os.environ.get("AMENT_PREFIX_PATH") or sys.prefix
    os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join([str(prefix), there])


def main() -> int:
    """Run what is missing; print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each run")
    parser.add_argument("--short", action="store_true", help="one round of 8 s")
    parser.add_argument("--fresh", action="store_true", help="forget the runs that there are")
    arguments = parser.parse_args()
    rounds, seconds = (1, 8.0) if arguments.short else (arguments.rounds, arguments.seconds)
    journal = LineJournal(FOLDER / "runs.jsonl", fresh=arguments.fresh)
    install_stand_in()
    rows = {}
    for number in range(rounds):
        for robot in (False, True):
            for kind in KINDS:
                key = f"{kind}, robot {robot}, {seconds:g} s, round {number + 1}"
                if key not in journal.found:
                    journal.add(key, **one_run(kind, robot, seconds))
                rows.setdefault((robot, kind), []).append(journal.found[key])
                print(key, {k: v for k, v in journal.found[key].items() if k != "key"}, flush=True)
    figures = {}
    for robot in (False, True):
        print("all bridges" if robot else "rigid target")
        for kind in KINDS:
            found = {
                name: float(np.median([row[name] for row in rows[robot, kind]]))
                for name in ("median_s", "p99_s", "lost_percent", "tensions_behind")
            }
            figures[f"{'all_bridges' if robot else 'rigid_target'}, {WORDS[kind]}"] = found
            print(
                f"  {WORDS[kind]:28} {1e6 * found['median_s']:5.0f} us, p99 "
                f"{1e6 * found['p99_s']:5.0f} us, {found['tensions_behind']:.0f} samples behind"
            )
    write_figures(FOLDER.parent / "one_process.json", figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
