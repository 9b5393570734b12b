"""One recorded topic: subscribed to at once, or behind the control loop's own readers."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

from rclpy.qos import QoSProfile

from cabols_control.bags.join_policy import Courtesy
from cabols_control.bags.lost_messages import Gaps
from cabols_control.ros import topics
from cabols_control.ros.loop import subscribe_aside
from cabols_control.ros.node import ControlNode
from cabols_control.ros.qos import topic_qos
from cabols_control.topics import topic_row

QUEUE_DEPTH = 4000
CLOCK_TOPIC = "limb_state"

Item = tuple[int, str, int, bytes, int]
"""Reception [ns], topic, publication [ns], bytes, publication number."""


class Tap:
    """One recorded topic.

    Attributes:
        offered: quality with which its publishers offer it.
        gaps: messages that were missed.
        count: messages so far.
    """

    def __init__(self, node: ControlNode, topic: str) -> None:
        """Subscribe, whether or not anybody publishes yet; on a topic of the loop in join()."""
        self.topic = topic
        self.offered = topic_qos(topic, node.lockstep)
        self.gaps = Gaps(lambda: node.count_publishers(topic))
        self.count = 0
        self._node = node
        self._type = topics.message_type(topic)
        self._log_time_ns = 0
        self._subscription: Any = None
        self._courtesy = Courtesy()
        # Fast DDS sends a message to its readers in the order in which it met them: the loop's own
        # readers go first, which takes some 30 us off the loop's delay.
        if node.lockstep or not topic_row(topic).in_loop:
            self._subscribe()

    @property
    def type_name(self) -> str:
        """Name as in `cabols_msgs/msg/LimbState`."""
        return topic_row(self.topic).type_name

    @property
    def joined(self) -> bool:
        """Whether it is subscribed to."""
        return self._subscription is not None

    def join(self, now_s: float) -> bool:
        """Subscribe if it is time; return whether it is subscribed to."""
        node = self._node
        if not self.joined:
            published = min(node.count_publishers(name) for name in (CLOCK_TOPIC, self.topic)) > 0
            if self._courtesy.over(now_s, published, node.count_subscribers(self.topic) > 0):
                self._subscribe()
        return self.joined

    def _subscribe(self) -> None:
        wanted = QoSProfile(
            depth=QUEUE_DEPTH,
            reliability=self.offered.reliability,
            durability=self.offered.durability,
        )
        self._subscription = subscribe_aside(self._node, self._type, self.topic, wanted)
        self._handle = self._subscription.handle

    def take(self, into: deque[Item]) -> bytes:
        """Take all that waits, in order; returns the newest, empty if there was none."""
        if not self.joined:
            return b""
        handle, msg_type, add = self._handle, self._type, self.gaps.add
        newest = b""
        while (taken := handle.take_message(msg_type, True)) is not None:
            newest, info = taken
            number = info["publication_sequence_number"]
            add(number)
            received = info["received_timestamp"] or time.time_ns()
            # A clock that is set back must not turn the order of a topic around.
            self._log_time_ns = max(received, self._log_time_ns)
            self.count += 1
            into.append((self._log_time_ns, self.topic, info["source_timestamp"], newest, number))
        return newest

    def close(self) -> None:
        """Unsubscribe: what nobody records costs nothing."""
        if self.joined:
            self._node.destroy_subscription(self._subscription)
