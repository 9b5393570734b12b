# SPDX-License-Identifier: Apache-2.0
"""What a kernel gives a control loop of 1 kHz, and what is to be set where it gives too little."""

from __future__ import annotations

import os
import resource
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cabols_control.realtime.scheduling import PM_QOS, may_limit_wake_up, may_use_fifo

PERIOD_NS = 1_000_000
"""Of the control loop."""
LATE_NS = 200_000
"""Lateness of a bare timer that leaves the loop no budget: see docs/architecture.md."""
LOST_SHARE = 1e-4
"""Share of cycles that a bare timer may lose on a machine for a rig."""
WANTED_PRIORITY = 60
TIMES = ("user", "nice", "system", "idle", "iowait", "irq", "softirq", "steal")
"""Of the row `cpu` of /proc/stat, in its order."""
LOCKED_BYTES = 1 << 30


@dataclass(frozen=True)
class Facts:
    """What a machine says of itself.

    Attributes:
        release: of the kernel.
        preempt_rt: whether the kernel is PREEMPT_RT.
        cores: that this process may use.
        isolated: cores that the kernel keeps other work off.
        fifo: whether this process may use SCHED_FIFO.
        locked_bytes: memory that it may lock; -1: any.
        wake_up: whether it may limit the cores' wake-up time.
        throttle_us: of each second that real-time threads may use [us]; -1: all of it.
        governors: of the cores' frequency; empty: the machine does not say.
        clock: source of the kernel's clock.
        virtual: whether it is a virtual machine.
    """

    release: str
    preempt_rt: bool
    cores: int
    isolated: str
    fifo: bool
    locked_bytes: int
    wake_up: bool
    throttle_us: int
    governors: tuple[str, ...]
    clock: str
    virtual: bool


@dataclass(frozen=True)
class TimerRun:
    """How late a bare timer of the loop's period woke.

    Attributes:
        fifo: whether in the real-time class.
        cycles: number of them.
        median_us: lateness [us].
        p99_us: of the lateness [us].
        worst_us: likewise [us].
        lost: cycles that began after the next one's time.
    """

    fifo: bool
    cycles: int
    median_us: float
    p99_us: float
    worst_us: float
    lost: int


@dataclass(frozen=True)
class Finding:
    """One line of the answer.

    Attributes:
        subject: what was looked at.
        found: what there is.
        good: whether it is as a rig wants it.
        advice: what to set; empty if it is good.
    """

    subject: str
    found: str
    good: bool
    advice: str


def read_facts(root: Path = Path("/")) -> Facts:
    """Ask the machine.

    Args:
        root: above proc and sys, for tests.
    """
    cpu = root / "sys/devices/system/cpu"
    version = _text(root / "proc/version")
    governors = {_text(path) for path in cpu.glob("cpu[0-9]*/cpufreq/scaling_governor")}
    locked, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    throttle = _text(root / "proc/sys/kernel/sched_rt_runtime_us")
    return Facts(
        release=os.uname().release,
        preempt_rt=_text(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in version,
        cores=len(os.sched_getaffinity(0)),
        isolated=_text(cpu / "isolated"),
        fifo=may_use_fifo(),
        locked_bytes=locked,
        wake_up=may_limit_wake_up(),
        throttle_us=int(throttle) if throttle.lstrip("-").isdecimal() else -1,
        governors=tuple(sorted(governors)),
        clock=_text(root / "sys/devices/system/clocksource/clocksource0/current_clocksource"),
        virtual=" hypervisor " in f"{_text(root / 'proc/cpuinfo')} ".replace("\n", " "),
    )


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def run_timer(seconds: float, fifo: bool) -> TimerRun:
    """Let a bare timer of the loop's period run.

    Args:
        seconds: how long [s].
        fifo: whether in the real-time class.
    """
    late_ns = np.zeros(max(int(1e9 * seconds) // PERIOD_NS, 1), dtype=np.int64)

    def body() -> None:
        if fifo:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(WANTED_PRIORITY))
        due = time.monotonic_ns() + PERIOD_NS
        for index in range(late_ns.size):
            time.sleep(max(due - time.monotonic_ns(), 0) * 1e-9)
            late_ns[index] = time.monotonic_ns() - due
            due += PERIOD_NS

    thread = threading.Thread(target=body)
    thread.start()
    thread.join()
    late_us = 1e-3 * late_ns
    return TimerRun(
        fifo=fifo,
        cycles=int(late_ns.size),
        median_us=float(np.median(late_us)),
        p99_us=float(np.percentile(late_us, 99.0)),
        worst_us=float(late_us.max()),
        lost=int(np.count_nonzero(late_ns > PERIOD_NS)),
    )


def judge(facts: Facts, runs: Sequence[TimerRun], stolen: float) -> list[Finding]:
    """Say what is good for a rig, and what is to be set.

    Args:
        facts: of the machine.
        runs: of bare timers.
        stolen: share of the processors' time that other virtual machines took meanwhile.
    """
    found = [
        Finding(
            "kernel",
            f"{facts.release}, {'PREEMPT_RT' if facts.preempt_rt else 'not PREEMPT_RT'}",
            facts.preempt_rt,
            "for a rig install a PREEMPT_RT kernel (Ubuntu: `sudo pro enable realtime-kernel`; "
            "Debian: the package linux-image-rt-amd64)",
        ),
        Finding(
            "SCHED_FIFO",
            "allowed" if facts.fifo else "refused",
            facts.fifo,
            "add `USER - rtprio 99` to /etc/security/limits.conf and log in again; then "
            "fifo_priority:=50",
        ),
        Finding(
            "memory to lock",
            _memory(facts.locked_bytes),
            facts.locked_bytes < 0 or facts.locked_bytes >= LOCKED_BYTES,
            "add `USER - memlock unlimited` to /etc/security/limits.conf and log in again; then "
            "lock_memory:=true",
        ),
        Finding(
            "limit on wake-up times",
            "allowed" if facts.wake_up else "refused",
            facts.wake_up,
            f"give the user the right to write {PM_QOS} (a udev rule); then cpu_latency_us:=0",
        ),
        Finding(
            "real-time share",
            "all" if facts.throttle_us < 0 else f"{facts.throttle_us} us of each second",
            facts.throttle_us < 0 or facts.throttle_us >= 900_000,
            "sudo sysctl kernel.sched_rt_runtime_us=950000",
        ),
        Finding(
            "cores",
            f"{facts.cores}; isolated: {facts.isolated or 'none'}",
            facts.cores >= 2 and (bool(facts.isolated) or facts.cores >= 4),
            "use four cores, or keep other work off two of them (kernel parameters isolcpus, "
            "nohz_full, rcu_nocbs); then cpu:= and other_cpu:=",
        ),
        Finding(
            "frequency",
            ", ".join(facts.governors) or "not told",
            all(governor == "performance" for governor in facts.governors),
            "sudo cpupower frequency-set -g performance",
        ),
        Finding(
            "clock",
            facts.clock or "not told",
            facts.clock in ("tsc", "kvm-clock", "arch_sys_counter", ""),
            "boot with clocksource=tsc if the processor's counter is constant: others cost "
            "microseconds a reading",
        ),
        Finding(
            "machine",
            f"virtual, {100.0 * stolen:.1f} % stolen" if facts.virtual else "not virtual",
            not facts.virtual and not stolen > 0.0,
            "run a rig on a machine of its own: another guest may take the processor at any time",
        ),
    ]
    return found + [_judge_run(run) for run in runs]


def _judge_run(run: TimerRun) -> Finding:
    share = run.lost / run.cycles
    return Finding(
        f"bare timer, {'SCHED_FIFO' if run.fifo else 'ordinary'}",
        f"late by {run.median_us:.0f} / {run.p99_us:.0f} / {run.worst_us:.0f} us "
        f"(median, 99 %, worst), lost {run.lost} of {run.cycles} cycles",
        1e3 * run.p99_us <= LATE_NS and share <= LOST_SHARE,
        "the loop cannot be better than this: see to the lines above, and to what else runs",
    )


def _memory(count: int) -> str:
    return "any" if count < 0 else f"{count / (1 << 20):.0f} MiB"


def stolen_share(before: str, after: str) -> float:
    """Share of the processors' time between two readings of /proc/stat that other guests took.

    Args:
        before: first line of the file.
        after: the same, later.
    """
    first, second = (_processor_times(line) for line in (before, after))
    spent = {name: second[name] - first.get(name, 0.0) for name in second}
    total = sum(spent.values())
    return spent.get("steal", 0.0) / total if total > 0.0 else 0.0


def _processor_times(row: str) -> dict[str, float]:
    """Times of the row `cpu` of /proc/stat by name (proc_stat(5)); guests' are in user's."""
    _, *times = row.split()
    return {name: float(value) for name, value in zip(TIMES, times, strict=False)}
