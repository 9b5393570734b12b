# SPDX-License-Identifier: Apache-2.0
"""The real nodes under every hostile message of every topic: none ends, and the rig goes on after.

tests/control/test_hostile_messages.py does so in one process, where what is published is judged.
"""

from __future__ import annotations

import time

import pytest
from cabols_msgs.msg import Mode
from cabols_msgs.srv import SetMode
from std_srvs.srv import Trigger

from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.messages.topics import message_type
from cabols_control.topics import LIVE, TOPICS
from graph_harness import run_scenario
from hostile_messages import hostile

pytestmark = [pytest.mark.ros, pytest.mark.long, pytest.mark.timeout(900)]

WANTED = {"limb_controller", "wrench_controller", "plant", "abb_tracker_bridge"}
PAUSE_S = 0.0005
PATIENCE_S = 120.0


def running(watcher, since=0):
    watcher.wait(
        lambda: {m.node for m in watcher.seen["loop_status"][since:] if m.state == 1} >= WANTED,
        "the control path",
    )


def test_nothing_that_anybody_publishes_ends_a_node():
    sent = []

    def scenario(watcher, pids):
        running(watcher)
        for topic, row in TOPICS.items():
            names = (topic, LIVE + topic) if row.live else (topic,)
            for name in names:
                # On a topic that nobody reads, too: somebody may, another time.
                publisher = watcher.node.create_publisher(
                    message_type(topic), name, topic_qos(topic)
                )
                for message in hostile(message_type(topic)):
                    try:
                        publisher.publish(message)
                    except Exception:
                        continue
                    sent.append(name)
                    time.sleep(PAUSE_S)
        heard = len(watcher.seen["loop_status"])
        give_up = time.monotonic() + PATIENCE_S
        granted = False
        while not granted and time.monotonic() < give_up:
            # Strangers' stops and faults are latched: they are reset as a person would.
            watcher.call(Trigger, "reset", Trigger.Request())
            request = SetMode.Request(mode=Mode.PRETIGHTENING)
            granted = watcher.call(SetMode, "set_mode", request).success
            time.sleep(0.2)
        assert granted
        running(watcher, heard)

    values = {"robot": True, "console": True, "pose_estimator": True, "speed": 0.4}
    values |= {"watchdog": 0.1, "command_timeout": 0.1, "stale_after": 0.5, "robot_watch": 0.5}
    ended, lines, _ = run_scenario(values, scenario, ("mode", "limb_state", "loop_status"))
    assert ended.first == "", "\n".join(lines[-30:])
    assert len(sent) > 2000
