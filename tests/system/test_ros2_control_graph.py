# SPDX-License-Identifier: Apache-2.0
"""Limbs as joints of ros2_control, through the real nodes, with the plugin's messages."""

from __future__ import annotations

import threading
from collections import deque

import numpy as np
import pytest
from cabols_msgs.msg import Mode
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState

from cabols_control.wrench_control.joint_commands import limb_joints, wrench_joints
from graph_harness import run_scenario

pytestmark = [pytest.mark.ros, pytest.mark.timeout(300)]
LIMBS = limb_joints(8)
STEADY = 30
"""States over which tensions stand still: 0.3 s."""
NEAR = 0.5
"""Most that a tension may differ from its setpoint [N]."""


class Plugin:
    """Reads and writes as JointStateTopicSystem: its qualities of service, a command a cycle."""

    def __init__(self, watcher):
        node = watcher.node
        self.state = JointState()
        self.newest = deque(maxlen=STEADY)
        self._names, self._efforts = list(LIMBS), [float("nan")] * 8
        self._publisher = node.create_publisher(
            JointState, "/cabols/limb_joint_commands", QoSProfile(depth=1)
        )
        node.create_subscription(
            JointState, "/cabols/limb_joint_states", self._keep, qos_profile_sensor_data
        )
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    def _keep(self, state):
        self.state = state
        self.newest.append(self.tensions)

    def _write(self):
        while not self._end.wait(0.01):
            self._publisher.publish(JointState(name=self._names, effort=self._efforts))

    def command(self, efforts, names=LIMBS):
        self._names, self._efforts = list(names), [float(x) for x in efforts]

    def steady(self):
        """Whether the tensions stand still, so that they can be compared with later ones."""
        return len(self.newest) == STEADY and np.ptp(list(self.newest), axis=0).max() < NEAR

    def end(self):
        self._end.set()
        self._thread.join()

    @property
    def tensions(self):
        return np.array(self.state.effort[:8])


def test_controllers_lead_the_tensions_and_silence_lets_them_down():
    completed = []

    def near(plugin, wanted):
        return plugin.state.name and np.abs(plugin.tensions - wanted).max() < NEAR

    def scenario(watcher, pids):
        del pids
        plugin = Plugin(watcher)
        watcher.wait(lambda: Mode.LOADING in watcher.modes(), "LOADING")
        plugin.newest.clear()
        watcher.wait(plugin.steady, "limbs at rest: no controller commands them")
        rest = plugin.tensions
        assert tuple(plugin.state.name) == (*LIMBS, *wrench_joints())

        wanted = np.full(8, 20.0)
        plugin.command(wanted)
        watcher.wait(lambda: near(plugin, wanted), "the commanded tensions")

        wanted[2] = 26.0
        plugin.command([26.0 if i == 2 else np.nan for i in range(8)])
        watcher.wait(lambda: near(plugin, wanted), "one limb alone commanded")
        assert np.isfinite(plugin.state.effort[8:]).all(), "the wrench is told, too"

        def refusals():
            return [m.reason for m in watcher.seen["loop_status"] if "cable_9" in m.reason]

        plugin.command([50.0], ["cable_9"])
        watcher.wait(lambda: bool(refusals()), "the refusal of an unknown joint")
        watcher.wait(lambda: near(plugin, rest), "tensions ramped down, as nothing usable came")
        plugin.command(np.full(8, 15.0))
        watcher.wait(lambda: near(plugin, 15.0), "commands taken up again")
        plugin.end()
        watcher.wait(lambda: near(plugin, rest), "tensions ramped down after silence")
        completed.append(True)

    values = {"lockstep": True, "record": False, "ros2_control": True, "auto_start": True}
    _, lines, watcher = run_scenario(values, scenario, ("mode", "loop_status"))
    assert completed, "\n".join(lines[-30:])
    assert Mode.FAULT not in watcher.modes()
    assert not [line for line in lines if "ros2_control_bridge" in line and "rror:" in line]
