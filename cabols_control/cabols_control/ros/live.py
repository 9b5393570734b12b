"""Slow copies of fast topics, for pages, viewers and whatever else must not cost the loop.

A reader of a 1 kHz topic makes its middleware wake a thread a thousand times a second, and its
writer address one more reader each time, however rarely it looks. Whoever publishes such a topic
therefore also publishes every so often the same bytes on `live/<topic>`.
"""

from __future__ import annotations

import time

from rclpy.node import Node

from cabols_control.ros.loop import Output
from cabols_control.topics import LIVE

PERIOD_NS = 45_000_000
"""A little below the 50 ms in which a console looks, so that each look finds news."""


def live_name(topic: str) -> str:
    """Name of a topic's slow copy, relative to the namespace."""
    return LIVE + topic


class LiveOutput(Output):
    """An Output with a slow copy, by the wall clock: in lockstep, too, somebody may watch."""

    def __init__(self, node: Node, topic: str, lockstep: bool = False) -> None:
        """Advertise both, with the topic's type; see Output."""
        super().__init__(node, topic, lockstep)
        self._copy = Output(node, live_name(topic))
        self._due_ns = 0
        self._newest = b""

    def publish(self, raw: bytes) -> None:
        """Send serialised bytes."""
        self._publish(raw)
        self._newest = raw

    def copy(self) -> None:
        """Send the newest bytes again if it is time; call it when all that is urgent is sent."""
        now_ns = time.monotonic_ns()
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + PERIOD_NS
            self._copy.publish(self._newest)
