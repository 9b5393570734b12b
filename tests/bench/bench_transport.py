# SPDX-License-Identifier: Apache-2.0
"""What a killed reader costs its publisher: Fast DDS's shared memory beside UDP on loopback.

A process publishes at up to 2 kHz while readers of its topic are killed (-9) and started again. A
call of publish() longer than the card's watchdog (10 ms) would have cut a rig's currents.
Then two processes that nobody kills send messages there and back. Both transports take turns.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import select
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import TypedDict

import numpy as np
from bench_realtime import echo_pair
from record import write_figures

from cabols_control.ros.messages.transport import udp_variables
from cabols_sim.bench.run import isolated_environment

LONG_S = 0.010
READERS = 4
LIFE_S = (0.05, 0.3)
"""A reader is killed so long after its first message."""
ECHO_S = 5.0


class Calls(TypedDict):
    """What the calls of publish() took in one round [s]."""

    calls: int
    long: int
    longest_s: float
    median_s: float


def main() -> int:
    """Run, print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/transport.json"))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=30.0, help="of killing, each round")
    parser.add_argument("--role", choices=("publish", "read"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.role:
        {"publish": publish, "read": read}[arguments.role]()
        return 0
    environment = {**os.environ, **isolated_environment()}
    shared = {"FASTDDS_BUILTIN_TRANSPORTS": "DEFAULT"}
    transports = {
        "shared memory": {**environment, **shared},
        "UDP": {**environment, **udp_variables(environment, "rmw_fastrtps_cpp")},
    }
    kills = dict.fromkeys(transports, 0)
    calls: dict[str, list[Calls]] = {name: [] for name in transports}
    trips: dict[str, list[float]] = {name: [] for name in transports}
    for number in range(arguments.rounds):
        for name, variables in transports.items():
            print(f"round {number + 1} of {arguments.rounds}: {name}", flush=True)
            killed, called = kill_readers(variables, arguments.seconds)
            kills[name] += killed
            calls[name].append(called)
            trips[name].append(echo_pair(variables, ECHO_S)["round_trip_median_s"])
    figures = {
        name: {
            "kills": kills[name],
            "calls": sum(c["calls"] for c in calls[name]),
            "long_calls": sum(c["long"] for c in calls[name]),
            "longest_call_s": max(c["longest_s"] for c in calls[name]),
            "median_call_s": float(np.median([c["median_s"] for c in calls[name]])),
            "there_and_back_median_s": float(np.median(trips[name])),
        }
        for name in transports
    }
    write_figures(arguments.output, figures)
    for name, f in figures.items():
        print(
            f"{name:14} {f['kills']:4} readers killed: {f['long_calls']:3} calls of publish() over "
            f"{1e3 * LONG_S:.0f} ms, longest {1e3 * f['longest_call_s']:.0f} ms, median "
            f"{1e6 * f['median_call_s']:.0f} us; there and back "
            f"{1e6 * f['there_and_back_median_s']:.0f} us"
        )
    return 0


def kill_readers(environment: dict[str, str], seconds: float) -> tuple[int, Calls]:
    """Return how many readers were killed, and what publish() took meanwhile."""
    me = [sys.executable, __file__]
    publisher = subprocess.Popen(
        [*me, "--role", "publish"],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    end = time.monotonic() + seconds
    killed = 0
    try:
        while time.monotonic() < end:
            readers = [
                subprocess.Popen(
                    [*me, "--role", "read"], env=environment, stdout=subprocess.PIPE, text=True
                )
                for _ in range(READERS)
            ]
            for reader in readers:
                assert reader.stdout is not None
                reader.stdout.readline()
            time.sleep(random.uniform(*LIFE_S))
            for reader in readers:
                reader.kill()
                reader.wait()
                killed += 1
        output, _ = publisher.communicate(timeout=60.0)
    finally:
        publisher.kill()
    return killed, json.loads(output)


def publish() -> None:
    """Publish a limb state every half millisecond until stdin ends; print Calls as JSON."""
    import rclpy
    from cabols_msgs.msg import LimbState

    from cabols_control.ros.messages.qos import control_qos

    rclpy.init()
    node = rclpy.create_node("publisher")
    output = node.create_publisher(LimbState, "state", control_qos(False))
    took = []
    while not select.select([sys.stdin], [], [], 0.0005)[0]:
        began = time.monotonic()
        output.publish(LimbState())
        took.append(time.monotonic() - began)
    durations = np.array(took)
    called = Calls(
        calls=durations.size,
        long=int(np.sum(durations > LONG_S)),
        longest_s=float(durations.max()),
        median_s=float(np.median(durations)),
    )
    print(json.dumps(called))
    rclpy.shutdown()


def read() -> None:
    """Read until killed; say so at the first message."""
    import rclpy
    from cabols_msgs.msg import LimbState

    from cabols_control.ros.messages.qos import control_qos

    rclpy.init()
    node = rclpy.create_node("reader")
    heard = []

    def hear(message: LimbState) -> None:
        if not heard:
            print("heard", flush=True)
        heard.append(message.sequence)
        answers.publish(message)

    node.create_subscription(LimbState, "state", hear, control_qos(False))
    answers = node.create_publisher(LimbState, "answer", control_qos(False))
    with suppress(KeyboardInterrupt):
        rclpy.spin(node)


if __name__ == "__main__":
    sys.exit(main())
