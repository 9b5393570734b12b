# SPDX-License-Identifier: Apache-2.0
"""Scheduling of a control process: real-time class, memory, core, idle states; by parameter."""

from __future__ import annotations

import ctypes
import gc
import os
import struct
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

MCL_CURRENT_AND_FUTURE = 3
PM_QOS = Path("/dev/cpu_dma_latency")
"""File of the latency limit, which the kernel observes as long as the file is open."""


@dataclass(frozen=True)
class Scheduling:
    """Scheduling that a control process requests from the kernel.

    Attributes:
        fifo_priority: SCHED_FIFO priority of all the process' threads, 1 to 99; 0 leaves them.
        lock_memory: whether to lock all pages.
        cpu: core to run on; -1 for any.
        cpu_latency_us: how long a core may take to wake from an idle state [us]; 0: cores poll
            instead of sleeping, -1: as the machine is set.
    """

    fifo_priority: int = 0
    lock_memory: bool = False
    cpu: int = -1
    cpu_latency_us: int = -1


def apply_scheduling(scheduling: Scheduling, warn: Callable[[str], object]) -> None:
    """Request the scheduling; after a refusal warn with what would allow it, and continue.

    All threads are set, as the middleware's receive threads sit in the way of every sample.

    Args:
        scheduling: what to request from the kernel.
        warn: called with a line for each refusal.
    """
    if scheduling.cpu >= 0:
        _for_all_threads(
            lambda tid: os.sched_setaffinity(tid, {scheduling.cpu}), f"cpu {scheduling.cpu}", warn
        )
    if scheduling.fifo_priority > 0:
        parameter = os.sched_param(scheduling.fifo_priority)
        _for_all_threads(
            lambda tid: os.sched_setscheduler(tid, os.SCHED_FIFO, parameter),
            f"SCHED_FIFO {scheduling.fifo_priority} (allow it with `ulimit -r 99` or rtprio in "
            "/etc/security/limits.conf)",
            warn,
        )
    if scheduling.lock_memory:
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.mlockall(MCL_CURRENT_AND_FUTURE) != 0:
            reason = os.strerror(ctypes.get_errno())
            warn(f"memory not locked ({reason}): allow it with `ulimit -l unlimited`")
    if scheduling.cpu_latency_us >= 0:
        _limit_wake_up(scheduling.cpu_latency_us, warn)


def give_back() -> None:
    """Return all threads to the ordinary scheduling class.

    For the end of a process: taking it down costs up to half a second of a core, which others on
    that core still need.
    """
    ordinary = os.sched_param(0)
    _for_all_threads(
        lambda tid: os.sched_setscheduler(tid, os.SCHED_OTHER, ordinary), "", lambda _: None
    )


def be_ordinary() -> None:
    """Return the calling thread to the ordinary scheduling class."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def may_use_fifo() -> bool:
    """Whether the kernel allows this process SCHED_FIFO; tried in a thread that then ends."""
    granted = []

    def attempt() -> None:
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
            granted.append(True)

    thread = threading.Thread(target=attempt)
    thread.start()
    thread.join()
    return bool(granted)


def may_limit_wake_up() -> bool:
    """Whether this process may write the kernel's limit on wake-up times."""
    return os.access(PM_QOS, os.W_OK)


_held: list[int] = []
"""Descriptors of PM_QOS, open until the process ends."""


def _limit_wake_up(latency_us: int, warn: Callable[[str], object]) -> None:
    if _held:
        return
    try:
        descriptor = os.open(PM_QOS, os.O_WRONLY)
        os.write(descriptor, struct.pack("i", latency_us))
    except OSError as error:
        warn(f"not granted: {PM_QOS}: {error.strerror}; cores may sleep between samples")
    else:
        _held.append(descriptor)


def _for_all_threads(
    action: Callable[[int], object], what: str, warn: Callable[[str], object]
) -> None:
    threads = [int(path.name) for path in Path("/proc/self/task").iterdir()]
    try:
        for tid in threads:
            # A thread may have ended meanwhile.
            with suppress(ProcessLookupError):
                action(tid)
    except OSError as error:
        warn(f"not granted: {what}: {error.strerror}")


def freeze_garbage(goes_on: bool = False) -> None:
    """Collect once, then keep the collector from scanning what is loaded: that takes 60 ms.

    Args:
        goes_on: whether it collects by itself what comes later; else it is for collect_young.
    """
    gc.collect()
    gc.freeze()
    if not goes_on:
        gc.disable()


def collect_young() -> None:
    """Collect what the last cycles left; cheap, as everything older is frozen."""
    gc.collect(0)
