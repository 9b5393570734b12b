# SPDX-License-Identifier: Apache-2.0
"""What every node does when it starts: it keeps its own time, and speaks if it takes long."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.context import Context
from rclpy.parameter import Parameter

from cabols_control.errors import ConfigError
from cabols_control.ros import node as control_node
from cabols_control.ros.lifetime import slow_start
from cabols_control.ros.lifetime.own_time import keep_own_time
from dds_domains import next_domain

pytestmark = [pytest.mark.ros]


@pytest.fixture
def make():
    context = Context()
    rclpy.init(context=context, domain_id=next_domain())
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


def test_a_loop_that_waits_for_readers_says_for_which(monkeypatch):
    monkeypatch.setattr(control_node, "READERS_QUIET_S", 0.02)
    monkeypatch.setattr(control_node, "READERS_PATIENCE_S", 0.2)
    said = []
    waiting = SimpleNamespace(
        _wanted_readers={"limb_state": "1", "platform_pose": "3"},
        outputs={
            "limb_state": SimpleNamespace(readers=1),
            "platform_pose": SimpleNamespace(readers=2),
        },
        context=SimpleNamespace(ok=lambda: True),
        get_logger=lambda: SimpleNamespace(info=said.append),
    )
    with pytest.raises(TimeoutError, match="platform_pose: expected 3 readers"):
        control_node.ControlNode._wait_for_readers(waiting)
    assert said == ["waits for readers of platform_pose: expected 3, found 2; gives up after 0.2 s"]
