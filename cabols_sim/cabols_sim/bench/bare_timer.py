# SPDX-License-Identifier: Apache-2.0
"""A bare timer: waits for absolute instants, as the simulated card does, and does nothing else.

Run as a process of its own beside the demo: `python -m cabols_sim.bench.bare_timer --period-ns N
[--cpu CORE] [--fifo PRIORITY]`. On SIGTERM it prints one line of JSON with the missed instants.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

from cabols_control.run_report.judgement.computer import TimerRecord

END_S = 5.0


@dataclass
class Timers:
    """Timers that run beside something; `records` is filled when they have ended.

    Attributes:
        records: the bridge's core first.
    """

    records: list[TimerRecord] = field(default_factory=list)


@contextmanager
def bare_timers(asked: Mapping[str, int], speed: float) -> Iterator[Timers]:
    """Run a timer on each core of the control path while the body runs.

    Args:
        asked: of the kernel, as real_time_arguments(). The timers go before the loop's own work on
            their cores: what holds them up is never the loop.
        speed: of the rig's time; a period lasts its inverse times as long on the computer's clock.
    """
    cores = [asked.get("cpu", -1)]
    if asked.get("other_cpu", -1) >= 0:
        cores.append(asked["other_cpu"])
    priority = asked.get("fifo_priority", 0)
    found = Timers()
    processes = [_start(core, priority + 1 if priority else 0, speed) for core in cores]
    try:
        yield found
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            with suppress(subprocess.TimeoutExpired, ValueError):
                text = process.communicate(timeout=END_S)[0]
                last = text.strip().rpartition("\n")[2]
                found.records.append(TimerRecord.from_mapping(json.loads(last)))
            process.kill()


def _start(core: int, priority: int, speed: float) -> subprocess.Popen[str]:
    period = ["--period-ns", str(round(1e6 / speed))]
    return subprocess.Popen(
        [
            *(sys.executable, "-m", "cabols_sim.bench.bare_timer", *period),
            *("--cpu", str(core), "--fifo", str(priority)),
        ],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        # A Ctrl-C of the terminal is for the demo, which ends its timers.
        start_new_session=True,
    )


class _Ended(BaseException):
    """SIGTERM came."""


def run_timer(period_ns: int) -> dict[str, object]:
    """Sleep from instant to instant until SIGTERM; return what was missed."""

    def end(*_: object) -> None:
        raise _Ended

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = os.getppid()
    epoch_ns, origin = time.time_ns(), time.monotonic_ns()
    misses: list[tuple[int, int]] = []
    tick = 0
    with suppress(_Ended):
        while os.getppid() == parent:
            tick += 1
            due = origin + tick * period_ns
            remaining = due - time.monotonic_ns()
            if remaining > 0:
                time.sleep(1e-9 * remaining)
            behind = time.monotonic_ns() - due
            if behind > period_ns // 2:
                misses.append((epoch_ns + due - origin, behind))
                tick += behind // period_ns
    end_ns = epoch_ns + time.monotonic_ns() - origin
    return {"period_ns": period_ns, "begin_ns": epoch_ns, "end_ns": end_ns, "misses": misses}


def main() -> int:
    """Run one timer."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--period-ns", type=int, default=1_000_000)
    parser.add_argument("--cpu", type=int, default=-1, help="core; -1: any")
    parser.add_argument("--fifo", type=int, default=0, help="SCHED_FIFO priority; 0: none")
    options = parser.parse_args()
    if options.cpu >= 0:
        os.sched_setaffinity(0, {options.cpu})
    if options.fifo > 0:
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(options.fifo))
    print("ready", flush=True)
    print(json.dumps(run_timer(options.period_ns)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
