# SPDX-License-Identifier: Apache-2.0
"""The node abb_tracker_bridge against the simulated controller, and the plant with its robot."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from cabols_msgs.msg import LimbState, LoopStatus, Mode
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState

from abb_harness import PATIENCE_S, quiet_port, running_controller, wait_until
from cabols_control.result_code import ResultCode
from cabols_control.ros.live import live_name
from cabols_control.ros.messages.qos import control_qos, latched_qos, topic_qos
from cabols_control.ros.rig_client.calls import RigCalls
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.ros.robot_stream import JointStateBytes
from cabols_sim.devices.link import DeviceLink
from graph_harness import Watcher, next_environment

pytestmark = pytest.mark.ros


def test_joint_states_are_read_by_other_tools():
    names = [f"joint_{i}" for i in range(1, 7)]
    raw = JointStateBytes(names).raw(1_700_000_000_000_000_007, [0.1 * i for i in range(6)])
    store = get_typestore(Stores.ROS2_JAZZY)
    message = store.deserialize_cdr(raw, "sensor_msgs/msg/JointState")
    assert message.name == names
    np.testing.assert_array_equal(message.position, [0.1 * i for i in range(6)])
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 7)


def start(module: str, environment: dict[str, str], **parameters) -> subprocess.Popen:
    arguments = ["--ros-args"]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={value}"]
    path = os.pathsep.join(p for p in sys.path if p)
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        env={**os.environ, "PYTHONPATH": path, **environment},
    )


def end(process: subprocess.Popen, watcher: Watcher) -> None:
    process.kill()
    process.wait()
    watcher.close()


def send_goal(watcher: Watcher, calls: RigCalls, index: int):
    future = calls.send_goal("move_to_configuration", index=index)
    watcher.wait(future.done, "the goal's acceptance")
    return future.result()


def result_of(watcher: Watcher, calls: RigCalls, handle):
    future = calls.result(handle)
    watcher.wait(future.done, "the motion's result")
    return future.result().result


def refusal(watcher: Watcher, calls: RigCalls, index: int) -> int:
    """Code of a goal that is refused: it is accepted, and ended before anything moves."""
    result = result_of(watcher, calls, send_goal(watcher, calls, index))
    assert not result.success
    assert result.message.startswith("refused: ")
    return result.code


def held_refusal(watcher: Watcher, calls: RigCalls) -> str:
    """Why a goal in STOPPED is refused for the cables' sake; empty if it is for another's."""
    result = result_of(watcher, calls, send_goal(watcher, calls, 1))
    return result.message if result.code == ResultCode.WRONG_MODE else ""


def limb_state(closed: int | None = None) -> LimbState:
    """State of eight limbs without zeros, of which one's switch may be closed."""
    nothing = [float("nan")] * 8
    return LimbState(
        limb=list(range(8)),
        wound_length=[0.0] * 8,
        elongation=nothing,
        tension=nothing,
        current=[0.0] * 8,
        switch_closed=[i == closed for i in range(8)],
        zeroed=[False] * 8,
        cable_speed=[0.0] * 8,
        cable_acceleration=[0.0] * 8,
    )


def test_bridge_publishes_moves_refuses_and_reports_silence():
    environment = next_environment()
    watcher = Watcher(int(environment["ROS_DOMAIN_ID"]), ("platform_pose", "loop_status"))
    joints: list[JointState] = []
    watcher.node.create_subscription(JointState, "joint_states", joints.append, control_qos(False))
    modes = watcher.node.create_publisher(Mode, "mode", latched_qos(False))
    live = live_name("limb_state")
    states = watcher.node.create_publisher(LimbState, live, topic_qos(live))
    calls = RigCalls(watcher.node)
    calls.prepare(actions=("move_to_configuration",))
    port = quiet_port()
    poses, reports = watcher.seen["platform_pose"], watcher.seen["loop_status"]
    with running_controller(port) as (clock, controller):
        process = start(
            "cabols_hw.nodes.abb_tracker_bridge",
            environment,
            egm_port=port,
            rws_port=controller.rws.port,
            heartbeat_port=0,
            stale_after=1.0,
            robot_clock="true",
        )
        try:
            watcher.wait(lambda: poses and joints, "poses")
            assert poses[-1].header.frame_id == "rig_base"
            place = poses[-1].pose.position
            np.testing.assert_allclose([place.x, place.y, place.z], clock.robot.position, atol=1e-9)
            np.testing.assert_allclose(joints[-1].position, clock.robot.encoders, atol=1e-12)
            assert list(joints[-1].name) == [f"joint_{i}" for i in range(1, 7)]
            watcher.wait(lambda: calls.ready("move_to_configuration"), "the robot's action")
            refused = result_of(watcher, calls, send_goal(watcher, calls, 1))
            assert (refused.success, refused.code) == (False, ResultCode.NOT_READY)
            assert "no mode received" in refused.message
            modes.publish(Mode(mode=Mode.LOADING))
            wait_until(lambda: modes.get_subscription_count() > 0, "reader of mode")
            watcher.wait(lambda: refusal(watcher, calls, 1) == ResultCode.WRONG_MODE, "LOADING")
            modes.publish(Mode(mode=Mode.STOPPED))
            # Gears hold a cable: nothing would follow the robot.
            states.publish(limb_state(closed=5))
            watcher.wait(lambda: "limb 6 pull" in held_refusal(watcher, calls), "a taut cable")
            states.publish(limb_state())
            assert accepted_at_last(watcher, calls, 1, clock)
            result = watcher.result
            assert result.success, result.message
            np.testing.assert_allclose(result.joints, load_configurations().joints(1), atol=1e-9)
            assert refusal(watcher, calls, 99) == ResultCode.BAD_REQUEST, "no such configuration"
            handle = send_goal(watcher, calls, 5)
            wait_until(lambda: clock.robot.moving, "moving")
            modes.publish(Mode(mode=Mode.FAULT))
            result = result_of(watcher, calls, handle)
            assert not result.success
            assert "FAULT" in result.message
            wait_until(lambda: not clock.robot.moving, "stop")
            assert clock.robot.target_index == -1
            clock.held.set()
            watcher.wait(lambda: reports[-1].state == LoopStatus.FAULT, "the stale pose")
            assert reports[-1].reason == "robot: no EGM packet for 1 s"
            count = len(poses)
            clock.held.clear()
            watcher.wait(lambda: reports[-1].state == LoopStatus.RUNNING, "recovery")
            watcher.wait(lambda: len(poses) > count, "poses again")
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=PATIENCE_S) == 0
        finally:
            calls.close()
            end(process, watcher)


def accepted_at_last(watcher: Watcher, calls: RigCalls, index: int, clock) -> bool:
    """Ask until the node has heard the new mode; leave the result in the watcher."""
    for _ in range(100):
        watcher.result = result_of(watcher, calls, send_goal(watcher, calls, index))
        if watcher.result.code != ResultCode.WRONG_MODE:
            return clock.robot.target_index == index
    return False


def test_plant_serves_its_robot_and_publishes_no_pose():
    environment = next_environment()
    watcher = Watcher(
        int(environment["ROS_DOMAIN_ID"]), ("platform_pose", "limb_state", "loop_status")
    )
    port = quiet_port()
    device = DeviceLink(port)
    device.start()
    process = start("cabols_sim.nodes.plant", environment, robot="true", link_port=port)
    try:
        watcher.wait(lambda: device.newest() is not None and watcher.seen["limb_state"], "truth")
        truth = device.newest()
        np.testing.assert_allclose(truth["position"], [0.0, 1.234615, 0.792718], atol=1e-4)
        device.move(1, 0.5)
        watcher.wait(lambda: device.newest()["moving"], "motion")
        assert int(device.newest()["target_index"]) == 1
        device.halt()
        watcher.wait(lambda: not device.newest()["moving"], "stop")
        assert int(device.newest()["target_index"]) == -1
        assert not watcher.seen["platform_pose"]
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=PATIENCE_S) == 0
    finally:
        device.stop()
        end(process, watcher)
