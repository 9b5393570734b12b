"""Whether somebody still watches a rig that an operator has taken command of."""

from __future__ import annotations

import math

from cabols_control.supervision.modes import UNATTENDED


class Attendance:
    """A dead man's switch on heartbeats; times are any clock that never jumps.

    The first heartbeat of an attended console arms it: from then on, while the rig is not at rest,
    `overdue` tells once no such heartbeat has come for the time-out. At rest a heartbeat that
    says that nobody is in command, or silence, disarms it. A rig that no console attends, such as
    one led by a script, is never overdue.
    """

    def __init__(self, timeout_s: float) -> None:
        """Start disarmed.

        Args:
            timeout_s: heartbeats may be away so long [s].
        """
        self._timeout_s = timeout_s
        self._last_s = -math.inf
        self._operator = ""
        self.armed = False

    def hear(self, now_s: float, attended: bool, operator: str) -> None:
        """Take one heartbeat; one that is not attended counts as none."""
        if attended:
            self._last_s, self._operator, self.armed = now_s, operator, True

    def overdue(self, now_s: float, at_rest: bool) -> str:
        """Why the rig must be stopped; empty if it need not be."""
        if not self.armed or now_s - self._last_s <= self._timeout_s:
            return ""
        if at_rest:
            self.armed = False
            return ""
        who = f" ({self._operator})" if self._operator else ""
        return f"{UNATTENDED}: the operator's console{who} is silent for {self._timeout_s:g} s"
