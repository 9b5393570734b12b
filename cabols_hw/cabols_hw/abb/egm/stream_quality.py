# SPDX-License-Identifier: Apache-2.0
"""Judges a stream by its counters: lost and late packets, and packets that were refused."""

from __future__ import annotations

from enum import Enum

from cabols_hw.abb.egm.packet_counter import PacketCounter

REFUSED = 5
"""Refused packets in a window that are told."""


class Refusal(Enum):
    """Why a packet is not used; the value is the beginning of what is said."""

    NOT_EGM = "packets that are no EGM message"
    NO_POSE = "packets without a Cartesian pose"
    JOINTS = "packets of another number of joints than 6"
    NOT_FINITE = "packets with numbers that are no pose"
    ADDRESS = "packets from another address than the robot's"
    SECOND_SENDER = "packets of a second sender on the port"
    OLD = "packets that had waited too long"
    EXTERNAL_AXIS = "packets of a robot whose external axis has moved"


ADVICE = {
    Refusal.NOT_EGM: "is the port another program's?",
    Refusal.NO_POSE: "RAPID must set EGM up with \\Pose and activate a tool",
    Refusal.JOINTS: "arms of 7 axes are not supported; is it the right robot?",
    Refusal.NOT_FINITE: "is EGM activated with a tool and a frame?",
    Refusal.ADDRESS: "set robot_address or egm_address to the controller's",
    Refusal.SECOND_SENDER: "give each robot its own port; the first sender stays the robot",
    Refusal.OLD: "this computer was busy; the newest ones are used",
    Refusal.EXTERNAL_AXIS: "a track would carry the robot's base, taken for fixed: move it "
    "back, or register the frames anew and restart this node",
}
MALFORMED = (Refusal.NOT_EGM, Refusal.NO_POSE, Refusal.JOINTS, Refusal.NOT_FINITE)


class CountedStream(PacketCounter):
    """A counter that also knows what was refused before it was counted.

    Attributes:
        refused: packets by reason.
        seen: what was seen last, by reason.
    """

    def __init__(self, late_after_s: float = 0.010) -> None:
        """Begin at zero."""
        super().__init__(late_after_s)
        self.refused = dict.fromkeys(Refusal, 0)
        self.seen = dict.fromkeys(Refusal, "")

    def refuse(self, reason: Refusal, seen: str = "") -> None:
        """Count a packet that is not used.

        Args:
            reason: why.
            seen: what came in place of the expected, for people.
        """
        self.refused[reason] += 1
        self.seen[reason] = seen


class StreamQuality:
    """Reports when too many of some tens of packets are lost or late, or when some are refused.

    Attributes:
        trouble: what is wrong with the newest window; empty for nothing.
        notice: what was refused in it, though the rest may be good; empty for nothing.
    """

    def __init__(
        self, counter: PacketCounter, window: int = 50, lost: float = 0.15, late: float = 0.6
    ) -> None:
        """Watch a counter.

        Args:
            counter: of the stream.
            window: number of packets sent, received or not, that are judged together.
            lost: share of them that may be lost.
            late: share of the received ones that may be late.
        """
        self._counter = counter
        self._window = window
        self._limits = (lost, late)
        self._before = (0, 0, 0)
        self._refused = dict.fromkeys(Refusal, 0)
        self.trouble = ""
        self.notice = ""

    def look(self) -> str:
        """Judge the packets since the last judgement, if there are enough.

        Returns:
            trouble, or else notice.
        """
        counter = self._counter
        now = (counter.received, counter.lost, counter.late)
        received, lost, late = (a - b for a, b in zip(now, self._before, strict=True))
        refused = self._newly_refused()
        if received + max(lost, 0) + sum(refused.values()) < self._window:
            return self.trouble or self.notice
        self._before = now
        if isinstance(counter, CountedStream):
            self._refused = dict(counter.refused)
        self.trouble = self._judge(received, max(lost, 0), late)
        self.notice = self._tell(refused)
        return self.trouble or self.notice

    def _newly_refused(self) -> dict[Refusal, int]:
        counter = self._counter
        if not isinstance(counter, CountedStream):
            return {}
        return {reason: counter.refused[reason] - self._refused[reason] for reason in Refusal}

    def _judge(self, received: int, lost: int, late: int) -> str:
        if received + lost == 0:
            return ""
        lost_share, late_share = lost / (received + lost), late / max(received, 1)
        if not lost_share <= self._limits[0]:
            return f"EGM: {100 * lost_share:.0f} % of the packets are lost"
        if not late_share <= self._limits[1]:
            return (
                f"EGM: {100 * late_share:.0f} % of the packets come more than "
                f"{1e3 * self._counter.late_after_s:.0f} ms late"
            )
        return ""

    def _tell(self, refused: dict[Refusal, int]) -> str:
        if not refused:
            return ""
        reason = max(refused, key=lambda kind: refused[kind])
        if refused[reason] < REFUSED or not isinstance(self._counter, CountedStream):
            return ""
        seen = self._counter.seen[reason]
        return (
            f"EGM: {reason.value} are refused{f' (last: {seen})' if seen else ''}: {ADVICE[reason]}"
        )
