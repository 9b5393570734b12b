# SPDX-License-Identifier: Apache-2.0
"""The control loop in real time: delay, late and lost cycles, CPU, beside two yardsticks.

The graph runs twice: with a rigid target, and with all bridges (robot and tracker on simulated
devices), with what real_time_arguments() gets from the kernel. The yardsticks (a plain rclpy
executor echo pair, a bare 1 kHz timer) run before, between and after on the same machine, as any
program runs; their figures are pooled. Beside them, for comparison and not for the targets, the
same two with SCHED_FIFO and cores that do not sleep.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from record import write_figures

from cabols_control.bags.reader import read_bag
from cabols_control.files.output_folder import claim
from cabols_control.realtime.scheduling import PM_QOS
from cabols_sim.bench.run import isolated_environment, real_time_arguments, run_bench

CONTROL_TOPICS = ("limb_state", "wrench", "motor_current", "tension_command", "desired_wrench")
LOOPS = ("plant", "wrench_controller", "limb_controller")
ROBOT_TOPICS = ("platform_pose", "joint_states")
GRAPHS = {"rigid_target": False, "all_bridges": True}
"""Name of a run: whether robot and tracker are in it."""
YARDSTICKS = (sys.executable, str(Path(__file__).with_name("yardsticks.py")))


def main() -> int:
    """Run, print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/realtime.json"))
    parser.add_argument("--seconds", type=float, default=60.0, help="of each graph")
    parser.add_argument("--yardstick-seconds", type=float, default=10.0, help="of each, thrice")
    parser.add_argument("--plain", action="store_true", help="ask the kernel for nothing")
    arguments = parser.parse_args()
    environment = isolated_environment()
    folder = arguments.output.parent / "realtime"
    claimed = claim(folder, "bench_realtime")
    asked = {} if arguments.plain else real_time_arguments()
    yardsticks = [Yardsticks(environment, arguments.yardstick_seconds, {})]
    if asked:
        yardsticks.append(Yardsticks(environment, arguments.yardstick_seconds, asked))
    runs = {}
    measure(yardsticks)
    for name, robot in GRAPHS.items():
        words = name.replace("_", " ")
        print(f"graph: {words}, with recorder, {arguments.seconds:.0f} s", flush=True)
        values = {"robot": robot, **asked}
        runs[name] = _graph(folder / name, environment, arguments.seconds, values)
        measure(yardsticks)
    claimed.finish()
    yard = yardsticks[0].figures()
    figures = {
        "asked_of_the_kernel": asked,
        **yard,
        "yardsticks_alike": yardsticks[-1].figures(),
        **{name: _figures(run, yard, GRAPHS[name]) for name, run in runs.items()},
    }
    write_figures(arguments.output, figures)
    print(_table(figures))
    return 0


class Yardsticks:
    """Echo pair and bare timer, run a few times with the same scheduling.

    Attributes:
        asked: what they ask of the kernel, as in real_time_arguments(); cores are left to it.
    """

    def __init__(self, environment: dict[str, str], seconds: float, asked: dict[str, int]) -> None:
        self._environment = {**os.environ, **environment}
        self._seconds = seconds
        self._fifo = asked.get("fifo_priority", 0)
        self._latency = asked.get("cpu_latency_us", -1)
        self.asked = asked
        self._echoes: list[dict[str, float]] = []
        self._timers: list[dict[str, float]] = []

    def measure(self) -> None:
        """Run both once."""
        how = (self._environment, self._seconds, self._fifo)
        with _awake(self._latency):
            self._timers.append(_yardstick("timer", *how))
            self._echoes.append(echo_pair(*how))

    def figures(self) -> dict[str, float]:
        """Pool the runs."""
        echoes, timers = self._echoes, self._timers
        return {
            "echo_median_s": float(np.median([e["round_trip_median_s"] for e in echoes])),
            "echo_p99_s": float(np.median([e["round_trip_p99_s"] for e in echoes])),
            "timer_late_percent": float(np.mean([t["late_percent"] for t in timers])),
            "timer_behind_median_s": float(np.median([t["behind_median_s"] for t in timers])),
        }


@contextmanager
def _awake(latency_us: int) -> Iterator[None]:
    """Limit the cores' wake-up time; -1 leaves it."""
    if latency_us < 0:
        yield
        return
    with PM_QOS.open("wb", buffering=0) as limit:
        limit.write(struct.pack("i", latency_us))
        yield


def measure(yardsticks: list[Yardsticks]) -> None:
    """Run all yardsticks once."""
    for item in yardsticks:
        how = "asking the kernel for the same as the graph" if item.asked else "plain"
        print(f"yardsticks: bare timer and echo pair, {how}", flush=True)
        item.measure()


def echo_pair(environment: dict[str, str], seconds: float, fifo: int = 0) -> dict[str, float]:
    """Measure a message's way to another process and back, by plain rclpy executors."""
    with subprocess.Popen([*YARDSTICKS, "echo", str(fifo)], env=environment) as partner:
        try:
            return _yardstick("ping", environment, seconds, fifo)
        finally:
            partner.send_signal(signal.SIGINT)


def _yardstick(
    kind: str, environment: dict[str, str], seconds: float, fifo: int
) -> dict[str, float]:
    command = [*YARDSTICKS, kind, str(seconds), str(fifo)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def _graph(
    folder: Path, environment: dict[str, str], seconds: float, chosen: dict[str, Any]
) -> dict[str, Any]:
    """Run a graph under load; return the bag's folder and CPU shares."""
    folder.mkdir()
    program = folder / "program.csv"
    rows = ["time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm"]
    for k in range(int(seconds * 20) + 1):
        t = k / 20
        wave = [
            a * np.sin(2 * np.pi * f * t)
            for a, f in zip(
                (30, 30, 40, 2.5, 2.5, 2.5), (0.1, 0.15, 0.2, 0.25, 0.3, 0.35), strict=True
            )
        ]
        rows.append(",".join(f"{x:.6f}" for x in (t, *wave)))
    program.write_text("\n".join(rows) + "\n", encoding="utf-8")
    cpu: dict[str, float] = {}
    lines: list[str] = []
    values = {
        "auto_start": True,
        "program": str(program),
        "exit_when_done": True,
        "output": str(folder / "bag"),
        # So that a stall of the machine is counted instead of ending the run.
        "watchdog": 0.1,
        "command_timeout": 0.1,
        "stale_after": 0.2,
        **chosen,
    }

    def watch(pids: dict[str, int]) -> None:
        threading.Thread(target=_watch_cpu, args=(pids, cpu, seconds), daemon=True).start()

    ended = run_bench(
        values,
        lambda node, line: lines.append(f"{node}: {line}"),
        folder / "log",
        environment,
        watch,
    )
    if (ended.first, ended.code) != ("load_program", 0):
        print("\n".join(lines[-20:]))
        raise SystemExit(f"the graph ended early: {ended}")
    return {"bag": folder / "bag", "cpu": cpu}


def _watch_cpu(pids: dict[str, int], cpu: dict[str, float], seconds: float) -> None:
    """Measure each node's CPU share between 10 s after start and 5 s before the end."""
    time.sleep(10.0)
    processes = {name: psutil.Process(pid) for name, pid in pids.items()}
    first = {name: sum(p.cpu_times()[:2]) for name, p in processes.items()}
    began = time.monotonic()
    time.sleep(max(seconds - 10.0, 5.0))
    span = time.monotonic() - began
    for name, process in processes.items():
        cpu[name] = 100.0 * (sum(process.cpu_times()[:2]) - first[name]) / span


def _figures(graph: dict[str, Any], yard: dict[str, float], robot: bool) -> dict[str, Any]:
    topics = CONTROL_TOPICS + (ROBOT_TOPICS if robot else ROBOT_TOPICS[:1])
    bag = read_bag(graph["bag"], (*topics, "mode", "loop_status"))
    loading = bag["mode"].stamp_ns[bag["mode"]["mode"] == 2].min()
    status = bag["loop_status"]
    plant = (np.array(status["node"]) == "plant") & (status.stamp_ns > loading + 2e9)
    trip, trip_p99 = status["round_trip"][plant], status["round_trip_p99"][plant]
    late, cycles = status["late"][plant], status["cycles"][plant]
    span = bag["limb_state"].stamp_ns >= loading
    sequence = bag["limb_state"]["sequence"][span]
    answered = bag["motor_current"]["sequence"]
    answered = answered[(answered >= sequence[0]) & (answered <= sequence[-1])]
    tension = bag["tension_command"]["sequence"]
    tension = tension[(tension >= sequence[0]) & (tension <= sequence[-1])]
    missing = int(sequence[-1] - sequence[0] + 1 - sequence.size)
    late_percent = float(100.0 * (late[-1] - late[0]) / (cycles[-1] - cycles[0]))
    ratio = float(np.median(trip)) / yard["echo_median_s"]
    found = {
        "round_trip_median_s": float(np.median(trip)),
        "round_trip_p99_s": float(np.median(trip_p99)),
        "round_trip_over_echo": ratio,
        "round_trip_target": 0.5,
        "round_trip_met": ratio <= 0.5,
        "late_percent": late_percent,
        "late_met": late_percent <= yard["timer_late_percent"] + 0.5,
        "cycles": int(sequence.size),
        "states_missing_in_bag": missing,
        "answers_missing_in_bag": int(sequence.size - np.unique(answered).size),
        "tension_commands_missing_in_bag": int(sequence.size - np.unique(tension).size),
        "recorder_lost": {name: _gaps(bag[name].sequence) for name in topics},
        "work": _work(status, loading),
        "cpu_percent": {name: round(value, 1) for name, value in graph["cpu"].items()},
    }
    if robot:
        stream = np.flatnonzero(np.array(status["node"]) == "abb_tracker_bridge")[-1]
        found["egm_packets_lost"] = int(status["lost"][stream])
        found["egm_packets_late"] = int(status["late"][stream])
        found["poses"] = int(bag["platform_pose"].stamp_ns.size)
    return found


def _work(status: Any, loading: int) -> dict[str, dict[str, float]]:
    """Each control loop's working time in a cycle, without waiting, while the rig is loaded."""
    nodes = np.array(status["node"])
    found = {}
    for name in LOOPS:
        rows = (nodes == name) & (status.stamp_ns > loading + 2e9)
        found[name] = {
            "median_s": float(np.median(status["work_time"][rows])),
            "p99_s": float(np.median(status["work_time_p99"][rows])),
        }
    return found


def _gaps(sequence: np.ndarray) -> int:
    """Publications (by DDS' own count) between the first and the last that are not in the bag."""
    return int(sequence[-1] - sequence[0] + 1 - sequence.size)


def _table(f: dict[str, Any]) -> str:
    """Both runs side by side, beside the yardsticks."""
    runs = [f[name] for name in GRAPHS]

    def met(run: dict[str, Any], key: str) -> str:
        return "met" if run[key] else "NOT met"

    def row(label: str, cell: Callable[[dict[str, Any]], str], yard: str = "") -> str:
        return f"{label:34}" + "".join(f"{cell(run):>22}" for run in runs) + f"{yard:>24}"

    alike = f["yardsticks_alike"]

    def yards(key: str, factor: float, digits: int) -> str:
        return f"{factor * f[key]:.{digits}f} / {factor * alike[key]:.{digits}f}"

    lines = [
        f"{'':34}"
        + "".join(f"{name.replace('_', ' '):>22}" for name in GRAPHS)
        + f"{'yard, plain / alike':>24}",
        row(
            "round trip, median [us]",
            lambda r: f"{1e6 * r['round_trip_median_s']:.0f}",
            f"echo {yards('echo_median_s', 1e6, 0)}",
        ),
        row(
            "round trip, p99 [us]",
            lambda r: f"{1e6 * r['round_trip_p99_s']:.0f}",
            f"echo {yards('echo_p99_s', 1e6, 0)}",
        ),
        row(
            "median over echo's (target 0.50)",
            lambda r: f"{r['round_trip_over_echo']:.2f} {met(r, 'round_trip_met')}",
        ),
        row(
            "late [%] (target yard + 0.5)",
            lambda r: f"{r['late_percent']:.2f} {met(r, 'late_met')}",
            f"timer {yards('timer_late_percent', 1.0, 2)}",
        ),
        row("cycles", lambda r: str(r["cycles"])),
        row("not in the bag: states", lambda r: str(r["states_missing_in_bag"])),
        row("  motor currents", lambda r: str(r["answers_missing_in_bag"])),
        row("  tension commands", lambda r: str(r["tension_commands_missing_in_bag"])),
    ]
    lines += [
        row(f"lost by recorder: {topic}", lambda r, t=topic: str(r["recorder_lost"].get(t, "-")))
        for topic in CONTROL_TOPICS + ROBOT_TOPICS
    ]
    for name in ("egm_packets_lost", "egm_packets_late"):
        lines.append(row(name.replace("_", " "), lambda r, n=name: str(r.get(n, "-"))))
    lines += [
        row(f"CPU [%]: {node}", lambda r, n=node: str(r["cpu_percent"].get(n, "-")))
        for node in runs[-1]["cpu_percent"]
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
