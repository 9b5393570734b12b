# SPDX-License-Identifier: Apache-2.0
"""A node in the graph of a running rig: received state, and waits with an end."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import rclpy
from cabols_msgs.msg import LoopStatus, Mode
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from cabols_control.ros.messages import transport
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.reader import Reader
from cabols_control.ros.rig_client.calls import RigCalls
from cabols_control.ros.rig_client.errors import AbandonedError, RigFaultError, RigTimeoutError
from cabols_control.ros.sessions import ModeFilter
from cabols_control.ros.stops import StopSender
from cabols_control.ros.threads.executor_thread import hand_over
from cabols_control.ros.threads.node_executor import NodeExecutor
from cabols_control.supervision.modes import OperatingMode
from cabols_control.supervision.senders import make_room
from cabols_control.topics import LIVE, NAMESPACE, Quality, topic_row

LEAVE_S = 5.0
"""Longest wait for an executor that destroys what the client made [s]."""
FRESH_S = 1.0
"""A sample of a topic at the control rate is newest no longer than this [s]."""


class RigConnection:
    """A node in the graph that receives mode and reports, and waits.

    Attributes:
        calls: services and actions as futures, for what has no method here.
        stops: presses the stop on its topic.
    """

    def __init__(
        self,
        node: Node | None = None,
        *,
        name: str = "rig_client",
        domain: int | None = None,
        namespace: str = NAMESPACE,
        speed: float = 1.0,
        poll_s: float = 0.02,
    ) -> None:
        """Join the graph.

        Args:
            node: an existing node in the rig's namespace, which its owner lets spin in another
                thread; None: a node, an executor and a context of its own.
            name: of the client's own node.
            domain: DDS domain of the client's own context; None: ROS_DOMAIN_ID.
            namespace: of the rig, for the client's own node.
            speed: of the rig's time, below 1 in simulated slow motion: waits for the rig stretch.
            poll_s: period of checks of what no callback reports [s].
        """
        self._speed = min(speed, 1.0)
        self._poll_s = poll_s
        self._news = threading.Condition()
        self._abandoned = threading.Event()
        self._mode: Mode | None = None
        self._filter = ModeFilter()
        self._readers: dict[str, tuple[Reader, Any, int]] = {}
        self._reports: dict[str, LoopStatus] = {}
        self._owned = node is None
        self._node = self._own_node(name, domain, namespace) if node is None else node
        self.calls = RigCalls(self._node)
        self.stops = StopSender(self._node)
        # Reports come often and are polled; a mode wakes waiting threads.
        self._status = Reader(self._node, "loop_status")
        mode = self._node.create_subscription(Mode, "mode", self._hear_mode, topic_qos("mode"))
        self._subscriptions = [self._status.subscription, mode]
        if self._owned:
            self._thread.start()

    def _own_node(self, name: str, domain: int | None, namespace: str) -> Node:
        self._context = rclpy.Context()
        transport.init(context=self._context, domain_id=domain)
        node = rclpy.create_node(name, namespace=namespace, context=self._context)
        self._executor = NodeExecutor(context=self._context)
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._spin, name=name, daemon=True)
        return node

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            while self._context.ok():
                self._executor.spin_once(timeout_sec=0.2)

    def close(self) -> None:
        """Leave the graph."""
        if self._owned:
            self._context.try_shutdown()
            self._thread.join(timeout=5.0)
            self._destroy()
            self._node.destroy_node()
            return
        # An executor must not wait for what is being destroyed: its own thread does it.
        gone = hand_over(self._node, self._destroy)
        give_up = time.monotonic() + LEAVE_S
        while not gone.done() and time.monotonic() < give_up:
            time.sleep(self._poll_s)

    def _destroy(self) -> None:
        self.calls.close()
        self.stops.destroy()
        for reader, *_ in self._readers.values():
            self._node.destroy_subscription(reader.subscription)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._readers, self._subscriptions = {}, []

    def abandon(self) -> None:
        """End every wait, present or later, with an AbandonedError; for another thread."""
        self._abandoned.set()
        self._tell()

    @property
    def node(self) -> Node:
        """The client's node, for what has no method here."""
        return self._node

    @property
    def mode(self) -> OperatingMode | None:
        """Newest mode; None before the first."""
        message = self._mode
        return None if message is None else OperatingMode(message.mode)

    @property
    def mode_message(self) -> Mode | None:
        """The same with reason, cause and number of its pre-tightening."""
        return self._mode

    def _hear_mode(self, message: Mode) -> None:
        if not self._filter.admits(message):
            return
        with self._news:
            self._mode = message
            self._news.notify_all()

    @property
    def reports(self) -> dict[str, LoopStatus]:
        """Newest report of each node."""
        for message in self._status.take():
            make_room(self._reports, message.node)
            self._reports[message.node] = message
        return self._reports

    def wait(
        self,
        condition: Callable[[], bool],
        what: str | Callable[[], str],
        timeout_s: float,
        even_in_fault: bool = False,
    ) -> None:
        """Wait for a condition.

        Args:
            condition: looked at with every mode, report and answer, and every `poll_s`.
            what: that is waited for, for the error.
            timeout_s: longest wait [s].
            even_in_fault: do not give up in FAULT.

        Raises:
            RigTimeoutError: when the time is over.
            RigFaultError: if the rig is in FAULT, unless `even_in_fault`.
            AbandonedError: if the client is abandoned, or its context has ended.
        """
        give_up = time.monotonic() + timeout_s
        while not condition():
            if self._abandoned.is_set() or not self._node.context.ok():
                raise AbandonedError
            if not even_in_fault:
                self.check_fault()
            if not time.monotonic() < give_up:
                text = what if isinstance(what, str) else what()
                raise RigTimeoutError(text, timeout_s, self._standing())
            with self._news:
                self._news.wait(self._poll_s)

    def pause(self, seconds: float) -> None:
        """Let time pass on the rig's clock [s]; raises as wait() does."""
        until = time.monotonic() + seconds / self._speed
        self.wait(
            lambda: time.monotonic() >= until, "time to pass", 2.0 * seconds / self._speed + 1
        )

    def check_fault(self) -> None:
        """Raise a RigFaultError if the rig is in FAULT."""
        message = self._mode
        if message is not None and message.mode == Mode.FAULT:
            raise RigFaultError(message)

    def _standing(self) -> str:
        message = self._mode
        if message is None:
            return "no mode has arrived: is the supervisor running, in this DDS domain?"
        return f"the mode is {OperatingMode(message.mode).name}: {message.reason}"

    def watched(self, future: Any) -> Any:
        """Let wait() look at once when a future is done; return the future."""
        future.add_done_callback(lambda _: self._tell())
        return future

    def _tell(self) -> None:
        with self._news:
            self._news.notify_all()

    def newest(self, topic: str, timeout_s: float = 5.0, live: bool | None = None) -> Any:
        """Return the newest message of a topic; of a sample, one that is at most a second old.

        Args:
            topic: its name in cabols_control.topics.
            timeout_s: longest wait for one [s].
            live: of the topic's slow copy, which costs the control loop nothing; None: where there
                is one.

        Raises:
            RigTimeoutError: if none comes.
        """
        found: list[Any] = []

        def came() -> bool:
            message = self.newest_if_any(topic, live)
            if message is not None:
                found.append(message)
            return bool(found)

        self.wait(came, f"a message of {topic}", timeout_s, even_in_fault=True)
        return found[0]

    def newest_if_any(self, topic: str, live: bool | None = None) -> Any:
        """Return the same without waiting; None if there is none."""
        row = topic_row(topic)
        name = LIVE + topic if (row.live if live is None else live) else topic
        if name not in self._readers:
            self._readers[name] = (Reader(self._node, name), None, 0)
        reader, message, received_ns = self._readers[name]
        for newer, when_ns in reader.take_timed():
            # From now on by a clock that is never set; one that was set back makes nothing younger.
            waited_ns = max(time.time_ns() - when_ns, 0)
            message, received_ns = newer, time.monotonic_ns() - waited_ns
        self._readers[name] = (reader, message, received_ns)
        if message is None or row.quality != Quality.CONTROL:
            return message
        age_ns = time.monotonic_ns() - received_ns
        return message if age_ns <= 1e9 * FRESH_S / self._speed else None
