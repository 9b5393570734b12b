# SPDX-License-Identifier: Apache-2.0
"""Messages of a topic as objects, taken on a look: no executor wakes for them."""

from __future__ import annotations

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from cabols_control.ros.loop import subscribe_aside
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.messages.topics import message_type
from cabols_control.ros.threads.node_executor import taken_or_none

ROS_TOPICS: dict[str, tuple[type, QoSProfile]] = {
    "/diagnostics": (DiagnosticArray, QoSProfile(depth=100)),
    "/rosout": (Log, QoSProfile(depth=200, durability=DurabilityPolicy.VOLATILE)),
}
"""Topics of ROS itself that can be read, too."""


class Reader:
    """One topic of the graph, or of ROS itself."""

    def __init__(self, node: Node, topic: str) -> None:
        """Subscribe; `topic` is relative to the node's namespace, or one of ROS_TOPICS."""
        msg_type, qos = ROS_TOPICS.get(topic) or (message_type(topic), topic_qos(topic))
        self._type = msg_type
        self.subscription = subscribe_aside(node, msg_type, topic, qos, raw=False)
        self._handle = self.subscription.handle

    def take(self) -> list[Any]:
        """Take all that waits, oldest first."""
        return [message for message, _ in self.take_timed()]

    def take_timed(self) -> list[tuple[Any, int]]:
        """Take the same, each with its time of reception [ns], time.time_ns."""
        found = []
        while (taken := taken_or_none(self._handle, self._type)) is not None:
            message, info = taken
            found.append((message, info["received_timestamp"] or time.time_ns()))
        return found
