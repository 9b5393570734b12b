# SPDX-License-Identifier: Apache-2.0
"""The control loop of a node: one thread on a wait set over raw subscriptions."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile

from cabols_control.cdr import LayoutError
from cabols_control.ros.messages.layout import Layout
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.messages.topics import message_type
from cabols_control.ros.threads.guarded_thread import GuardedThread

IDLE_NS = 50_000_000
GAP_NS = 500_000
"""Silence of the trigger after which the loop reads its other inputs in the pause [ns]."""
LOCKSTEP_PATIENCE_S = 20.0
SLOW_INPUT = 8
"""Cycles between reads of an input of low rate: 8 ms are soon enough for a mode."""


class LoopGroup(CallbackGroup):
    """Keeps a subscription out of the executor: the loop's own wait set serves it."""

    def can_execute(self, entity: Any) -> bool:
        """Report to the executor that nothing is ready."""
        del entity
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Refuse, for the same reason."""
        del entity
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing: nothing was begun."""


def subscribe_aside(
    node: Node, msg_type: type, topic: str, qos: QoSProfile, raw: bool = True
) -> Any:
    """Subscribe without the executor: the caller takes the messages itself."""
    return node.create_subscription(
        msg_type, topic, lambda _: None, qos, callback_group=LoopGroup(), raw=raw
    )


class Input:
    """The newest message of one topic, taken raw.

    Attributes:
        laid_out: newest valid message's bytes, in the layout; empty before the first.
        stamp_ns: its header stamp; -1 before the first.
        dds_sequence: its publication number.
        received_ns: when it was taken, time.monotonic_ns.
        count: valid messages so far.
        lost: publications missing between those that arrived.
        error: why the newest message was refused; empty if it was not.
        raw: newest message's bytes, valid or not.
        judge: whether a message in the layout is for this reader; None: each is. Another one
            leaves no trace here.
        every: number of cycles between two reads of a loop (in lockstep it reads in each cycle).
        awaited: whether a lockstep loop waits for its message of the same stamp.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        layout: Layout,
        lockstep: bool = False,
        depth: int | None = None,
        every: int = 1,
    ) -> None:
        """Subscribe with the topic's quality.

        Args:
            node: owner.
            topic: its name in cabols_control.topics, relative to the namespace.
            layout: of its messages.
            lockstep: whether the graph's clock waits for answers.
            depth: of the queue, where another than the topic's own is wanted.
            every: see above.
        """
        self.topic = topic
        self.every = every
        self.awaited = True
        self._layout = layout
        self._type = layout.msg_type
        qos = topic_qos(topic, lockstep, depth)
        self.subscription = subscribe_aside(node, layout.msg_type, topic, qos)
        self._handle = self.subscription.handle
        # A take from an empty reader costs as much as a full one: with a queue of one, take once.
        self._single = qos.depth == 1
        self.laid_out = b""
        self._record: Any = None
        self.stamp_ns = -1
        self.dds_sequence = 0
        self.received_ns = 0
        self.count = 0
        self.lost = 0
        self.error = ""
        self.raw = b""
        self.judge: Callable[[bytes], bool] | None = None

    @property
    def record(self) -> Any:
        """Newest valid message as a numpy record; None before the first."""
        if self._record is None and self.count:
            self._record = np.frombuffer(self.laid_out, self._layout.dtype, 1)[0]
        return self._record

    def strings(self) -> dict[str, str]:
        """Return the newest message's strings by dotted name; slow."""
        return self._layout.strings(self.raw)

    @property
    def exact(self) -> bool:
        """Whether the newest message has just the layout's strings, e.g. the expected frame."""
        return self._layout.matches(self.raw)

    def take(self) -> bool:
        """Take what has arrived; keep the newest. Returns whether a valid message came."""
        if self._single:
            return self.take_one()
        fresh = False
        while (taken := self._handle.take_message(self._type, True)) is not None:
            fresh = self._accept(*taken) or fresh
        return fresh

    def take_one(self) -> bool:
        """Take the oldest waiting message; none is skipped in a deep queue."""
        taken = self._handle.take_message(self._type, True)
        return taken is not None and self._accept(*taken)

    def _accept(self, raw: bytes, info: dict[str, Any]) -> bool:
        error, laid_out = "", b""
        try:
            laid_out = self._layout.laid_out(raw)
        except LayoutError as caught:
            error = str(caught)
        if self.judge is not None and not error and not self.judge(laid_out):
            return False
        self.received_ns = time.monotonic_ns()
        number = info["publication_sequence_number"]
        if self.dds_sequence and number > self.dds_sequence + 1:
            self.lost += number - self.dds_sequence - 1
        self.dds_sequence = number
        self.error = error
        if error:
            return False
        self.raw = raw
        self.laid_out = laid_out
        self._record = None
        self.stamp_ns = self._layout.stamp_of(self.laid_out)
        self.count += 1
        return True


class Output:
    """A publisher of raw messages."""

    def __init__(self, node: Node, topic: str, lockstep: bool = False) -> None:
        """Advertise with the topic's type and quality.

        Args:
            node: owner.
            topic: its name in cabols_control.topics, relative to the namespace.
            lockstep: whether the graph's clock waits for answers.
        """
        self.topic = topic
        qos = topic_qos(topic, lockstep)
        self._publisher = node.create_publisher(message_type(topic), topic, qos)
        self._publish = self._publisher.handle.publish_raw

    def publish(self, raw: bytes) -> None:
        """Send serialised bytes."""
        self._publish(raw)

    @property
    def readers(self) -> int:
        """Number of matched subscriptions."""
        return int(self._publisher.get_subscription_count())


class ControlLoop(GuardedThread):
    """Runs `step` in its own thread whenever the trigger input brings a message.

    In lockstep a step waits until every companion has a message with the trigger's stamp, so that
    the same inputs meet in every run; otherwise it takes the newest at once. Only the trigger
    wakes the thread: every entity in a wait set costs some 20 us a cycle. Taking a companion's
    message costs as much again and is done in the pause before the trigger; companions without a
    message by then are read again (4 us) when the trigger has arrived.
    """

    def __init__(
        self,
        node: Node,
        trigger: Input,
        companions: Sequence[Input],
        step: Callable[[], None],
        lockstep: bool,
    ) -> None:
        """Prepare; start() begins.

        Args:
            node: owner, for its context.
            trigger: input whose messages start a step.
            companions: the other inputs.
            step: called after new messages have been taken.
            lockstep: see above.
        """
        super().__init__(node.context, "control_loop")
        self._trigger = trigger
        self._companions = tuple(companions)
        self._step = step
        self._lockstep = lockstep
        self._turns = 0
        self._wait_set = make_wait_set(node, 1 + len(self._companions))
        self.prepare: Callable[[], None] = lambda: None
        self.use_pause: Callable[[], None] = lambda: None

    def body(self) -> None:
        """Prepare the thread, then run the cycles."""
        self.prepare()
        while self.running:
            self._turn()

    def _turn(self) -> None:
        if self._lockstep:
            self._turn_in_step()
            return
        turns = self._turns + 1
        due = [c for c in self._companions if turns % c.every == 0]
        wait(self._wait_set, (self._trigger,), GAP_NS)
        if not self._trigger.take():
            due = [c for c in due if not c.take()]
            self.use_pause()
            wait(self._wait_set, (self._trigger,), IDLE_NS)
            if not self._trigger.take():
                return
        self._turns = turns
        for companion in due:
            companion.take()
        self._step()

    def _turn_in_step(self) -> None:
        if not wait_for(self._wait_set, (self._trigger,), IDLE_NS) or not self._trigger.take_one():
            return
        for companion in self._companions:
            companion.take()
        self._wait_for_companions()
        self._step()

    def _wait_for_companions(self) -> None:
        wanted = self._trigger.stamp_ns
        give_up = time.monotonic() + LOCKSTEP_PATIENCE_S
        while missing := [c for c in self._companions if c.awaited and c.stamp_ns < wanted]:
            if not self.running:
                return
            if time.monotonic() > give_up:
                topics = ", ".join(c.topic for c in missing)
                raise TimeoutError(
                    f"lockstep: {topics} did not answer the state at {wanted} ns within "
                    f"{LOCKSTEP_PATIENCE_S:g} s; is every node of the graph running?"
                )
            if wait_for(self._wait_set, missing, IDLE_NS):
                for companion in missing:
                    companion.take()


def make_wait_set(node: Node, inputs: int) -> Any:
    """Return a wait set for a number of subscriptions."""
    return rclpy_implementation.WaitSet(inputs, 0, 0, 0, 0, 0, node.context.handle)


def wait(wait_set: Any, inputs: Sequence[Input], timeout_ns: int) -> None:
    """Wait until an input has a message, or until the timeout; the caller takes from all inputs."""
    wait_set.clear_entities()
    for item in inputs:
        wait_set.add_subscription(item._handle)
    wait_set.wait(timeout_ns)


def wait_for(wait_set: Any, inputs: Sequence[Input], timeout_ns: int) -> bool:
    """Wait until one of the inputs has a message; False after the timeout."""
    wait(wait_set, inputs, timeout_ns)
    return bool(wait_set.get_ready_entities("subscription"))
