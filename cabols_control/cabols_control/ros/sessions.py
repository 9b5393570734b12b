# SPDX-License-Identifier: Apache-2.0
"""Inputs that follow one supervisor's session: the mode, and commands that carry its number."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable

from cabols_msgs.msg import Mode
from rclpy.node import Node

from cabols_control.ros.loop import Input
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.layout import Layout
from cabols_control.supervision.modes import MOVING, Cause, OperatingMode
from cabols_control.supervision.session import STAMP_S, SessionFollower

SESSION = struct.Struct("<Q")
MODES = frozenset(int(mode) for mode in OperatingMode)
BEHIND_NS, ALIVE_S = 500_000_000, 0.04
"""What is so far behind a stream that is so young is none of its messages: a played bag's.

Where the clock behind the stamps was set back nothing comes for so long, much less than the 0.1 s
at which a pose is too old.
"""
MOVES = frozenset(int(mode) for mode in MOVING)
CAUSES = frozenset(int(cause) for cause in Cause)


class ModeInput(Input):
    """The mode of the session that a node follows; unknown modes and other sessions are dropped."""

    def __init__(
        self,
        node: Node,
        sessions: SessionFollower,
        lockstep: bool = False,
        every: int = 1,
        clock_ns: Callable[[], int] | None = None,
        on_session: Callable[[int], object] | None = None,
    ) -> None:
        """Subscribe.

        Args:
            node: owner.
            sessions: that the node follows.
            lockstep: whether the graph's clock waits for answers.
            every: see Input.
            clock_ns: stamp of the node's newest sample [ns], to which the stamp of a new session's
                first mode is compared; None: not compared. A node with it drives motors, and
                follows no mode without a session.
            on_session: called with the number of each new session.
        """
        layout = topics.mode_layout()
        super().__init__(node, "mode", layout, lockstep, every=every)
        self._sessions = sessions
        self._clock_ns = None if lockstep else clock_ns
        self._strict = clock_ns is not None
        self._on_session = on_session
        self._mode_at, self._session_at = layout.offset_of("mode"), layout.offset_of("session")
        self.judge = self._judge

    def _judge(self, laid_out: bytes) -> bool:
        sessions = self._sessions
        if laid_out[self._mode_at] not in MODES:
            sessions.dropped += 1
            return False
        session, before = SESSION.unpack_from(laid_out, self._session_at)[0], sessions.session
        off_s = 0.0
        if self._clock_ns is not None:
            stamp_ns = self._layout.stamp_of(laid_out)
            off_s = 1e-9 * (stamp_ns - self._clock_ns()) if stamp_ns else float("nan")
        if session == before and not (self._strict and session == 0):
            # A bag of this very session, played while it lasts; one that stops may come late.
            if laid_out[self._mode_at] in MOVES and not abs(off_s) <= STAMP_S:
                sessions.dropped += 1
                return False
            sessions.hear(time.monotonic())
            return True
        if not sessions.admit(session, time.monotonic(), off_s):
            return False
        if self._on_session is not None:
            self._on_session(session)
        return True


class ModeFilter:
    """The same rule for those who watch, and receive messages as objects."""

    def __init__(self) -> None:
        """Follow none yet."""
        self._sessions = SessionFollower()

    def admits(self, message: Mode) -> bool:
        """Whether a message tells the rig's mode.

        Args:
            message: of topic mode.
        """
        if message.mode not in MODES or message.cause not in CAUSES:
            return False
        session, sessions = int(message.session), self._sessions
        if session == sessions.session:
            sessions.hear(time.monotonic())
            return True
        return sessions.admit(session, time.monotonic())


def same_session(
    layout: Layout, sessions: SessionFollower, lockstep: bool
) -> Callable[[bytes], bool] | None:
    """Return a judge for Input: whether a command carries the session that is followed.

    Args:
        layout: of the command.
        sessions: of the node that reads it.
        lockstep: whether the graph's clock waits for each command: then none is dropped.
    """
    if lockstep:
        return None
    at, unpack = layout.offset_of("session"), SESSION.unpack_from

    def judge(laid_out: bytes) -> bool:
        if unpack(laid_out, at)[0] == sessions.session:
            return True
        sessions.dropped += 1
        return False

    return judge


def living(
    layout: Layout, sessions: SessionFollower, lockstep: bool
) -> Callable[[bytes], bool] | None:
    """Return a judge for Input: whether a message without a session is of the stream that lives.

    A played bag's stamps are behind it, whatever clock both are of. Where the stream has fallen
    silent, and its reader given up, any other one may follow.

    Args:
        layout: of the message.
        sessions: of the node that reads it, where what is dropped is counted.
        lockstep: whether the graph's clock waits for each message: then none is dropped.
    """
    if lockstep:
        return None
    newest_ns, heard_s = 0, float("-inf")

    def judge(laid_out: bytes) -> bool:
        nonlocal newest_ns, heard_s
        stamp_ns, now_s = layout.stamp_of(laid_out), time.monotonic()
        if stamp_ns < newest_ns - BEHIND_NS and now_s - heard_s <= ALIVE_S:
            sessions.dropped += 1
            return False
        newest_ns, heard_s = stamp_ns, now_s
        return True

    return judge
