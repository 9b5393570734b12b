# SPDX-License-Identifier: Apache-2.0
"""The stop on its topic: repeated, acted on once, held until a supervisor's reset."""

from __future__ import annotations

import threading
import time
from contextlib import suppress

import pytest
import rclpy
from cabols_msgs.msg import Mode, Stop
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from cabols_control.ros import stops
from cabols_control.ros.messages import transport
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.stops import StopLatch, StopReceiver, StopSender
from graph_harness import next_environment

PATIENCE_S = 100.0


class Joined:
    """Nodes that spin in a thread, on a domain of their own."""

    def __init__(self, domain):
        self.context = rclpy.Context()
        transport.init(context=self.context, domain_id=domain)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()

    def _spin(self):
        with suppress(ExternalShutdownException):
            while self.context.ok():
                self.executor.spin_once(timeout_sec=0.05)

    def node(self, name):
        found = rclpy.create_node(name, namespace="/cabols", context=self.context)
        self.executor.add_node(found)
        return found

    def close(self):
        self.context.try_shutdown()
        self.thread.join(5.0)


@pytest.fixture
def graph(monkeypatch):
    environment = next_environment()
    for name, text in environment.items():
        monkeypatch.setenv(name, text)
    joined = Joined(int(environment["ROS_DOMAIN_ID"]))
    yield joined
    joined.close()


def wait(condition):
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.005)


@pytest.mark.ros
def test_a_stop_reaches_a_node_that_starts_after_it_was_pressed(graph):
    sender = StopSender(graph.node("console"))
    number = sender.press("somebody")
    heard = []
    StopReceiver(graph.node("plant"), lambda sender, _: heard.append(sender))
    wait(lambda: sender.acknowledged(number) == ["plant"])
    assert heard == ["somebody"]


@pytest.mark.ros
def test_several_senders_and_receivers_act_once_for_each_press(graph):
    acted = {name: [] for name in ("plant", "limb_controller", "supervisor")}
    for name, heard in acted.items():
        StopReceiver(graph.node(name), lambda sender, _, heard=heard: heard.append(sender))
    senders = [StopSender(graph.node(f"page_{k}")) for k in range(3)]
    numbers = [sender.press(str(k)) for k, sender in enumerate(senders)]
    for sender, number in zip(senders, numbers, strict=True):
        wait(lambda s=sender, n=number: set(s.acknowledged(n)) == set(acted))
    assert all(sorted(heard) == ["0", "1", "2"] for heard in acted.values())


@pytest.mark.ros
def test_memory_is_bounded_under_a_flood(graph):
    node = graph.node("flood")
    receiver = StopReceiver(graph.node("plant"), lambda *_: None)
    for number in range(2000):
        receiver._hear(Stop(number=number, sender="x" * 10000))
    assert len(receiver.presses._heard) <= 256
    sender = StopSender(node)
    sender._acknowledged = {k: [] for k in range(256)}
    sender.press("x" * 10000)
    assert len(sender._acknowledged) <= 256


@pytest.mark.ros
def test_a_latch_holds_until_its_own_number_is_lifted(graph):
    done = []
    latch = StopLatch(
        graph.node("plant"), lambda: done.append("stop"), lambda: done.append("release")
    )
    for number in (5, 6):
        latch._hear(Stop(number=number))
    for lifted in ((), (0, 0), (7,), (6, 0)):
        latch.follow(lifted)
        assert latch.number == 5, "what lifts another one lifts nothing here"
    assert done == ["stop", "stop"]
    latch.follow((4, 5))
    assert done == ["stop", "stop", "release"]
    assert latch.number == 0
    latch._hear(Stop(number=6))
    assert done[-1] == "release", "a repetition that comes after its reset stops nothing"


@pytest.mark.ros
def test_each_message_without_a_number_is_a_press(graph):
    heard = []
    receiver = StopReceiver(graph.node("plant"), lambda *press: heard.append(press))
    for _ in range(3):
        receiver._hear(Stop(sender="typed by hand"))
    assert len({number for _, number in heard}) == 3
    assert all(number for _, number in heard)


@pytest.mark.ros
def test_a_press_that_was_lifted_is_repeated_no_more(graph, monkeypatch):
    """A supervisor that starts within a second of its reset does not hear it as a new press."""
    for name in ("LINGER_S", "GIVE_UP_S"):
        monkeypatch.setattr(stops, name, 10.0 * PATIENCE_S)
    before = graph.node("supervisor")
    StopReceiver(before, lambda *_: None)
    modes = before.create_publisher(Mode, "mode", topic_qos("mode"))
    sender = StopSender(graph.node("console"))
    number = sender.press("somebody")
    (repeats,) = [t for t in threading.enumerate() if t.name == f"stop {number}"]
    wait(lambda: sender.stopped(number))

    def start_another(name):
        heard = []
        StopReceiver(graph.node(name), lambda _, number: heard.append(number))
        return heard

    modes.publish(Mode(mode=Mode.STOPPED, lifted=[number ^ 2, *[0] * 7]))
    second = start_another("supervisor_2")
    wait(lambda: second == [number])
    modes.publish(Mode(mode=Mode.STOPPED, lifted=[number, *[0] * 7]))
    wait(lambda: not repeats.is_alive())
    third = start_another("supervisor_3")
    another = sender.press("somebody else")
    wait(lambda: third)
    assert third == [another]
    modes.publish(Mode(mode=Mode.STOPPED, lifted=[number, another, *[0] * 6]))
    wait(lambda: not [t for t in threading.enumerate() if t.name == f"stop {another}"])


@pytest.mark.ros
def test_a_press_is_repeated_until_the_rig_has_stopped_whatever_a_mode_names(graph):
    """Nobody has acknowledged it yet: no mode ends it."""
    sender = StopSender(graph.node("console"))
    number = sender.press("somebody")
    sender._hear_mode(Mode(lifted=[number, *[0] * 7]))
    heard = []
    StopReceiver(graph.node("plant"), lambda _, number: heard.append(number))
    wait(lambda: sender.stopped(number))
    assert heard == [number]


@pytest.mark.ros
def test_lifted_numbers_of_others_are_not_kept(graph):
    sender = StopSender(graph.node("console"))
    for first in range(1, 20000, 8):
        sender._hear_mode(Mode(lifted=list(range(first, first + 8))))
    assert not sender._lifted
