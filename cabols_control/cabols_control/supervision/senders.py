# SPDX-License-Identifier: Apache-2.0
"""Which process's reports count for a node: one at a time; pure.

A ROS reader is not told who sent a message. Each process therefore draws a number when it starts,
its instance, and every LoopStatus carries it. While the process that is followed reports, reports
in its node's name from another one are a stranger's: a second rig's node that is about to be
refused, a played bag's. They must neither end this rig nor vouch for a node that is silent.
"""

from __future__ import annotations

import secrets
from typing import Any

LOCKSTEP_INSTANCE = 1
"""Instance of every process in lockstep, where equal runs send equal bytes."""
NODES = 64
"""Senders are kept of this many nodes; a rig has about a dozen."""


def make_room(notes: dict[str, Any], node: str) -> None:
    """Keep a dictionary of nodes' notes bounded, whatever names strangers send.

    Args:
        notes: by node.
        node: whose note is to be added. Of too many nodes the one that was new last goes: the rig's
            own are there before.
    """
    if node not in notes and len(notes) >= NODES:
        notes.popitem()


def draw_instance() -> int:
    """Draw a number that no other process has; never 0, which a hand-made message carries."""
    return secrets.randbits(64) | 1


class SenderFollower:
    """The process that is followed for each node's name.

    Attributes:
        dropped: reports of other processes that were refused so far.
    """

    def __init__(self, silent_s: float) -> None:
        """Follow nobody yet.

        Args:
            silent_s: after this silence of the followed process another one may take over [s].
        """
        self.dropped = 0
        self._silent_s = silent_s
        self._followed: dict[str, tuple[int, float]] = {}

    def admit(self, node: str, instance: int, now_s: float) -> bool:
        """Judge a report; a node's first process is followed until it is silent.

        Args:
            node: name in whose place the report speaks.
            instance: number that it carries.
            now_s: present time [s]; after a step back of the clock nobody is followed any more.
        """
        followed = self._followed.get(node)
        number, heard_s = followed or (instance, now_s)
        if number != instance and 0.0 <= now_s - heard_s <= self._silent_s:
            self.dropped += 1
            return False
        if followed is None and len(self._followed) >= NODES:
            self._followed.pop(min(self._followed, key=lambda name: self._followed[name][1]))
        self._followed[node] = (instance, now_s)
        return True
