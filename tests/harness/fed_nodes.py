# SPDX-License-Identifier: Apache-2.0
"""Nodes in this process whose subscriptions are fed directly, and whose messages are caught."""

from __future__ import annotations

import time
from collections import defaultdict, deque
from typing import Any

from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message

from cabols_control.topics import LIVE

ASIDE = (
    "cabols_control.ros.loop",
    "cabols_control.ros.reader",
    "cabols_control.ros.recording.recorded_topic",
    "cabols_stiffness.ros.intake",
)
"""Modules that subscribe beside the executor."""


class FedHandle:
    """Stands for a subscription's handle: messages are what the test puts in."""

    def __init__(self) -> None:
        self.waiting: deque[Any] = deque()
        self.number = 0

    def take_message(self, msg_type: Any, raw: bool) -> Any:
        """As rclpy's."""
        if not self.waiting:
            return None
        sent = self.waiting.popleft()
        self.number += 1
        info = {
            "publication_sequence_number": self.number,
            "received_timestamp": time.time_ns(),
            "source_timestamp": time.time_ns(),
        }
        return (sent if raw else deserialize_message(sent, msg_type)), info


class Feeder:
    """Feeds what the nodes that are made while it is installed subscribe to."""

    def __init__(self, patch: Any) -> None:
        """Install; `patch` is pytest's monkeypatch."""
        self.aside: dict[str, list[tuple[Any, FedHandle]]] = defaultdict(list)
        self.published: list[tuple[str, Any]] = []
        feeder = self

        class FedSubscription:
            def __init__(self, node: Any, kind: Any, topic: str, *_: Any, **__: Any) -> None:
                self.handle = FedHandle()
                feeder.aside[topic.removeprefix(LIVE)].append((kind, self.handle))

        for module in ASIDE:
            patch.setattr(f"{module}.subscribe_aside", FedSubscription)
        patch.setattr("rclpy.node.Node.destroy_subscription", lambda *_: True)

        def publish(publisher: Any, message: Any) -> None:
            if isinstance(message, bytes):
                message = deserialize_message(message, publisher.msg_type)
            feeder.published.append((publisher.topic_name.rpartition("/")[2], message))

        patch.setattr(Publisher, "publish", publish)

        def publish_raw(output: Any, raw: bytes) -> None:
            kind = output._publisher.msg_type
            feeder.published.append((output.topic, deserialize_message(bytes(raw), kind)))

        patch.setattr("cabols_control.ros.loop.Output.publish", publish_raw)

    def topics(self, node: Any) -> dict[str, Any]:
        """Topics that the node hears, relative to the namespace, and the classes of messages."""
        found = {topic: pairs[0][0] for topic, pairs in self.aside.items()}
        for subscription in node.subscriptions:
            name = subscription.topic_name.removeprefix(node.get_namespace() + "/")
            found.setdefault(name.removeprefix(LIVE), subscription.msg_type)
        return found

    def send(self, node: Any, topic: str, message: Any) -> bool:
        """Deliver one message; False if it cannot be serialised, so that nobody can send it."""
        try:
            raw = bytes(serialize_message(message))
            message = deserialize_message(raw, type(message))
        except Exception:
            return False
        for _, handle in self.aside.get(topic, ()):
            handle.waiting.append(raw)
        for subscription in node.subscriptions:
            name = subscription.topic_name.removeprefix(node.get_namespace() + "/")
            if name.removeprefix(LIVE) == topic:
                subscription.callback(message)
        return True
