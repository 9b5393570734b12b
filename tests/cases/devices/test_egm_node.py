# SPDX-License-Identifier: Apache-2.0
"""The robot's position stream through the real node: what is refused or odd is said with a cause.

Sources: as in test_egm.py; ros-industrial/abb_libegm PR#87.
"""

from __future__ import annotations

import os
import signal
import subprocess
import time

import pytest

from cabols_control.bringup.processes import executable_path
from egm_packets import PERIOD_S, numbered, udp
from graph_harness import Watcher, next_environment

pytestmark = [pytest.mark.ros, pytest.mark.long]

PACKETS = 750
"""Three seconds."""
RUNNING = 1


def free_port():
    with udp() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def played(packets, *parameters):
    """(state, reason) and x of the poses that the node publishes while packets(k) are sent."""
    environment, port = next_environment(), free_port()
    watcher = Watcher(int(environment["ROS_DOMAIN_ID"]), ("loop_status", "platform_pose"))
    options = [word for p in (f"egm_port:={port}", *parameters) for word in ("-p", p)]
    node = subprocess.Popen(
        [str(executable_path("cabols_hw", "abb_tracker_bridge")), "--ros-args", *options],
        env={**os.environ, **environment},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    senders = [udp(), udp()]
    try:
        watcher.wait(lambda: watcher.seen["loop_status"], "the node")
        due = time.monotonic()
        for k in range(PACKETS):
            for which, data in packets(k):
                senders[which].sendto(data, ("127.0.0.1", port))
            due += PERIOD_S
            time.sleep(max(0.0, due - time.monotonic()))
        count = len(watcher.seen["loop_status"])
        watcher.wait(lambda: len(watcher.seen["loop_status"]) > count, "a report")
    finally:
        node.send_signal(signal.SIGINT)
        node.wait()
        watcher.close()
        for sender in senders:
            sender.close()
    said = {(m.state, m.reason) for m in watcher.seen["loop_status"]}
    return said, [m.pose.position.x for m in watcher.seen["platform_pose"]]


def test_good_packets_run():
    said, poses = played(lambda k: [(0, numbered(k))])
    assert RUNNING in {state for state, _ in said}
    assert len(poses) > PACKETS // 2


@pytest.mark.parametrize(
    ("changes", "parameters"),
    [
        ({"cartesian": False}, ()),
        ({"joints": (0.0,) * 7}, ()),
        ({}, ("egm_address:=192.168.125.1",)),
    ],
    ids=["no Cartesian pose", "seven joints", "another address"],
)
def test_packets_that_are_refused_are_said(changes, parameters):
    said, poses = played(lambda k: [(0, numbered(k, **changes))], *parameters)
    assert not poses
    assert any("packet" in reason for _, reason in said)


def test_second_robot_is_not_published():
    def both(k):
        one = (0, numbered(k, position=(1000.0, 0.0, 1000.0)))
        other = (1, numbered(k, position=(-1500.0, 0.0, 700.0)))
        return [one, other] if k % 2 or not k else [other, one]

    _, poses = played(both)
    assert len({round(x, 1) for x in poses}) == 1


def test_motors_off_is_said():
    said, _ = played(lambda k: [(0, numbered(k, motors=k < 300, rapid=k < 300))])
    assert any("motor" in reason for _, reason in said)
