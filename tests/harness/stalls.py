# SPDX-License-Identifier: Apache-2.0
"""How long a busy machine has kept a bare timer waiting: no verdict on software counts that."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from pathlib import Path

TICK_S = 0.005
ORDINARY_S = 0.001
"""Lateness of a sleep on an idle machine."""


class Stalls:
    """Sums up the lateness of a timer that does nothing else; as a context manager.

    A bound on a duration holds for what was measured less `total_s`: while this timer did not get a
    core, the process under test did not get one either. A process that computes is kept longer than
    one that seldom wants a core: with its id, what its threads waited for a core counts where that
    is more.

    Args:
        pid: process under test, if it is another one.
    """

    def __init__(self, pid=None):
        self._ticks_s = 0.0
        self._pid = pid
        self._waited_ns = {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._tick, daemon=True)

    def _tick(self):
        before = time.monotonic()
        while not self._over.wait(TICK_S):
            now = time.monotonic()
            self._ticks_s += max(now - before - TICK_S - ORDINARY_S, 0.0)
            before = now
            if self._pid is not None:
                self._look()

    def _look(self):
        """Note what each thread has waited for a core since it was seen first (schedstat)."""
        with suppress(OSError):
            for task in Path(f"/proc/{self._pid}/task").iterdir():
                waited_ns = int((task / "schedstat").read_text().split()[1])
                first_ns, _ = self._waited_ns.setdefault(task.name, (waited_ns, waited_ns))
                self._waited_ns[task.name] = (first_ns, waited_ns)

    @property
    def total_s(self):
        """Seconds that do not count."""
        waited_ns = sum(last - first for first, last in self._waited_ns.values())
        return max(self._ticks_s, 1e-9 * waited_ns)

    def __enter__(self):
        if self._pid is not None:
            self._look()
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()
