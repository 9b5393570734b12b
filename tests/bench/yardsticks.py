# SPDX-License-Identifier: Apache-2.0
"""What the control loop is compared with: a plain rclpy echo pair and a bare 1 kHz timer.

Run as a program of its own: `yardsticks.py echo`, `yardsticks.py ping SECONDS FIFO` and
`yardsticks.py timer SECONDS FIFO`; ping and timer print one line of JSON.
"""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

PERIOD_NS = 1_000_000
LATE_NS = PERIOD_NS // 2


def set_fifo(priority: int) -> bool:
    """Ask for SCHED_FIFO for all threads; tell whether it was granted."""
    if priority <= 0:
        return False
    try:
        for path in Path("/proc/self/task").iterdir():
            os.sched_setscheduler(int(path.name), os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return False
    return True


def timer(seconds: float, fifo: int) -> None:
    """Sleep to absolute instants, as the simulated card does, and do nothing."""
    set_fifo(fifo)
    origin = time.monotonic_ns()
    behind = []
    tick = 0
    while tick * PERIOD_NS < seconds * 1e9:
        tick += 1
        due = origin + tick * PERIOD_NS
        remaining = due - time.monotonic_ns()
        if remaining > 0:
            time.sleep(1e-9 * remaining)
        late = time.monotonic_ns() - due
        behind.append(late)
        if late > PERIOD_NS:
            skipped = late // PERIOD_NS
            behind += [late] * skipped
            tick += skipped
    print(json.dumps(_summary(np.array(behind), "behind")))


def ping(seconds: float, fifo: int) -> None:
    """Publish at 1 kHz from a timer of an executor; measure the time until the echo."""
    import rclpy
    from cabols_msgs.msg import LimbState, MotorCurrent

    from cabols_control.ros.messages.qos import control_qos

    rclpy.init()
    node = rclpy.create_node("ping")
    sent, trips = {}, []
    publisher = node.create_publisher(LimbState, "ping", control_qos(False))
    message = LimbState(
        limb=list(range(8)),
        wound_length=[0.0] * 8,
        elongation=[0.0] * 8,
        tension=[0.0] * 8,
        current=[0.0] * 8,
        switch_closed=[False] * 8,
        zeroed=[False] * 8,
    )

    def tick() -> None:
        message.sequence += 1
        sent[message.sequence] = time.monotonic_ns()
        publisher.publish(message)

    def echo(answer: MotorCurrent) -> None:
        if answer.sequence in sent:
            trips.append(time.monotonic_ns() - sent.pop(answer.sequence))

    node.create_subscription(MotorCurrent, "echo", echo, control_qos(False))
    while publisher.get_subscription_count() == 0 or node.count_publishers("echo") == 0:
        rclpy.spin_once(node, timeout_sec=0.1)
    set_fifo(fifo)
    node.create_timer(1e-3, tick)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    figures = _summary(np.array(trips), "round_trip")
    figures["lost"] = int(message.sequence) - len(trips)
    print(json.dumps(figures))
    rclpy.shutdown()


def echo(fifo: int) -> None:
    """Answer each ping from an executor's callback."""
    import rclpy
    from cabols_msgs.msg import LimbState, MotorCurrent

    from cabols_control.ros.messages.qos import control_qos

    rclpy.init()
    node = rclpy.create_node("echo")
    publisher = node.create_publisher(MotorCurrent, "echo", control_qos(False))
    answer = MotorCurrent(limb=list(range(8)), current=[0.0] * 8, saturated=[False] * 8)

    def reply(message: LimbState) -> None:
        answer.sequence = message.sequence
        answer.current = message.tension
        publisher.publish(answer)

    node.create_subscription(LimbState, "ping", reply, control_qos(False))
    set_fifo(fifo)
    with suppress(KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        rclpy.spin(node)


def _summary(nanoseconds: np.ndarray, name: str) -> dict[str, float]:
    return {
        f"{name}_median_s": float(np.median(nanoseconds) * 1e-9),
        f"{name}_p99_s": float(np.percentile(nanoseconds, 99) * 1e-9),
        f"{name}_max_s": float(nanoseconds.max() * 1e-9),
        "late_percent": float(100.0 * np.mean(nanoseconds > LATE_NS)),
        "cycles": int(nanoseconds.size),
    }


if __name__ == "__main__":
    kind = sys.argv[1]
    if kind == "echo":
        echo(int(sys.argv[2]))
    else:
        {"timer": timer, "ping": ping}[kind](float(sys.argv[2]), int(sys.argv[3]))
