# SPDX-License-Identifier: Apache-2.0
"""Processes of one machine talk by UDP: nobody's lock is theirs, and other tools hear them."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from std_msgs.msg import String

from cabols_control.ros.messages.transport import (
    DECISIONS,
    LOOPBACK,
    RANGE,
    UDP,
    discovery_variables,
    udp_variables,
)
from graph_harness import Watcher, next_environment

FAST = "rmw_fastrtps_cpp"
PUBLISHER = """
import time
from pathlib import Path
import rclpy
from std_msgs.msg import String
from cabols_control.ros.messages.transport import init
init()
node = rclpy.create_node("talker", namespace="/cabols")
publisher = node.create_publisher(String, "word", 1)
while True:
    ports = "fastrtps_port" in Path("/proc/self/maps").read_text()
    publisher.publish(String(data="shared memory" if ports else "udp"))
    time.sleep(0.02)
"""


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({}, UDP),
        ({RANGE: "SUBNET"}, UDP),
        ({RANGE: "LOCALHOST"}, {RANGE: "SYSTEM_DEFAULT", **LOOPBACK}),
        # What a parent has set is no choice of the user's.
        ({RANGE: "LOCALHOST", **LOOPBACK, **UDP}, {RANGE: "SYSTEM_DEFAULT", **LOOPBACK}),
        ({RANGE: "LOCALHOST", "ROS_STATIC_PEERS": "192.0.2.7"}, UDP),
        ({RANGE: "LOCALHOST", "FASTDDS_BUILTIN_TRANSPORTS": "SHM"}, {}),
        ({"FASTRTPS_DEFAULT_PROFILES_FILE": "site.xml"}, {}),
        ({"FASTDDS_DEFAULT_PROFILES_FILE": "site.xml"}, {}),
    ],
)
def test_variables(environment, expected):
    assert udp_variables(environment, FAST) == expected


def test_other_middleware_is_left_alone():
    assert udp_variables({RANGE: "LOCALHOST"}, "rmw_cyclonedds_cpp") == {}


@pytest.mark.ros
@pytest.mark.parametrize("reach", ["LOCALHOST", "SUBNET"])
def test_a_plain_tool_receives_from_a_process_without_shared_memory(reach):
    environment = next_environment()
    watcher = Watcher(int(environment["ROS_DOMAIN_ID"]), ())
    heard: list[str] = []
    watcher.node.create_subscription(String, "word", lambda m: heard.append(m.data), 10)
    command = [sys.executable, "-c", PUBLISHER]
    talker = subprocess.Popen(command, env={**os.environ, **environment, RANGE: reach})
    try:
        # Some words are said after the reader was found.
        watcher.wait(lambda: len(heard) > 10, "words")
    finally:
        talker.kill()
        talker.wait()
        watcher.close()
    assert set(heard) == {"udp"}


def test_discovery_stays_on_this_machine_unless_somebody_decides():
    assert discovery_variables({}) == {RANGE: "LOCALHOST"}
    assert discovery_variables({RANGE: ""}) == {RANGE: "LOCALHOST"}
    for name in (RANGE, *DECISIONS):
        assert discovery_variables({name: "SUBNET"}) == {}
