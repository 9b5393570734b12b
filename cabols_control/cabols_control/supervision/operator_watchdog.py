# SPDX-License-Identifier: Apache-2.0
"""Whether the operator's console of a rig still reports; pure."""

from __future__ import annotations

import math


class OperatorWatchdog:
    """A dead man's switch on heartbeats; times are of any clock that never jumps.

    The first heartbeat of an attended console arms it. From then on, while the rig is not at rest,
    `overdue` reports when no such heartbeat has arrived for the time-out. At rest, a heartbeat
    without an operator, or silence, disarms it. A rig without a console, such as one that a script
    drives, is never overdue.
    """

    def __init__(self, timeout_s: float) -> None:
        """Start disarmed.

        Args:
            timeout_s: longest silence between two heartbeats [s].
        """
        self._timeout_s = timeout_s
        self._last_s = -math.inf
        self._operator = ""
        self.armed = False

    def hear(self, now_s: float, attended: bool, operator: str) -> None:
        """Take one heartbeat; an unattended one counts as none.

        Args:
            now_s: when it came [s].
            attended: whether the operator's page has answered lately.
            operator: name of whoever is in command.
        """
        if attended:
            self._last_s, self._operator, self.armed = now_s, operator, True

    def overdue(self, now_s: float, at_rest: bool) -> str:
        """Why the rig must be stopped; empty if it need not be.

        Args:
            now_s: now [s].
            at_rest: whether nothing moves.
        """
        if not self.armed or now_s - self._last_s <= self._timeout_s:
            return ""
        if at_rest:
            self.armed = False
            return ""
        who = f" ({self._operator})" if self._operator else ""
        return f"unattended: the operator's console{who} is silent for {self._timeout_s:g} s"
