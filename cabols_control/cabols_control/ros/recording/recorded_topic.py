# SPDX-License-Identifier: Apache-2.0
"""One recorded topic: subscribed to at once, or after the control loop's own readers."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

from rclpy.qos import QoSProfile

from cabols_control.bags.join_policy import JoinPolicy
from cabols_control.bags.lost_messages import LostMessages
from cabols_control.ros.loop import subscribe_aside
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import quality_qos
from cabols_control.ros.node import ControlNode
from cabols_control.topics import Topic

QUEUE_DEPTH = 4000
CLOCK_TOPIC = "limb_state"

Item = tuple[int, str, int, bytes, int]
"""Reception [ns], topic, publication [ns], bytes, publication number."""


class RecordedTopic:
    """One recorded topic.

    Attributes:
        offered: quality of service that its publishers offer.
        missing: counts the messages that were lost.
        type_name: as in `cabols_msgs/msg/LimbState`.
        count: messages so far.
    """

    def __init__(self, node: ControlNode, row: Topic) -> None:
        """Subscribe, with or without a publisher; to a topic of the control loop in join().

        Args:
            node: owner of the subscription.
            row: of the topic.
        """
        self.name = topic = row.name
        self.offered = quality_qos(row.quality, node.lockstep)
        self.missing = LostMessages(lambda: node.count_publishers(topic))
        self.count = 0
        self._node = node
        self.type_name = row.type_name
        self._type = topics.class_of(row.type_name)
        self._log_time_ns = 0
        self._subscription: Any = None
        self._policy = JoinPolicy()
        # Fast DDS sends a message to its readers in the order in which it matched them. With the
        # loop's own readers first, the loop's delay is some 30 us shorter.
        if node.lockstep or not row.in_loop:
            self._subscribe()

    @property
    def joined(self) -> bool:
        """Whether it is subscribed to."""
        return self._subscription is not None

    def join(self, now_s: float) -> bool:
        """Subscribe when the join policy allows it; return whether it is subscribed to."""
        node = self._node
        if not self.joined:
            published = min(node.count_publishers(name) for name in (CLOCK_TOPIC, self.name)) > 0
            if self._policy.over(now_s, published, node.count_subscribers(self.name) > 0):
                self._subscribe()
        return self.joined

    def _subscribe(self) -> None:
        qos = QoSProfile(
            depth=QUEUE_DEPTH,
            reliability=self.offered.reliability,
            durability=self.offered.durability,
        )
        self._subscription = subscribe_aside(self._node, self._type, self.name, qos)
        self._handle = self._subscription.handle

    def take(self, into: deque[Item]) -> bytes:
        """Take all waiting messages in order; return the newest, empty if there was none."""
        if not self.joined:
            return b""
        handle, msg_type, add = self._handle, self._type, self.missing.add
        newest = b""
        while (taken := handle.take_message(msg_type, True)) is not None:
            newest, info = taken
            number = info["publication_sequence_number"]
            add(number)
            received = info["received_timestamp"] or time.time_ns()
            # A clock that is set back must not reverse the order of a topic's messages.
            self._log_time_ns = max(received, self._log_time_ns)
            self.count += 1
            into.append((self._log_time_ns, self.name, info["source_timestamp"], newest, number))
        return newest

    def close(self) -> None:
        """Unsubscribe: an unread subscription would still cost time."""
        if self.joined:
            self._node.destroy_subscription(self._subscription)
