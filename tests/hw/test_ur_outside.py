# SPDX-License-Identifier: Apache-2.0
"""The simulated UR controller, seen by other people's client, ur-rtde, where it is installed."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from cabols_hw.ur.robot import UrRobot

rtde_receive = pytest.importorskip("rtde_receive", reason="ur-rtde is not installed")
PORT = 30004
"""ur-rtde knows no other one."""


@pytest.fixture
def controller():
    """A controller in a process of its own: ur-rtde holds Python's lock while it waits."""
    with socket.socket() as probe:
        if probe.connect_ex(("127.0.0.1", PORT)) == 0:
            pytest.skip(f"port {PORT} is taken")
    child = subprocess.Popen(
        [sys.executable, str(Path(__file__).parents[1] / "harness" / "ur_child.py"), str(PORT)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout.readline()

    def ask(what):
        child.stdin.write(what + "\n")
        child.stdin.flush()
        return json.loads(child.stdout.readline())

    yield ask
    child.stdin.close()
    child.wait(10.0)


def test_other_peoples_client_reads_the_same(controller):
    names = ["timestamp", "actual_q", "actual_TCP_pose", "robot_mode", "runtime_state"]
    names += ["safety_mode", "robot_status_bits", "safety_status_bits"]
    names += [f"output_int_register_{k}" for k in range(24, 28)]
    other = rtde_receive.RTDEReceiveInterface("127.0.0.1", 125.0, names)
    assert other.isConnected()
    robot = UrRobot("127.0.0.1")
    give_up = time.monotonic() + 10.0
    sample = None
    while sample is None and time.monotonic() < give_up:
        sample = robot.take(0.2)
    np.testing.assert_allclose(other.getActualQ(), controller("joints"), atol=1e-12)
    np.testing.assert_allclose(other.getActualQ(), sample.joints, atol=1e-12)
    np.testing.assert_allclose(other.getActualTCPPose()[:3], sample.position, atol=1e-9)
    assert other.getRobotMode() == 7
    assert other.getRuntimeState() == 2
    robot.move(3, 20.0, lambda: "", poll_s=0.02)
    while not np.allclose(other.getActualQ(), controller("joints"), atol=1e-12):
        assert time.monotonic() < give_up
        time.sleep(0.01)
    (_, request, _, _), (accepted, finished, error, _) = controller("registers")
    assert (accepted, finished, error) == (request, request, 0)
    robot.close()
    other.disconnect()
