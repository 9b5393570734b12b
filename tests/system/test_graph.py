# SPDX-License-Identifier: Apache-2.0
"""The real graph: processes, DDS, kills, bad messages, refusals. Lockstep: see test_two_rigs.py."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest
from cabols_msgs.msg import Mode, TensionCommand
from cabols_msgs.srv import SetMode
from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import Trigger

from cabols_hw.bridge.braking import LONGEST_BRAKING_S
from cabols_sim.bench.run import forgiving
from graph_harness import run_scenario

pytestmark = pytest.mark.ros

LOADED = {"auto_start": True, "program": "ramps", "speed": 0.1}
"""Slow motion: a machine that stalls for 10 ms stalls the rig for 1 ms; limits are the rig's."""


def stamp(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def wait_for_load(watcher, amperes=0.02):
    watcher.wait(lambda: Mode.LOADING in watcher.modes(), "LOADING")
    watcher.wait(lambda: max(watcher.seen["limb_state"][-1].tension) > 12.0, "tensions above 12 N")


def zero_after(watcher, instant, brakes=False):
    """Seconds on the bridge's clock from an instant until currents are zero, and stay so.

    With `brakes` a current that pays out counts as none: the bridge brakes before it cuts.
    """
    of = np.max if brakes else (lambda current: np.abs(current).max())
    states = [(stamp(m), of(m.current)) for m in watcher.seen["limb_state"]]
    last_moving = max((t for t, current in states if current > 0.0), default=instant)
    following = [t for t, _ in states if t > last_moving]
    assert following, "no limb state after the last current"
    return following[0] - instant


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("victim", "answers", "reason"),
    [
        ("limb_controller", "motor_current", "no motor_current for limbs"),
        ("wrench_controller", "tension_command", "tension_command is stale"),
    ],
)
def test_killed_controller_leaves_no_current_that_winds_in_within_20_ms(victim, answers, reason):
    def scenario(watcher, pids):
        wait_for_load(watcher)
        os.kill(pids[victim], signal.SIGKILL)
        watcher.wait(lambda: Mode.FAULT in watcher.modes(), "FAULT")
        count = len(watcher.seen["limb_state"])
        watcher.wait(lambda: len(watcher.seen["limb_state"]) > count + 100, "more limb states")

    watched = ("mode", "limb_state", "loop_status", answers)
    ended, _, watcher = run_scenario(LOADED, scenario, watched, keep_going=True)
    assert ended.codes[victim] == -signal.SIGKILL
    last_answer = stamp(watcher.seen[answers][-1])
    assert zero_after(watcher, last_answer, brakes=True) <= 0.020
    assert zero_after(watcher, last_answer) <= 0.020 + LONGEST_BRAKING_S
    fault = next(m for m in watcher.seen["mode"] if m.mode == Mode.FAULT)
    assert reason in fault.reason


def test_services_and_bad_messages():
    """One graph, many mistakes: each is refused or safe, and said."""

    def ask(watcher, mode):
        return watcher.call(SetMode, "set_mode", SetMode.Request(mode=mode))

    def reports(watcher, node):
        return [m.reason for m in watcher.seen["loop_status"] if m.node == node and m.reason]

    def scenario(watcher, pids):
        watcher.wait(
            lambda: (
                {m.node for m in watcher.seen["loop_status"] if m.state == 1}
                >= {"limb_controller", "wrench_controller", "plant"}
            ),
            "all nodes running",
        )
        # The supervisor finds the nodes at its own time.
        watcher.wait(
            lambda: "no report" not in ask(watcher, Mode.LOADING).message,
            "the supervisor to hear all nodes",
        )
        refused = ask(watcher, Mode.LOADING)
        assert not refused.success
        assert "PRETIGHTENING" in refused.message
        assert not ask(watcher, 77).success
        # Tare waits for 200 samples; then the limbs wind in.
        count = len(watcher.seen["limb_state"])
        watcher.wait(lambda: len(watcher.seen["limb_state"]) > count + 300, "the tare")
        assert ask(watcher, Mode.PRETIGHTENING).success
        watcher.wait(lambda: all(watcher.seen["limb_state"][-1].zeroed), "all limbs zeroed")
        # The supervisor looks at the states 50 times a second, so it may know a moment later.
        watcher.wait(lambda: ask(watcher, Mode.LOADING).success, "LOADING to be granted")
        watcher.wait(lambda: Mode.LOADING in watcher.modes(), "LOADING")

        desired = watcher.publisher("desired_wrench")
        bad = WrenchStamped()
        bad.header.frame_id = "rig_base"
        bad.wrench.force.x = float("nan")
        watcher.publish_until(
            desired,
            bad,
            lambda: any("finite" in r for r in reports(watcher, "wrench_controller")),
            "a report on NaN",
        )
        bad.wrench.force.x = 1.0
        bad.header.frame_id = "the_moon"
        watcher.publish_until(
            desired,
            bad,
            lambda: any("the_moon" in r for r in reports(watcher, "wrench_controller")),
            "a report on the frame",
        )
        assert Mode.FAULT not in watcher.modes(), "refused input does not stop a load"

        tension = watcher.publisher("tension_command")
        watcher.publish_until(
            tension,
            TensionCommand(tension=[1.0] * 7, limb=list(range(7))),
            lambda: Mode.FAULT in watcher.modes(),
            "FAULT",
        )
        fault = next(m for m in watcher.seen["mode"] if m.mode == Mode.FAULT)
        assert "expected 8 values, got 7" in fault.reason
        watcher.wait(lambda: not any(watcher.seen["limb_state"][-1].current), "zero current")

        assert not ask(watcher, Mode.PRETIGHTENING).success
        assert watcher.call(Trigger, "reset", Trigger.Request()).success
        assert not watcher.call(Trigger, "reset", Trigger.Request()).success
        assert watcher.call(Trigger, "emergency_stop", Trigger.Request()).success
        watcher.wait(lambda: watcher.modes()[-1] == Mode.FAULT, "FAULT")
        assert watcher.seen["mode"][-1].reason == "emergency stop"

    ended, _, _ = run_scenario({"speed": 0.1, **forgiving(0.1)}, scenario)
    assert ended.first == ""
    assert set(ended.codes.values()) == {0}, "every process ends cleanly on a signal"
