# SPDX-License-Identifier: Apache-2.0
"""What every node does when it starts: it keeps its own time, and speaks if it takes long."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.context import Context
from rclpy.parameter import Parameter
from std_msgs.msg import String

from cabols_control.bringup.free_domains import claim_domain
from cabols_control.errors import ConfigError
from cabols_control.ros import node as control_node
from cabols_control.ros.lifetime import slow_start
from cabols_control.ros.lifetime.own_time import keep_own_time

pytestmark = [pytest.mark.ros]


@pytest.fixture
def make():
    context = Context()
    rclpy.init(context=context, domain_id=claim_domain())
    made = []

    def node(**parameters):
        given = [Parameter(name, value=value) for name, value in parameters.items()]
        made.append(rclpy.create_node("loop", context=context, parameter_overrides=given))
        return made[-1]

    yield node
    for each in made:
        each.destroy_node()
    context.shutdown()


@pytest.mark.parametrize("value", [True, "true", 1])
def test_a_running_node_refuses_simulated_time(make, value):
    node = make()
    node.declare_parameter("site", "")
    keep_own_time(node)
    before = node.get_clock().now().nanoseconds
    (refused,) = node.set_parameters([Parameter("use_sim_time", value=value)])
    assert not refused.successful
    if value is True:
        assert "use_sim_time: expected false, got true" in refused.reason
    assert node.get_parameter("use_sim_time").value is False
    assert node.get_clock().now().nanoseconds >= before > 0
    (kept,) = node.set_parameters([Parameter("use_sim_time", value=False)])
    (other,) = node.set_parameters([Parameter("site", value="here")])
    assert kept.successful
    assert other.successful


def test_a_start_in_simulated_time_is_refused(make):
    with pytest.raises(ConfigError, match=r"use_sim_time: expected false, got true.*leave it out"):
        keep_own_time(make(use_sim_time=True))


@pytest.mark.parametrize("slow", [True, False])
def test_only_a_slow_start_is_spoken_of(slow, capfd):
    with slow_start.told_if_slow(0.05 if slow else 60.0):
        heard = ""
        give_up = time.monotonic() + 60.0
        while slow and "still starting" not in heard and time.monotonic() < give_up:
            time.sleep(0.01)
            heard += "".join(capfd.readouterr())
    heard += "".join(capfd.readouterr())
    assert ("compiles its inner loops first" in heard) is slow
    assert heard.count("still starting") == int(slow)


class Waiting:
    """What ControlNode uses of itself while it waits, on a node of rclpy."""

    _wait_for_readers = control_node.ControlNode._wait_for_readers
    _missing_readers = control_node.ControlNode._missing_readers

    def __init__(self, node, wanted):
        self._node, self._wanted_readers, self.said = node, wanted, []
        publisher = node.create_publisher(String, "limb_state", 10)
        self.outputs = {"limb_state": Readers(publisher)}

    def get_logger(self):
        return SimpleNamespace(info=self.said.append)

    def __getattr__(self, name):
        return getattr(self._node, name)


class Readers:
    def __init__(self, publisher):
        self._publisher = publisher

    @property
    def readers(self):
        return self._publisher.get_subscription_count()


def test_a_loop_waits_for_its_nodes_whoever_else_reads(make, monkeypatch):
    """A tool that listens from the start once stood for a node that was still starting."""
    monkeypatch.setattr(control_node, "READERS_QUIET_S", 0.02)
    monkeypatch.setattr(control_node, "READERS_PATIENCE_S", 2.0)
    waiting = Waiting(make(), {"limb_state": frozenset({"limb_controller", "recorder"})})
    readers = []
    for name in ("rqt_plot", "echo", "recorder"):
        node = rclpy.create_node(name, context=waiting.context)
        node.create_subscription(String, "limb_state", print, 10)
        readers.append(node)
    with pytest.raises(
        TimeoutError, match=r"limb_state: .* within 2 s by .*got no limb_controller"
    ):
        waiting._wait_for_readers()
    assert waiting.said == ["waits for limb_controller to read limb_state; gives up after 2 s"]
    monkeypatch.setattr(control_node, "READERS_PATIENCE_S", 60.0)
    late = rclpy.create_node("limb_controller", context=waiting.context)
    late.create_subscription(String, "limb_state", print, 10)
    waiting._wait_for_readers()
    for node in (*readers, late):
        node.destroy_node()
