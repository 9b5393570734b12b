# SPDX-License-Identifier: Apache-2.0
"""The stop topic: who presses repeats until it is acknowledged, who hears acts and acknowledges.

A service's request is lost if its server has just died: it is sent to an endpoint that still
counts as there (ISO 13850: a stop must not depend on that). A stop is therefore also a message to
whoever listens, of any number of senders, and sent again and again.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable, Iterable

from cabols_msgs.msg import Mode, Stop, StopReceived
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node

from cabols_control.naming import told
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.stamps import set_time
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.stops import REMEMBERED, HeldStops
from cabols_control.supervision.supervision_config import SupervisionConfig

REPEAT_S = 0.05
"""Period of a stop's repetitions [s]."""
GIVE_UP_S = 10.0
"""A stop is repeated no longer than this [s]."""
ALONE_S = 0.2
"""Where nobody has acknowledged a stop by then, the supervisor's service is asked, too [s]."""
LINGER_S = 1.0
"""After the first acknowledgement it is repeated so long, for nodes that are just starting [s]."""
PRESSED = "emergency stop"
"""Why the rig stopped, for people; the log and the message on `stop` say who pressed."""
STOPPED = Fault(FaultName.EMERGENCY_STOP, PRESSED)
"""Fault of a node that holds a stop."""
STOPPERS = frozenset((*SupervisionConfig.bridges, "supervisor"))
"""Nodes of which one suffices: a bridge has cut, the supervisor has latched FAULT."""
SENDER_SIZE = 100
"""Of a sender's name this much is told [characters]."""


def _nothing() -> None:
    pass


class StopReceiver:
    """Acts on each stop once, and acknowledges each of its messages.

    Attributes:
        presses: that the node has heard.
    """

    def __init__(
        self,
        node: Node,
        act: Callable[[str, int], object],
        group: CallbackGroup | None = None,
    ) -> None:
        """Listen in the node's executor.

        Args:
            node: that stops what it drives.
            act: stops it; called with who pressed, and the press's number. An acknowledgement
                follows when it returns.
            group: of the callback; None: the node's own.
        """
        self._name = node.get_name()
        self._act = act
        self.presses = HeldStops()
        self._lock = threading.Lock()
        self._answers = node.create_publisher(
            StopReceived, "stop_received", topic_qos("stop_received")
        )
        node.create_subscription(Stop, "stop", self._hear, topic_qos("stop"), callback_group=group)

    def _hear(self, message: Stop) -> None:
        given = int(message.number)
        # Typed by hand, without a number: each message is a press of its own.
        number = given or draw_press()
        # In a cycle of another thread a press must not come between its check and its release.
        with self._lock:
            if self.presses.press(number):
                self._act(told(message.sender, SENDER_SIZE), number)
        self._answers.publish(StopReceived(number=given, node=self._name))


class StopLatch(StopReceiver):
    """Holds each stop, whatever mode comes, until a mode names it as lifted by a reset.

    The node reports STOPPED with the number of one that holds, so that a supervisor which did not
    run when it was pressed latches it.
    """

    def __init__(
        self, node: Node, stop: Callable[[], object], release: Callable[[], object] = _nothing
    ) -> None:
        """Listen in the node's executor.

        Args:
            node: that stops what it drives.
            stop: stops it.
            release: lets it move again.
        """
        self._stop, self._release = stop, release
        super().__init__(node, self._press)

    @property
    def number(self) -> int:
        """Number of a stop that holds; 0 for none. Any thread may ask."""
        return self.presses.number

    def _press(self, _sender: str, _number: int) -> None:
        self._stop()

    def follow(self, lifted: Iterable[int]) -> None:
        """Take a mode of the session that is followed; after it is in force.

        Args:
            lifted: its numbers of stops that a reset has lifted.
        """
        with self._lock:
            if self.presses.lift(int(number) for number in lifted):
                self._release()


def draw_press() -> int:
    """Draw the number of a press; never 0."""
    return secrets.randbits(64) | 1


class StopSender:
    """Presses the stop, from any thread.

    A press is repeated until a mode names it as lifted by a reset: a supervisor that starts later
    would take a repetition for a new press. Acknowledgements and modes arrive in the node's
    executor.
    """

    def __init__(self, node: Node) -> None:
        """Advertise now, so that the receivers are matched when it is pressed."""
        self._node = node
        self._context = node.context
        self._lock = threading.Lock()
        self._acknowledged: dict[int, list[str]] = {}
        self._lifted: set[int] = set()
        self._publisher = node.create_publisher(Stop, "stop", topic_qos("stop"))
        self._subscriptions = [
            node.create_subscription(
                StopReceived, "stop_received", self._hear, topic_qos("stop_received")
            ),
            node.create_subscription(Mode, "mode", self._hear_mode, topic_qos("mode")),
        ]

    def press(self, sender: str) -> int:
        """Send a stop and go on repeating it; return its number.

        Args:
            sender: who presses, for people.
        """
        message = Stop(number=draw_press(), sender=sender[:SENDER_SIZE])
        set_time(message.stamp, time.time_ns())
        number = int(message.number)
        with self._lock:
            while len(self._acknowledged) >= REMEMBERED:
                oldest = next(iter(self._acknowledged))
                self._acknowledged.pop(oldest)
                self._lifted.discard(oldest)
            self._acknowledged[number] = []
        self._publisher.publish(message)
        name = f"stop {number}"
        threading.Thread(
            target=self._repeat, args=(message, number), name=name, daemon=True
        ).start()
        return number

    def acknowledged(self, number: int) -> list[str]:
        """Names of the nodes that have acknowledged a stop, in order.

        Args:
            number: that press() returned.
        """
        with self._lock:
            return list(self._acknowledged.get(number, ()))

    def stopped(self, number: int) -> bool:
        """Whether a node has acknowledged a stop that suffices to stop the rig: see STOPPERS.

        Args:
            number: that press() returned.
        """
        return not STOPPERS.isdisjoint(self.acknowledged(number))

    def destroy(self) -> None:
        """Give up publisher and subscription; for the executor's thread."""
        self._node.destroy_publisher(self._publisher)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _repeat(self, message: Stop, number: int) -> None:
        until = time.monotonic() + GIVE_UP_S
        lingers = False
        while time.monotonic() < until and self._context.ok():
            time.sleep(REPEAT_S)
            if not lingers and self.acknowledged(number):
                lingers, until = True, min(until, time.monotonic() + LINGER_S)
            if self._is_over(number):
                return
            try:
                self._publisher.publish(message)
            except Exception:
                # The publisher has been destroyed, or the context has ended.
                return

    def _is_over(self, number: int) -> bool:
        """Whether a press has stopped the rig, and a reset has lifted it since."""
        with self._lock:
            lifted = number in self._lifted
        return lifted and self.stopped(number)

    def _hear_mode(self, message: Mode) -> None:
        with self._lock:
            self._lifted.update(self._acknowledged.keys() & {int(n) for n in message.lifted})

    def _hear(self, message: StopReceived) -> None:
        with self._lock:
            nodes = self._acknowledged.get(int(message.number))
            if nodes is not None and message.node not in nodes and len(nodes) < REMEMBERED:
                nodes.append(str(message.node))
