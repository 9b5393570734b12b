# SPDX-License-Identifier: Apache-2.0
"""A controller's cycle: a thread that acts on each new truth of the plant."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from cabols_sim.devices.link import DeviceLink

WAIT_S = 0.1


class TruthThread:
    """Calls a function with every newest truth."""

    def __init__(self, link: DeviceLink, on_truth: Callable[[Any], object], name: str) -> None:
        """Prepare; start() begins.

        Args:
            link: to the plant.
            on_truth: called with each new DEVICE_TRUTH record, in the thread.
            name: of the thread.
        """
        self._link, self._on_truth = link, on_truth
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, within a second."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=1.0)

    def _run(self) -> None:
        sequence = 0
        while not self._stop.is_set():
            truth = self._link.wait(sequence, WAIT_S)
            if truth is None:
                continue
            sequence = int(truth["sequence"])
            self._on_truth(truth)
