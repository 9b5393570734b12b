# SPDX-License-Identifier: Apache-2.0
"""The console's emergency stop, asked right after the supervisor's kill (-9) and restart.

ISO 13850. The killed server's endpoint stays ready until its lease ends: of 16 requests that were
sent once, 8 to 11 went to the dead one and were lost.
"""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import threading

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from cabols_control.console.latest import LatestValues
from cabols_control.ros.console.calls import Calls
from cabols_control.ros.messages import transport
from graph_harness import next_environment

pytestmark = pytest.mark.ros

RESTARTS = 6
SERVER = """
import rclpy
from cabols_control.ros.messages import transport
from std_srvs.srv import Trigger

def answer(request, reply):
    reply.success = True
    return reply

transport.init()
node = rclpy.create_node("supervisor", namespace="/cabols")
node.create_service(Trigger, "emergency_stop", answer)
print("up", flush=True)
rclpy.spin(node)
"""


@pytest.fixture
def environment(monkeypatch):
    found = next_environment()
    for name, text in found.items():
        monkeypatch.setenv(name, text)
    return found


@pytest.fixture
def calls(environment):
    """The console's calls, on a node of their own that spins."""
    context = rclpy.Context()
    transport.init(context=context, domain_id=int(environment["ROS_DOMAIN_ID"]))
    node = rclpy.create_node("console", namespace="/cabols", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    made = Calls(node, LatestValues())
    yield made
    made.close()
    executor.shutdown()
    thread.join()
    node.destroy_node()
    context.try_shutdown()


def start_server(environment):
    path = os.pathsep.join(part for part in sys.path if part)
    child = subprocess.Popen(
        [sys.executable, "-c", SERVER],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment, "PYTHONPATH": path},
    )
    assert child.stdout.readline() == "up\n"
    return child


def test_no_emergency_stop_is_lost_after_a_restart(calls, environment):
    answers = []
    for _ in range(RESTARTS):
        server = start_server(environment)
        try:
            answers.append(asyncio.run(calls.call("emergency_stop", {})))
        finally:
            server.kill()
            server.wait()
    assert [answer.message for answer in answers if not answer.success] == []
