# SPDX-License-Identifier: Apache-2.0
"""The simulated tracker's observation of the rig: a thread that runs without pause."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from cabols_control.checks import FloatArray
from cabols_sim.devices.tracker.model import Loss, TrackerModel

_IDLE_PERIOD_S = 0.005
_BUSY_PERIOD_S = 0.001


class Truth(Protocol):
    """Source of the platform's true motion."""

    def newest(self) -> Any:
        """Newest record: time_ns, position (3,) [m], rotation (3, 3), speed [m/s], beam_blocked.

        Platform in the rig's base frame; None if the rig does not run.
        """


class Watch:
    """Feeds the truth to the model at all times: the beam also breaks between measurements.

    Attributes:
        model: touched with `news` held, only.
        news: notified at each look at a new truth.
        path: (time_ns, point) of the locked reflector since someone made it a list of one.
        fault: what went wrong at the newest look, or empty.
        ready: whether the rig runs.
        stopping: ends the thread.
        hurry: look more often, as a call is under way.
    """

    def __init__(self, truth: Truth, model: TrackerModel) -> None:
        self.model = model
        self.news = threading.Condition()
        self.path: list[tuple[int, FloatArray]] | None = None
        self.fault = ""
        self.ready = False
        self.stopping = threading.Event()
        self.hurry = threading.Event()
        self._truth = truth
        self._seen_ns: int | None = None
        self._thread = threading.Thread(target=self._run, name="tracker-watch", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread and all waits."""
        self.stopping.set()
        with self.news:
            self.news.notify_all()
        if self._thread.ident is not None:
            self._thread.join(1.0)

    def _run(self) -> None:
        while not self.stopping.wait(_BUSY_PERIOD_S if self.hurry.is_set() else _IDLE_PERIOD_S):
            self._look_safely()

    def _look_safely(self) -> None:
        try:
            self._look()
        except Exception as error:  # any error: without the thread the beam would never break
            with self.news:
                self.fault = f"{type(error).__name__}: {error}"
                self.model.locked, self.model.loss = None, Loss.UNKNOWN
                self.news.notify_all()

    def _look(self) -> None:
        record = self._truth.newest()
        with self.news:
            self.ready, self.fault = record is not None, ""
            if record is None:
                return
            time_ns, blocked = int(record["time_ns"]), bool(record["beam_blocked"])
            if time_ns == self._seen_ns and not blocked:
                return
            self._seen_ns = time_ns
            self.model.observe(
                time_ns,
                np.array(record["position"]),
                np.array(record["rotation"]),
                float(record["speed"]),
                blocked,
            )
            path = self.path
            if path is not None and self.model.locked is not None and time_ns > path[-1][0]:
                path.append((time_ns, self.model.point()))
            self.news.notify_all()

    def wait(self, done: Callable[[], bool], until: float, context: Any) -> bool:
        """Wait, with `news` held, which is released meanwhile.

        Args:
            done: what is waited for; asked at each news, at least ten times a second.
            until: when to give up, as time.monotonic() [s].
            context: gRPC's, of the call that waits; ends the wait when the caller has gone.

        Returns:
            Whether it is done; False if time, caller or thread ended first.
        """
        while not done():
            left = until - time.monotonic()
            if not left > 0.0 or self.stopping.is_set() or not context.is_active():
                return False
            self.news.wait(min(left, 0.1))
        return True
