# SPDX-License-Identifier: Apache-2.0
"""The stop on its topic: repeated, acted on once, held until a supervisor's reset."""

from __future__ import annotations

import threading
import time
from contextlib import suppress

import pytest
import rclpy
from cabols_msgs.msg import Stop
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from cabols_control.ros import transport
from cabols_control.ros.stops import StopLatch, StopReceiver, StopSender
from cabols_control.supervision.modes import Cause, OperatingMode
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
    StopReceiver(graph.node("plant"), heard.append)
    wait(lambda: sender.acknowledged(number) == ["plant"])
    assert heard == ["somebody"]


@pytest.mark.ros
def test_several_senders_and_receivers_act_once_for_each_press(graph):
    acted = {name: [] for name in ("plant", "limb_controller", "supervisor")}
    for name, heard in acted.items():
        StopReceiver(graph.node(name), heard.append)
    senders = [StopSender(graph.node(f"page_{k}")) for k in range(3)]
    numbers = [sender.press(str(k)) for k, sender in enumerate(senders)]
    for sender, number in zip(senders, numbers, strict=True):
        wait(lambda s=sender, n=number: set(s.acknowledged(n)) == set(acted))
    assert all(sorted(heard) == ["0", "1", "2"] for heard in acted.values())


@pytest.mark.ros
def test_memory_is_bounded_under_a_flood(graph):
    node = graph.node("flood")
    receiver = StopReceiver(graph.node("plant"), lambda _: None)
    for number in range(2000):
        receiver._hear(Stop(number=number, sender="x" * 10000))
    assert len(receiver._heard) <= 256
    sender = StopSender(node)
    sender._acknowledged = {k: [] for k in range(256)}
    sender.press("x" * 10000)
    assert len(sender._acknowledged) <= 256


def test_a_latch_holds_until_the_supervisor_was_in_fault_and_was_reset(graph):
    done = []
    latch = StopLatch(
        graph.node("plant"), lambda: done.append("stop"), lambda: done.append("release")
    )
    latch._press("me")
    repeated = [
        (OperatingMode.LOADING, Cause.REQUEST),
        (OperatingMode.STOPPED, Cause.START),
        (OperatingMode.STOPPED, Cause.RESET),
    ]
    for mode, cause in repeated:
        latch.follow(mode, {"cause": cause})
        assert latch.fault is not None, "a reset from before the stop lifts nothing"
    latch.follow(OperatingMode.FAULT, {"cause": Cause.EMERGENCY_STOP})
    latch.follow(OperatingMode.STOPPED, {"cause": Cause.START})
    assert done == ["stop"], "a supervisor that was restarted lifts nothing either"
    latch.follow(OperatingMode.STOPPED, {"cause": Cause.RESET})
    assert done == ["stop", "release"]
    assert latch.fault is None
