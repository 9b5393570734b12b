# SPDX-License-Identifier: Apache-2.0
"""How long a busy machine has kept a bare timer waiting: no verdict on software counts that."""

from __future__ import annotations

import threading
import time

TICK_S = 0.005
ORDINARY_S = 0.001
"""Lateness of a sleep on an idle machine."""


class Stalls:
    """Sums up the lateness of a timer that does nothing else; as a context manager.

    A bound on a duration holds for what was measured less `total_s`: while this timer did not get a
    core, the process under test did not get one either.
    """

    def __init__(self):
        self.total_s = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._tick, daemon=True)

    def _tick(self):
        before = time.monotonic()
        while not self._over.wait(TICK_S):
            now = time.monotonic()
            self.total_s += max(now - before - TICK_S - ORDINARY_S, 0.0)
            before = now

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()
