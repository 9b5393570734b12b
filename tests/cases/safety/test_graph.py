# SPDX-License-Identifier: Apache-2.0
"""The real nodes: strangers on the rig's topics, kills while the robot moves, Ctrl-C under load.

Sources: ros2_control (a command interface is claimed once), SROS2, the UR driver's
robot_receive_timeout. Each takes a graph of its own.
"""

from __future__ import annotations

import os
import signal
import subprocess
import time

import numpy as np
import pytest
from cabols_msgs.msg import Mode
from cabols_msgs.srv import SetMode
from std_srvs.srv import Trigger

from cabols_control.bringup.processes import executable_path
from cabols_control.ros.rig_client.calls import RigCalls
from graph_harness import run_scenario

pytestmark = [pytest.mark.ros, pytest.mark.long, pytest.mark.timeout(240)]

WATCHED = ("mode", "limb_state", "motor_current", "loop_status", "wrench")
LOADED = {"auto_start": True, "program": "ramps", "speed": 0.2}
BOUND_N = 150.0


def loading(watcher):
    watcher.wait(lambda: Mode.LOADING in watcher.modes(), "LOADING")
    watcher.wait(lambda: max(watcher.seen["limb_state"][-1].tension) > 12.0, "tensions above 12 N")


def running(watcher):
    """Wait until the control path runs, so that nothing is missing but a mode."""
    wanted = {"limb_controller", "wrench_controller", "plant"}
    watcher.wait(
        lambda: {m.node for m in watcher.seen["loop_status"] if m.state == 1} >= wanted,
        "the control path",
    )


def more_states(watcher, count):
    """Wait for so many more limb states, milliseconds of the rig's time."""
    seen = len(watcher.seen["limb_state"])
    watcher.wait(lambda: len(watcher.seen["limb_state"]) > seen + count, "limb states")


def test_mode_that_does_not_exist_ends_no_node():
    def scenario(watcher, pids):
        running(watcher)
        publisher = watcher.publisher("mode")
        for _ in range(20):
            publisher.publish(Mode(mode=99, reason="hello"))
            more_states(watcher, 20)

    try:
        ended, _, _ = run_scenario({}, scenario, WATCHED)
    except AssertionError as error:
        raise AssertionError("the graph has ended") from error
    assert ended.first == ""


def test_strangers_mode_moves_no_motor():
    def scenario(watcher, pids):
        running(watcher)
        publisher = watcher.publisher("mode")
        for _ in range(200):
            newest = watcher.seen["limb_state"][-1].header
            publisher.publish(Mode(header=newest, mode=Mode.PRETIGHTENING, reason="stranger"))
            more_states(watcher, 5)

    _, _, watcher = run_scenario({"speed": 0.5}, scenario, WATCHED)
    current = max(np.abs(m.current).max() for m in watcher.seen["motor_current"])
    assert current == 0.0


def test_second_supervisor_changes_no_mode():
    """It refuses to start; where a busy computer lets it miss the first one, no node follows it."""
    told, followed = [], []

    def scenario(watcher, pids):
        loading(watcher)
        session = watcher.seen["mode"][-1].session
        modes, states = len(watcher.seen["mode"]), len(watcher.seen["limb_state"])
        second = subprocess.Popen(
            [str(executable_path("cabols_control", "supervisor"))],
            env={**os.environ, "ROS_DOMAIN_ID": str(watcher.context.get_domain_id())},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            more_states(watcher, 1500)
        finally:
            second.kill()
            second.wait()
        told.extend(m.mode for m in watcher.seen["mode"][modes:] if m.session == session)
        followed.extend(m.mode for m in watcher.seen["limb_state"][states:])

    # Long watchdogs: who commands is judged, and not this computer's stalls.
    patience = {"watchdog": 0.1, "command_timeout": 0.1, "stale_after": 0.2}
    run_scenario({**LOADED, "program": "multi_axis", **patience}, scenario, WATCHED)
    assert set(told) == {Mode.LOADING}
    assert set(followed) == {Mode.LOADING}


@pytest.mark.parametrize("victim", ["abb_tracker_bridge", "supervisor", "limb_controller"])
def test_robot_stops_when_a_process_is_killed_on_the_way(victim):
    def scenario(watcher, pids):
        running(watcher)
        # Zeros first: without them no limb state knows a tension, and nothing could be judged.
        for mode in (Mode.PRETIGHTENING, Mode.FREE_MOVING):
            request = SetMode.Request(mode=mode)
            watcher.wait(
                lambda request=request: watcher.call(SetMode, "set_mode", request).success,
                "the mode granted",
            )
            watcher.wait(lambda: all(watcher.seen["limb_state"][-1].zeroed), "all limbs zeroed")
        watcher.wait(lambda: watcher.modes()[-1:] == [Mode.FREE_MOVING], "FREE_MOVING")
        more_states(watcher, 500)
        calls = RigCalls(watcher.node)
        watcher.wait(lambda: calls.ready("move_to_configuration"), "the robot")
        sent = calls.send_goal("move_to_configuration", index=2)
        watcher.wait(sent.done, "the motion")
        more_states(watcher, 1200)
        os.kill(pids[victim], signal.SIGKILL)
        more_states(watcher, 5000)

    # In slow motion, so that a stall of a busy computer lets no motor run away.
    values = {"robot": True, "speed": 0.4, "watchdog": 0.1, "command_timeout": 0.1}
    values |= {"stale_after": 0.5, "robot_watch": 0.5}
    _, _, watcher = run_scenario(values, scenario, WATCHED, keep_going=True)
    tensions = [max(m.tension) for m in watcher.seen["limb_state"] if all(m.zeroed)]
    assert len(tensions) > 5000
    assert max(tensions) <= BOUND_N
    assert not any(watcher.seen["limb_state"][-1].current)


PLAYED = ("mode", "motor_current", "tension_command", "wrench", "loop_status", "limb_state")


def play(watcher, recorded, pace):
    """Publish recorded messages in the order in which they came, so many between two pauses."""
    outputs = {topic: watcher.publisher(topic) for topic in PLAYED}
    for number, (_, topic, message) in enumerate(recorded):
        outputs[topic].publish(message)
        if number % pace == 0:
            time.sleep(0.001)


def test_a_bag_of_this_very_session_that_is_played_moves_nothing():
    """A test is recorded, then looked at by playing it: the rig's nodes hear every topic of it."""
    found = {}

    def ask(watcher, mode):
        return watcher.call(SetMode, "set_mode", SetMode.Request(mode=mode)).success

    def scenario(watcher, pids):
        loading(watcher)
        more_states(watcher, 600)
        recorded = sorted(
            (
                (came_s, topic, message)
                for topic in PLAYED
                for came_s, message in zip(watcher.came_s[topic], watcher.seen[topic], strict=False)
            ),
            key=lambda row: row[0],
        )[-4000:]
        modes = {m.mode for _, topic, m in recorded if topic == "mode"}
        assert Mode.LOADING in modes
        watcher.wait(lambda: ask(watcher, Mode.STOPPED), "UNLOADING")
        watcher.wait(lambda: watcher.modes()[-1] == Mode.STOPPED, "STOPPED")
        more_states(watcher, 2500)
        wound = np.array(watcher.seen["limb_state"][-1].wound_length)
        newest = watcher.seen["limb_state"][-1].sequence
        play(watcher, recorded, 2)
        live = [m for m in list(watcher.seen["limb_state"]) if m.sequence > newest]
        found["current"] = max(max(np.abs(m.current)) for m in live)
        found["modes"] = {m.mode for m in live}
        found["way"] = np.abs(np.array(live[-1].wound_length) - wound).max()
        said = [m for m in watcher.seen["loop_status"] if m.dropped]
        found["dropped"] = {m.node for m in said}
        watcher.wait(
            lambda: any("2 publishers" in m.reason for m in watcher.seen["loop_status"]),
            "the second publishers' names",
        )
        # What ends at the latest with the bag: the rig is as before.
        watcher.call(Trigger, "reset", Trigger.Request())
        watcher.wait(lambda: ask(watcher, Mode.PRETIGHTENING), "PRETIGHTENING granted")

    patience = {"watchdog": 0.1, "command_timeout": 0.1, "stale_after": 0.2}
    run_scenario({**LOADED, **patience}, scenario, (*WATCHED, "tension_command"))
    assert found["current"] == 0.0
    assert found["modes"] <= {Mode.STOPPED, Mode.FAULT}
    assert found["way"] < 1e-4
    assert {"plant", "limb_controller"} <= found["dropped"]


def test_ctrl_c_under_load_leads_through_unloading():
    def scenario(watcher, pids):
        loading(watcher)

    _, _, watcher = run_scenario(LOADED, scenario, WATCHED)
    assert max(watcher.seen["limb_state"][-1].tension) < 10.0
