# SPDX-License-Identifier: Apache-2.0
"""Which supervisor's modes a node follows: one session at a time; pure.

A ROS reader is not told who sent a message. Each supervisor therefore draws a number when it
starts, its session, and every mode carries it; controllers put the session that they follow into
their commands. What carries another number is not for this rig, or not from now: a stranger's
message, a second supervisor's, a played bag's.
"""

from __future__ import annotations

SILENT_S = 0.5
"""A session is over after this silence [s]: five times the period of the modes."""
LOST_S = 5.0
"""After this silence an older session may follow, too: the computer's clock was set back [s]."""
YOUNG_S = 0.5
"""A node that has just started follows the newest session that it hears in this time [s]."""
STAMP_S = 2.0
"""A session is taken up by a mode whose stamp is no farther from the node's samples [s]."""
LOCKSTEP_SESSION = 1
"""Session of a supervisor in lockstep, where equal runs send equal bytes."""


class SessionFollower:
    """The session that one node follows.

    Attributes:
        session: followed; 0 before the first.
        dropped: messages that were refused so far, of all control topics.
    """

    def __init__(self) -> None:
        """Follow none yet."""
        self.session = 0
        self.dropped = 0
        self._first_s = float("nan")
        self._heard_s = float("-inf")

    def hear(self, now_s: float) -> None:
        """Note a mode of the session that is followed.

        Args:
            now_s: when it came, on a clock that is never set [s].
        """
        self._heard_s = now_s

    def admit(self, session: int, now_s: float, off_s: float = 0.0) -> bool:
        """Judge a mode of another session; from the first that is admitted, follow it.

        Args:
            session: that it carries.
            now_s: when it came, on a clock that is never set [s].
            off_s: its stamp less the stamp of the node's newest sample [s]; NaN: it has no stamp,
                as its supervisor has not heard of a sample yet.
        """
        if self._free(session, now_s) and abs(off_s) <= STAMP_S:
            if self.session == 0:
                self._first_s = now_s
            self.session, self._heard_s = session, now_s
            return True
        # A supervisor without a stamp is new, not strange.
        if session == 0 or off_s == off_s:
            self.dropped += 1
        return False

    def _free(self, session: int, now_s: float) -> bool:
        """Whether the node may follow this session now."""
        if session == 0:
            return False
        silent_s = now_s - self._heard_s
        if self.session == 0 or silent_s > LOST_S:
            return True
        young = now_s - self._first_s <= YOUNG_S
        return session > self.session and (young or silent_s > SILENT_S)
