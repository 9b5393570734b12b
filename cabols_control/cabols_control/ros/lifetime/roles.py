# SPDX-License-Identifier: Apache-2.0
"""One node a role: a second one refuses to start, and a second publisher is named."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from cabols_control.errors import CabolsError
from cabols_control.ros.lifetime.ending import go_on
from cabols_control.ros.lifetime.host_claim import HostClaim
from cabols_control.ros.loop import subscribe_aside
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.messages.topics import message_type
from cabols_control.ros.threads.node_executor import taken_or_none

LISTEN_S = 2.0
"""A node that is about to start listens so long for another one in its role [s]: twenty modes. On a
busy computer two processes may take over a second to find each other."""
LATE_S = 0.5
"""It listens at least so long after everything else is ready [s]."""
LISTED_S = 2.0
"""It listens so long if the graph lists another publisher [s]."""
OWN = 1
"""Publishers of the topic that are the node's own."""
TURN_S = 0.02
"""Between two looks [s]."""
SINGLE = (
    "mode",
    "limb_state",
    "wrench",
    "motor_current",
    "tension_command",
    "desired_tension",
    "platform_pose",
)
"""Topics of one publisher each."""
GHOST_S = 30.0
"""A killed process stays in the graph for its lease, 20 s; its successor has the same name [s]."""


class RoleTakenError(CabolsError):
    """Another node does already what this one would."""


class RoleCheck:
    """Claims a role on this host, and listens on the topic that only a node in it publishes.

    The claim is certain and at once, however busy the computer is; who runs on another host is
    heard. The graph cannot say it: a node that was killed is still listed there for its lease.
    """

    def __init__(self, node: Node, topic: str) -> None:
        """Begin to listen; check() comes before the node's own first message.

        Args:
            node: that is about to start.
            topic: of the role, relative to the namespace; may be a slow copy.
        """
        self._node = node
        self._topic = topic
        self._claim = HostClaim()
        self._type = message_type(topic)
        self._subscription = subscribe_aside(node, self._type, topic, topic_qos(topic), raw=False)
        self._until_s = time.monotonic() + LISTEN_S

    def check(
        self, concerns: Callable[[Any], bool] = lambda _: True, parts: Iterable[object] = ("whole",)
    ) -> None:
        """Claim the role, wait for the rest of the time, then stop listening.

        Args:
            concerns: whether a message is of this very role, e.g. of the same limbs.
            parts: of the role that are claimed, e.g. limbs.

        Raises:
            RoleTakenError: if another node of this host has the role, or one publishes on the
                topic.
            EndedEarly: if the process is asked to end meanwhile.
        """
        node, handle = self._node, self._subscription.handle
        where = f"{node.context.get_domain_id()} {node.get_namespace()} {self._topic}"
        if not all(self._claim.take(f"{where} {part}") for part in parts):
            raise RoleTakenError(
                f"{self._topic}: expected no other node of this computer that publishes it, got "
                f"one that holds this role; is a {node.get_name()} running already?"
            )
        began_s = time.monotonic()
        until_s = max(self._until_s, began_s + LATE_S)
        try:
            while node.context.ok():
                go_on()
                taken = taken_or_none(handle, self._type)
                if taken is not None and concerns(taken[0]):
                    raise RoleTakenError(
                        f"{self._topic}: expected no other node that publishes it, got messages of "
                        f"{_names(node, self._topic)}; is a {node.get_name()} running already?"
                    )
                # One that the graph lists may be dead, or found late by a busy computer.
                listed = node.count_publishers(self._topic) > OWN
                if time.monotonic() >= max(until_s, began_s + LISTED_S * listed):
                    return
                slept_s = time.monotonic()
                time.sleep(TURN_S)
                # A computer that is too busy to wake this process is slow to deliver, too.
                until_s += max(time.monotonic() - slept_s - 2.0 * TURN_S, 0.0)
        finally:
            node.destroy_subscription(self._subscription)

    def leave(self) -> None:
        """Give the role back."""
        self._claim.release()


def _names(node: Node, topic: str) -> str:
    found = {_full_name(info) for info in node.get_publishers_info_by_topic(topic)}
    return ", ".join(sorted(found)) or "a node unknown to the graph"


def _full_name(info: Any) -> str:
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


@dataclass(frozen=True)
class Publisher:
    """One publisher of a topic.

    Attributes:
        topic: relative to the namespace.
        name: of its node, with its namespace.
        endpoint: bytes that tell it from all others.
    """

    topic: str
    name: str
    endpoint: bytes


def publishers(node: Node, topic: str) -> list[Publisher]:
    """Publishers of a topic that the graph knows, also of killed processes for a while.

    Args:
        node: that looks.
        topic: relative to its namespace.
    """
    return [
        Publisher(topic, _full_name(info), bytes(info.endpoint_gid))
        for info in node.get_publishers_info_by_topic(topic)
    ]


class Seconds:
    """Names second publishers of topics that have one; pure but for the list that it is given."""

    def __init__(self) -> None:
        """Know none yet."""
        self._since_s: dict[Publisher, float] = {}

    def look(self, found: list[Publisher], now_s: float) -> str:
        """Return who publishes what another node publishes; empty for nobody.

        Args:
            found: all publishers of all topics of one publisher each.
            now_s: on a clock that is never set [s].
        """
        self._since_s = {one: self._since_s.get(one, now_s) for one in found}
        told = []
        for topic in SINGLE:
            here = [one for one in found if one.topic == topic]
            names = {one.name for one in here}
            twice = len(names) < len(here) and all(
                now_s - self._since_s[one] > GHOST_S for one in here
            )
            parts = topic == "motor_current" and all("limb_controller" in name for name in names)
            if twice or (len(names) > 1 and not parts):
                told.append(f"{topic} has {len(here)} publishers: {', '.join(sorted(names))}")
        return "; ".join(told)
