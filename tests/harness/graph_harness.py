# SPDX-License-Identifier: Apache-2.0
"""Runs the real bench graph while a scenario watches it and interferes."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from cabols_control.bringup.free_domains import claim_domain
from cabols_control.bringup.processes import Ended
from cabols_control.bringup.specs import ONE_BLAS_THREAD
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.topics import Quality, topic_row
from cabols_sim.bench.run import run_bench

PATIENCE_S = 180.0
"""Longest wait for anything: it bounds a test that hangs, and judges no pace."""
ASK_AGAIN_S = 10.0
"""A request without an answer went to a server that was not matched: it is sent again."""


def next_environment() -> dict[str, str]:
    """A DDS domain that no other test uses."""
    return {
        "ROS_DOMAIN_ID": str(claim_domain()),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        **ONE_BLAS_THREAD,
    }


class Watcher:
    """Keeps every message of some topics; runs beside the graph in its own context."""

    def __init__(self, domain: int, watched: tuple[str, ...]) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("watcher", namespace="/cabols", context=self.context)
        self.seen: dict[str, list[Any]] = {topic: [] for topic in watched}
        self.came_s: dict[str, list[float]] = {topic: [] for topic in watched}
        """When each message came, time.monotonic()."""
        for topic in watched:
            self.node.create_subscription(
                topics.TYPES[topic], topic, partial(self._keep, topic), qos(topic)
            )
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _keep(self, topic: str, message: Any) -> None:
        self.came_s[topic].append(time.monotonic())
        self.seen[topic].append(message)

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def publisher(self, topic: str) -> Any:
        """A second publisher on a topic, once somebody reads it."""
        publisher = self.node.create_publisher(topics.TYPES[topic], topic, qos(topic))
        self.wait(lambda: publisher.get_subscription_count() > 0, f"a reader of {topic}")
        return publisher

    def publish_until(
        self, publisher: Any, message: Any, condition: Callable[[], bool], what: str
    ) -> None:
        """Publish again and again until it has had its effect.

        A single sample of a best-effort, keep-last-1 topic may meet a reader that has not matched
        yet, or be replaced by another publisher's before it is read.
        """

        def repeated() -> bool:
            if condition():
                return True
            publisher.publish(message)
            return False

        self.wait(repeated, what)

    def call(self, service_type: Any, name: str, request: Any) -> Any:
        """Call a service and return its answer; a request that is lost is sent again."""
        client = self.node.create_client(service_type, name)
        self.wait(client.service_is_ready, f"the service {name}")
        sent: list[Any] = []
        due = time.monotonic()

        def answered() -> bool:
            nonlocal due
            if time.monotonic() >= due:
                sent.append(client.call_async(request))
                due = time.monotonic() + ASK_AGAIN_S
            return any(future.done() for future in sent)

        self.wait(answered, f"the answer of {name}")
        return next(future for future in sent if future.done()).result()

    def wait(self, condition: Callable[[], bool], what: str, seconds: float = PATIENCE_S) -> None:
        """Wait for a condition; fail with what was waited for.

        A condition that looks at the newest message of a topic that has said nothing yet does not
        hold yet.
        """
        give_up = time.monotonic() + seconds
        while True:
            with suppress(IndexError):
                if condition():
                    return
            assert time.monotonic() < give_up, f"waited {seconds:g} s in vain for {what}"
            time.sleep(0.005)

    def wait_for_states_of(self, mode: Any) -> None:
        """Wait until the limb states have come that a mode's message stands for.

        Two topics have no common order: on a busy computer a mode is often read before the limb
        states that led to it.
        """
        self.wait(
            lambda: stamp_ns(self.seen["limb_state"][-1]) >= stamp_ns(mode),
            "the limb states before a mode",
        )

    def modes(self) -> list[int]:
        """Modes seen so far."""
        return [message.mode for message in self.seen["mode"]]

    def reasons(self, mode: int) -> list[str]:
        """Why a mode was entered, each once, for a failure's message."""
        said = [message.reason for message in self.seen["mode"] if message.mode == mode]
        return list(dict.fromkeys(said))

    def close(self) -> None:
        """Keep what has come but was not read yet, and end the watcher."""
        self._executor.shutdown()
        self._thread.join(timeout=30.0)
        for subscription in self.node.subscriptions:
            with subscription.handle:
                while taken := subscription.handle.take_message(subscription.msg_type, False):
                    subscription.callback(taken[0])
        self.node.destroy_node()
        self.context.try_shutdown()


def stamp_ns(message: Any) -> int:
    """Stamp of a message [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def qos(topic: str) -> Any:
    # The watcher must see every sample, also if it is late itself.
    control = topic_row(topic).quality == Quality.CONTROL
    return topic_qos(topic, depth=5000 if control else None)


def run_scenario(
    values: dict[str, Any],
    scenario: Callable[[Watcher, dict[str, int]], None],
    watched: tuple[str, ...] = ("mode", "limb_state", "motor_current", "loop_status"),
    keep_going: bool = False,
) -> tuple[Ended, list[str], Watcher]:
    """Run the bench; the scenario gets the watcher and the process ids. The graph ends with it.

    Returns:
        How the graph ended, its output lines, and the watcher with all it has seen.
    """
    environment = next_environment()
    watcher = Watcher(int(environment["ROS_DOMAIN_ID"]), watched)
    lines: list[str] = []
    failure: list[BaseException] = []

    def play(pids: dict[str, int]) -> None:
        def body() -> None:
            try:
                scenario(watcher, pids)
            except BaseException as error:
                failure.append(error)
            finally:
                os.kill(os.getpid(), 15)

        threading.Thread(target=body, daemon=True).start()

    try:
        ended = run_bench(
            {"record": False, **values},
            lambda node, line: lines.append(f"{node}: {line}"),
            environment=environment,
            on_start=play,
            keep_going=keep_going,
        )
    finally:
        watcher.close()
    if failure:
        raise AssertionError("\n".join(lines[-30:])) from failure[0]
    return ended, lines, watcher
