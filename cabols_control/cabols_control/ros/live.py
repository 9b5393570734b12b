# SPDX-License-Identifier: Apache-2.0
"""Slow copies of fast topics, for pages and viewers that must not slow the control loop.

A reader of a 1 kHz topic costs a thread's wake-up a thousand times a second, and its writer one
more reader to address, however rarely the messages are used. The publisher of such a topic
therefore sends the same bytes also on `live/<topic>`, at a low rate.
"""

from __future__ import annotations

import time

from rclpy.node import Node

from cabols_control.ros.loop import Output
from cabols_control.topics import LIVE

PERIOD_NS = 45_000_000
"""Period of the copies [ns]: below the console's 50 ms, so that each read finds a new one."""


def live_name(topic: str) -> str:
    """Name of a topic's slow copy, relative to the namespace."""
    return LIVE + topic


class LiveOutput(Output):
    """An Output with a slow copy, by the wall clock in lockstep, too: a viewer may be open."""

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
        """Send the newest bytes as a copy if one is due; to be called after all urgent output."""
        now_ns = time.monotonic_ns()
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + PERIOD_NS
            self._copy.publish(self._newest)
