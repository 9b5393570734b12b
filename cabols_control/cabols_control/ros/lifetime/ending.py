# SPDX-License-Identifier: Apache-2.0
"""When a process is asked to end: by a signal, or by the death of the process that launched it."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from cabols_control import end_signals
from cabols_control.bringup.launcher_watch import LauncherWatch
from cabols_control.command_line import DONE

END_LIMIT_S = 5.0
"""Longest time that a load may keep a process from ending [s]."""


class EndedEarly(Exception):  # noqa: N818 - nothing is wrong
    """The process was asked to end while it still started."""


class EndRequest:
    """Notes the signals to end and a dead launcher; none of them ends the process by itself."""

    def __init__(self) -> None:
        """Take over the signals, those that have waited among them."""
        self._since_s: float | None = None
        self._at_once = False
        self._launcher = LauncherWatch()
        end_signals.handle(self._hear)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        if self._at_once:
            os._exit(DONE)
        self._note()

    @contextmanager
    def at_once(self, harmless: bool) -> Iterator[None]:
        """Let a signal end the process at once, as compiling may take minutes the first time.

        Args:
            harmless: whether what is done inside leaves nothing half made; else nothing is changed.
        """
        self._at_once = harmless
        try:
            if harmless and self._since_s is not None:
                os._exit(DONE)
            yield
        finally:
            self._at_once = False

    def _note(self) -> None:
        if self._since_s is None:
            self._since_s = time.monotonic()

    @property
    def asked(self) -> bool:
        """Whether the process is to end."""
        if self._launcher.is_dead:
            self._note()
        return self._since_s is not None

    def overdue(self, limit_s: float = END_LIMIT_S) -> bool:
        """Whether a load may keep it no longer.

        Args:
            limit_s: how long it may [s].
        """
        return self._since_s is not None and time.monotonic() - self._since_s > limit_s


_REQUESTS: list[EndRequest] = []
"""The process's one, once there is one."""


def take_requests() -> EndRequest:
    """Begin to note requests to end, or return what notes them already; main thread only."""
    if not _REQUESTS:
        _REQUESTS.append(EndRequest())
    return _REQUESTS[0]


def go_on() -> None:
    """Pass a point of the start at which nothing is open yet.

    Raises:
        EndedEarly: if the process is asked to end.
    """
    if _REQUESTS and _REQUESTS[0].asked:
        raise EndedEarly
