"""When a process is asked to end: by a signal, or by the death of the process that launched it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from types import FrameType

from cabols_control.bringup.specs import LAUNCHER

END_LIMIT_S = 5.0
"""Longest time that a load may keep a process from ending [s]."""


class EndRequest:
    """Notes SIGINT, SIGTERM and a dead launcher; none of them ends the process by itself.

    A launcher that starts nodes as its own children names itself in the environment: its death is
    seen by the parent that a child then gets.
    """

    def __init__(self, early: Callable[[], object]) -> None:
        """Take over the signals.

        Args:
            early: called by a signal that comes before ready().
        """
        self._early = early
        self._ready = False
        self._since_s: float | None = None
        parent = os.getppid()
        named = os.environ.get(LAUNCHER, "") == str(parent)
        self._launcher = parent if named else 0
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._hear)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._note()
        if not self._ready:
            self._early()

    def _note(self) -> None:
        if self._since_s is None:
            self._since_s = time.monotonic()

    def ready(self) -> None:
        """From now on the caller looks at `asked`."""
        self._ready = True

    @property
    def asked(self) -> bool:
        """Whether the process is to end."""
        if self._launcher and os.getppid() != self._launcher:
            self._note()
        return self._since_s is not None

    @property
    def overdue(self) -> bool:
        """Whether a load may keep it no longer."""
        return self._since_s is not None and time.monotonic() - self._since_s > END_LIMIT_S
