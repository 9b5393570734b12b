"""The control loop in real time: delay, late and lost cycles, CPU, beside two yardsticks.

The graph runs twice: with a rigid target, and with all bridges (robot and tracker on simulated
devices). The yardsticks (a plain rclpy executor echo pair, a bare 1 kHz timer) run before, between
and after on the same machine with the same scheduling class; their figures are pooled.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from cabols_control.bags.reader import read_bag
from cabols_sim.bench_run import isolated_environment, run_bench, two_cores

CONTROL_TOPICS = ("limb_state", "wrench", "motor_current", "tension_command", "desired_wrench")
ROBOT_TOPICS = ("platform_pose", "joint_states")
GRAPHS = {"rigid_target": False, "all_bridges": True}
"""Name of a run: whether robot and tracker are in it."""
YARDSTICKS = Path(__file__).with_name("yardsticks.py")


def main() -> int:
    """Run, print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/realtime.json"))
    parser.add_argument("--seconds", type=float, default=60.0, help="of each graph")
    parser.add_argument("--yardstick-seconds", type=float, default=10.0, help="of each, thrice")
    parser.add_argument("--any-core", action="store_true", help="do not give cores to the nodes")
    parser.add_argument("--fifo-priority", type=int, default=0, help="SCHED_FIFO; 0 for none")
    arguments = parser.parse_args()
    environment = isolated_environment()
    folder = arguments.output.parent / "realtime"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    fifo, short = arguments.fifo_priority, arguments.yardstick_seconds
    cores = {} if arguments.any_core else two_cores()
    echoes: list[Any] = []
    timers: list[Any] = []
    runs = {}
    _measure(echoes, timers, environment, short, fifo)
    for name, robot in GRAPHS.items():
        words = name.replace("_", " ")
        print(f"graph: {words}, with recorder, {arguments.seconds:.0f} s", flush=True)
        values = {"robot": robot, "fifo_priority": fifo, **cores}
        runs[name] = _graph(folder / name, environment, arguments.seconds, values)
        _measure(echoes, timers, environment, short, fifo)
    yard = _yard(echoes, timers)
    figures = {
        "fifo_priority": fifo,
        **yard,
        **{name: _figures(run, yard, GRAPHS[name]) for name, run in runs.items()},
    }
    arguments.output.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    print(_table(figures))
    return 0


def _measure(
    echoes: list[Any], timers: list[Any], environment: dict[str, str], seconds: float, fifo: int
) -> None:
    print(f"yardsticks: bare timer and echo pair, {seconds:.0f} s each", flush=True)
    python = [sys.executable, str(YARDSTICKS)]
    arguments = [str(seconds), str(fifo)]
    where = {**os.environ, **environment}
    timers.append(_json([*python, "timer", *arguments], where))
    with subprocess.Popen([*python, "echo", str(fifo)], env=where) as partner:
        try:
            echoes.append(_json([*python, "ping", *arguments], where))
        finally:
            partner.send_signal(signal.SIGINT)


def _json(command: list[str], environment: dict[str, str]) -> dict[str, float]:
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


def _yard(echoes: list[dict[str, float]], timers: list[dict[str, float]]) -> dict[str, float]:
    return {
        "echo_median_s": float(np.median([e["round_trip_median_s"] for e in echoes])),
        "echo_p99_s": float(np.median([e["round_trip_p99_s"] for e in echoes])),
        "timer_late_percent": float(np.mean([t["late_percent"] for t in timers])),
        "timer_behind_median_s": float(np.median([t["behind_median_s"] for t in timers])),
    }


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
        "cpu_percent": {name: round(value, 1) for name, value in graph["cpu"].items()},
    }
    if robot:
        stream = np.flatnonzero(np.array(status["node"]) == "abb_tracker_bridge")[-1]
        found["egm_packets_lost"] = int(status["lost"][stream])
        found["egm_packets_late"] = int(status["late"][stream])
        found["poses"] = int(bag["platform_pose"].stamp_ns.size)
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

    lines = [
        f"{'':34}" + "".join(f"{name.replace('_', ' '):>22}" for name in GRAPHS) + f"{'yard':>24}",
        row(
            "round trip, median [us]",
            lambda r: f"{1e6 * r['round_trip_median_s']:.0f}",
            f"echo pair {1e6 * f['echo_median_s']:.0f}",
        ),
        row(
            "round trip, p99 [us]",
            lambda r: f"{1e6 * r['round_trip_p99_s']:.0f}",
            f"echo pair {1e6 * f['echo_p99_s']:.0f}",
        ),
        row(
            "median over echo's (target 0.50)",
            lambda r: f"{r['round_trip_over_echo']:.2f} {met(r, 'round_trip_met')}",
        ),
        row(
            "late cycles [%] (target yard + 0.5)",
            lambda r: f"{r['late_percent']:.2f} {met(r, 'late_met')}",
            f"bare timer {f['timer_late_percent']:.2f}",
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
