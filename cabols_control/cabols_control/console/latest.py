# SPDX-License-Identifier: Apache-2.0
"""Newest values of the rig, handed from the thread that receives them to the pages."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

EVENTS = 400
INFO, NOTICE, WARNING, FAULT = "info", "notice", "warning", "fault"


@dataclass(frozen=True)
class Event:
    """One line of the console's log.

    Attributes:
        number: counts from 1.
        time_s: wall clock, seconds since 1970.
        level: info, notice, warning or fault.
        source: node, or operator.
        text: what happened, and why.
    """

    number: int
    time_s: float
    level: str
    source: str
    text: str

    def row(self) -> list[Any]:
        """Return the event as it is sent to a page."""
        return [self.number, round(self.time_s, 2), self.level, self.source, self.text]


class LatestValues:
    """Newest frame, state and events; every method may be called from any thread.

    Writing never waits: a page that does not read misses frames, and nothing else.

    Attributes:
        on_news: called, in the writer's thread, after each frame.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._lock = threading.Lock()
        self._frame = ""
        self._number = 0
        self._state: dict[str, Any] = {}
        self._version = 0
        self._state_text = ""
        self._events: deque[Event] = deque(maxlen=EVENTS)
        self._count = 0
        self.on_news: Callable[[], None] = lambda: None

    def put_frame(self, frame: dict[str, Any]) -> None:
        """Replace the frame: what changes twenty times a second."""
        with self._lock:
            self._number += 1
            # Numbers that are not finite become null: NaN is no JSON.
            self._frame = json.dumps({"k": "f", "n": self._number, **frame}, separators=(",", ":"))
        self.on_news()

    def put_state(self, **parts: Any) -> None:
        """Replace parts of the state: what changes rarely."""
        with self._lock:
            if any(self._state.get(name) != value for name, value in parts.items()):
                self._state.update(parts)
                self._version += 1
                self._state_text = ""

    def tell(self, level: str, source: str, text: str) -> None:
        """Add a line to the log; the same line again within a second is dropped.

        Args:
            level: INFO, NOTICE, WARNING or FAULT.
            source: the node, device or operator that it is about.
            text: what happened, and why, for people.
        """
        now = time.time()
        with self._lock:
            for event in reversed(self._events):
                if now - event.time_s > 1.0:
                    break
                if (event.level, event.source, event.text) == (level, source, text):
                    return
            self._count += 1
            self._events.append(Event(self._count, now, level, source, text))

    def frame(self) -> tuple[int, str]:
        """Number and text of the newest frame."""
        with self._lock:
            return self._number, self._frame

    def state(self) -> tuple[int, dict[str, Any]]:
        """Version and a copy of the state."""
        with self._lock:
            return self._version, dict(self._state)

    def state_text(self) -> tuple[int, str]:
        """Version and text of the state, serialised once for all pages."""
        with self._lock:
            if not self._state_text:
                content = {"k": "s", **self._state}
                self._state_text = json.dumps(content, separators=(",", ":"))
            return self._version, self._state_text

    def events_after(self, number: int) -> list[Event]:
        """Return the events after the one of this number."""
        with self._lock:
            if self._count <= number:
                return []
            return [event for event in self._events if event.number > number]
