# SPDX-License-Identifier: Apache-2.0
"""The robot stops by itself without the rig's heartbeat; how fast it may be then."""

from __future__ import annotations

import socket
import time
from dataclasses import replace

import numpy as np
import pytest

from abb_harness import quiet_port, running_controller, wait_until
from cabols_control.supervision.held_load import taut_limbs
from cabols_control.supervision.modes import OperatingMode
from cabols_control.supervision.senders import NODES
from cabols_hw.abb.heartbeat import BEAT, MODE_AGE_S, STATE_AGE_S, Heartbeat, Motion, RigHealth
from cabols_hw.abb.speed_limit import FREE_N, allowed_speed
from cabols_hw.safety.config import load_safety
from cabols_sim.devices.abb.rapid import RIG_SILENT

FREE = OperatingMode.FREE_MOVING


def well(now_s=0.0):
    health = RigHealth()
    health.hear_state(now_s)
    health.hear_mode(now_s, FREE)
    return health


def test_rig_is_well_only_with_fresh_states_and_modes():
    assert RigHealth().trouble(0.0)
    health = well()
    assert health.trouble(0.1) == ""
    assert "limb state" in health.trouble(STATE_AGE_S + 0.01)
    health.hear_state(MODE_AGE_S)
    assert "mode" in health.trouble(MODE_AGE_S + 0.01)
    assert health.trouble(float("nan"))


def test_fault_of_the_rig_or_of_a_node_stops_the_heart():
    health = well()
    health.hear_report(0.0, "plant", True)
    assert "plant" in health.trouble(0.0)
    health.hear_report(0.0, "plant", False)
    assert health.trouble(0.0) == ""
    health.hear_mode(0.0, OperatingMode.FAULT)
    assert "FAULT" in health.trouble(0.0)


def test_robot_stands_in_stopped_while_a_cable_pulls():
    """Gears hold what a cut has left: the robot would stretch the cables."""
    tension, zeroed = np.full(8, 6.0), np.ones(8, dtype=bool)
    closed = np.zeros(8, dtype=bool)
    assert taut_limbs(tension, zeroed, closed) == ""
    assert taut_limbs(np.full(8, np.nan), ~zeroed, closed) == ""
    tension[3] = 11.0
    closed[6] = True
    taut = taut_limbs(tension, zeroed, closed)
    assert taut == "limbs 4 and 7"
    health = well()
    health.hear_state(0.0, taut)
    assert health.trouble(0.0) == "", "in FREE_MOVING the cables follow"
    health.hear_mode(0.0, OperatingMode.STOPPED)
    assert "limbs 4 and 7 pull" in health.held()
    assert "limbs 4 and 7 pull" in health.trouble(0.0, moves=True)
    assert health.trouble(0.0) == "", "a robot that stands keeps its heartbeat"
    health.hear_state(0.0)
    assert health.trouble(0.0, moves=True) == health.held() == ""


def test_motion_is_told_from_the_noise_of_a_robot_that_stands():
    random, motion = np.random.default_rng(3), Motion()
    joints = random.normal(size=6)
    told = [motion.hear(0.02 * k, joints + 2e-5 * random.normal(size=6)) for k in range(100)]
    assert not any(told)
    told = [motion.hear(2.0 + 0.02 * k, joints + 0.01 * 0.02 * k) for k in range(100)]
    assert told.index(True) <= 4
    assert all(told[4:])
    motion.hear(10.0, joints)
    assert not motion.hear(10.1, joints)
    assert motion.hear(10.2, joints * np.nan), "what is no number does not stand"


def test_report_of_a_node_that_is_gone_does_not_count_for_ever():
    health = well()
    health.hear_report(-10.0, "gone", True)
    assert health.trouble(0.0) == ""


@pytest.fixture
def moving():
    """A robot on its way, with a heart that the test stops."""
    with running_controller(quiet_port(), watch_port=0) as (clock, controller):
        says = [""]
        heart = Heartbeat("127.0.0.1", controller.watch.port, lambda: says[0])
        heart.start()
        program = controller.program
        try:
            wait_until(lambda: program._rig_well, "the heartbeat")
            go(program, 3)
            wait_until(lambda: asked_again(program, 3) and clock.robot.moving, "the motion")
            yield clock.robot, program, heart, says
        finally:
            heart.stop()


def go(program, index):
    program.set("cabols_target", str(index))
    program.set("cabols_go", "TRUE")


def asked_again(program, index):
    """Ask once more for a motion that a stall of this computer, and so of the heart, has ended."""
    if program.get("cabols_error") == f"{RIG_SILENT}" and program._rig_well:
        go(program, index)
    return True


def stands(robot, program):
    wait_until(lambda: not robot.moving, "standstill")
    wait_until(lambda: program.get("cabols_error") == f"{RIG_SILENT}", "the reason")
    assert not robot.arrived, "it stopped on the way"
    assert program.get("cabols_done") == "FALSE"


def test_robot_stops_when_the_rig_is_not_well(moving):
    robot, program, _, says = moving
    says[0] = "no limb state arrives"
    stands(robot, program)


def test_fault_that_is_known_ends_the_connection(moving):
    """The robot need not wait for the silence."""
    robot, program, heart, says = moving
    says[0] = "the mode is FAULT"
    wait_until(lambda: not heart.connected, "the end of the connection")
    stands(robot, program)
    says[0] = ""
    wait_until(lambda: heart.connected, "a connection")


def test_robot_stops_when_the_connection_ends(moving):
    robot, program, heart, _ = moving
    heart.stop()
    stands(robot, program)


def test_heartbeat_that_comes_back_moves_nothing(moving):
    robot, program, _, says = moving
    says[0] = "silent"
    stands(robot, program)
    says[0] = ""
    wait_until(lambda: program._rig_well, "the heartbeat")
    still = robot.encoders.copy()
    time.sleep(0.2)
    np.testing.assert_array_equal(robot.encoders, still)
    go(program, 2)
    wait_until(
        lambda: asked_again(program, 2) and robot.arrived and robot.target_index == 2,
        "the new demand",
    )


def test_robot_that_is_watched_does_not_begin_without_a_heartbeat():
    with running_controller(quiet_port(), watch_port=0) as (clock, controller):
        go(controller.program, 3)
        wait_until(lambda: controller.program.get("cabols_error") == f"{RIG_SILENT}", "a refusal")
        assert not clock.robot.moving
        # One beat, and then silence, is a heart that stands still.
        with socket.create_connection(("127.0.0.1", controller.watch.port)) as link:
            link.sendall(BEAT)
            wait_until(lambda: controller.program._rig_well, "the beat")
            wait_until(lambda: not controller.program._rig_well, "the silence")


def test_heart_connects_again():
    with running_controller(quiet_port(), watch_port=0) as (_, controller):
        port = controller.watch.port
        heart = Heartbeat("127.0.0.1", port, lambda: "")
        heart.start()
        try:
            wait_until(lambda: heart.connected, "a connection")
            controller.watch.stop()
            wait_until(lambda: not heart.connected, "its loss")
        finally:
            heart.stop()


@pytest.fixture
def allowed(rig, card):
    safety = load_safety()

    def of(brake_s=0.3, tension_max=safety.tension_max, sensor=card.sensor_limits, rig=rig):
        return allowed_speed(rig, tension_max, safety.wrench_max, sensor, brake_s)

    return of


def test_speed_of_the_bench_is_allowed_and_twice_of_it_is_not(allowed):
    assert 0.06 <= allowed() <= 0.12


def test_allowed_speed_holds_the_bounds(allowed, rig, card):
    """By statics of its own: the way at that speed stretches each cable along its line."""
    geometry, speed = rig.geometry, allowed(0.4)
    way = speed * (0.12 + 0.2)
    lines = np.array(geometry.base_points) - (
        np.array(geometry.reference_position)
        + np.array(geometry.platform_points) @ np.array(geometry.reference_rotation).T
    )
    lines /= np.linalg.norm(lines, axis=1)[:, None]
    for direction in np.random.default_rng(3).normal(size=(200, 3)):
        moved = way * direction / np.linalg.norm(direction)
        tension = np.maximum(FREE_N - rig.limbs.stiffness * (lines @ moved), 0.0)
        assert tension.max() <= load_safety().tension_max
        assert np.linalg.norm(tension @ lines) <= np.linalg.norm(card.sensor_limits[:3])


def test_allowed_speed_falls_with_braking_stiffness_and_range(allowed, rig, card):
    assert allowed(0.6) < allowed(0.3)
    assert allowed(tension_max=40.0) < allowed()
    assert allowed(sensor=0.5 * np.array(card.sensor_limits)) < allowed()
    stiff = replace(rig, limbs=replace(rig.limbs, stiffness=2.0 * rig.limbs.stiffness))
    assert allowed(rig=stiff) < allowed()
    assert allowed(sensor=np.full(6, 1.0)) < 0.001


def test_a_flood_of_faults_does_not_grow_what_the_robots_watch_keeps():
    health = RigHealth()
    health.hear_state(1.0)
    health.hear_mode(1.0, OperatingMode.LOADING)
    for k in range(10 * NODES):
        health.hear_report(1.0, f"stranger_{k}", True)
    assert len(health._faults) <= NODES
    assert health.trouble(1.0)
