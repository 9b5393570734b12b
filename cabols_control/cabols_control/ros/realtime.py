"""Scheduling of a control process: real-time class, memory, core, garbage; by parameter."""

from __future__ import annotations

import ctypes
import gc
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

MCL_CURRENT_AND_FUTURE = 3


@dataclass(frozen=True)
class Scheduling:
    """What a control process asks of the kernel.

    Attributes:
        fifo_priority: SCHED_FIFO priority of all the process' threads, 1 to 99; 0 leaves them.
        lock_memory: whether to lock all pages.
        cpu: core to run on; -1 for any.
    """

    fifo_priority: int = 0
    lock_memory: bool = False
    cpu: int = -1


def apply_scheduling(wanted: Scheduling, warn: Callable[[str], object]) -> None:
    """Ask the kernel; where it refuses, warn with what would allow it and go on.

    All threads are set, as the middleware's receive threads sit in the way of every sample.
    """
    if wanted.cpu >= 0:
        _for_all_threads(
            lambda tid: os.sched_setaffinity(tid, {wanted.cpu}), f"cpu {wanted.cpu}", warn
        )
    if wanted.fifo_priority > 0:
        parameter = os.sched_param(wanted.fifo_priority)
        _for_all_threads(
            lambda tid: os.sched_setscheduler(tid, os.SCHED_FIFO, parameter),
            f"SCHED_FIFO {wanted.fifo_priority} (allow it with `ulimit -r 99` or rtprio in "
            "/etc/security/limits.conf)",
            warn,
        )
    if wanted.lock_memory:
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.mlockall(MCL_CURRENT_AND_FUTURE) != 0:
            reason = os.strerror(ctypes.get_errno())
            warn(f"memory not locked ({reason}): allow it with `ulimit -l unlimited`")


def _for_all_threads(
    action: Callable[[int], object], what: str, warn: Callable[[str], object]
) -> None:
    threads = [int(path.name) for path in Path("/proc/self/task").iterdir()]
    try:
        for tid in threads:
            # A thread may have ended since.
            with suppress(ProcessLookupError):
                action(tid)
    except OSError as error:
        warn(f"not granted: {what}: {error.strerror}")


def freeze_garbage() -> None:
    """Collect once, then keep the collector from scanning or running while the loop works."""
    gc.collect()
    gc.freeze()
    gc.disable()


def collect_young() -> None:
    """Collect what the last cycles left; cheap, as everything older is frozen."""
    gc.collect(0)
