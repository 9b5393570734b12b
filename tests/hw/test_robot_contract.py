# SPDX-License-Identifier: Apache-2.0
"""What every robot has to do for the rig: one test for all controllers that are simulated."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from abb_harness import PATIENCE_S, running_controller, running_ur_controller, wait_until
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.abb.egm.reader import EgmReader
from cabols_hw.abb.errors import MoveAbortedError, RobotError
from cabols_hw.abb.robot import AbbAddress, AbbRobot
from cabols_hw.robot.interface import Capability, Leg, Robot
from cabols_hw.ur.robot import UrRobot

CERTIFICATE = Path(__file__).resolve().parents[1] / "data" / "simulated_controller.pem"
CONTROLLERS = {
    "IRC5": {},
    "OmniCore": {"rws_version": 2, "certificate": str(CERTIFICATE)},
    "UR": {},
}


@pytest.fixture(params=CONTROLLERS.keys())
def bench(request):
    """The simulated arm's clock, the controller, and the rig's client as a Robot."""
    if request.param == "UR":
        with running_ur_controller() as (clock, controller):
            other: Robot = UrRobot("127.0.0.1", controller.rtde.port)
            yield clock, controller, other
            other.close()
        return
    reader = EgmReader(0)
    with running_controller(reader.port, **CONTROLLERS[request.param]) as (clock, controller):
        robot: Robot = AbbRobot(AbbAddress(controller.rws.url, "Default User", "robotics"), reader)
        yield clock, controller, robot
        robot.close()


def test_capabilities_are_told(bench):
    info = bench[2].info()
    assert info.axes == 6
    assert info.maker
    assert Capability.STREAM | Capability.MOVE | Capability.STOP in info.capabilities


def test_stream_is_of_now_and_in_si_units(bench):
    clock, _, robot = bench
    wait_until(lambda: robot.take(0.1) is not None, "stream")
    sample = robot.take(PATIENCE_S)
    np.testing.assert_allclose(sample.joints, clock.robot.encoders, atol=1e-9)
    assert np.linalg.norm(sample.position) < 3.0
    assert np.linalg.norm(sample.quaternion) == pytest.approx(1.0)
    assert sample.motors_on
    newer = robot.take(PATIENCE_S)
    assert newer.sequence > sample.sequence
    assert newer.received_s >= sample.received_s


def test_motion_ends_at_the_stored_configuration(bench):
    clock, _, robot = bench
    robot.move(3, PATIENCE_S, lambda: "", poll_s=0.02)
    np.testing.assert_allclose(clock.robot.encoders, load_configurations().joints(3), atol=1e-12)


def test_interruption_stops_and_the_next_motion_is_obeyed(bench):
    clock, _, robot = bench
    with pytest.raises(MoveAbortedError, match="why not"):
        robot.move(5, PATIENCE_S, lambda: "why not" if clock.robot.moving else "", poll_s=0.02)
    wait_until(lambda: not clock.robot.moving, "stand")
    robot.move(1, PATIENCE_S, lambda: "", poll_s=0.02)
    assert clock.robot.target_index == 1


def test_stop_of_another_thread_ends_a_motion(bench):
    clock, _, robot = bench
    failures = []

    def move():
        try:
            robot.move(5, PATIENCE_S, lambda: "", poll_s=0.02)
        except RobotError as error:
            failures.append(error)

    thread = threading.Thread(target=move)
    thread.start()
    wait_until(lambda: clock.robot.moving, "motion")
    robot.stop()
    wait_until(lambda: not clock.robot.moving, "stand")
    thread.join(PATIENCE_S)
    assert failures


def test_interruption_before_the_beginning_moves_nothing(bench):
    clock, _, robot = bench
    before = clock.robot.encoders.copy()
    with pytest.raises(MoveAbortedError, match="not begun"):
        robot.move(5, PATIENCE_S, lambda: "no")
    np.testing.assert_array_equal(clock.robot.encoders, before)


@pytest.mark.parametrize("index", [13, 99])
def test_unknown_configuration_is_refused(bench, index):
    with pytest.raises(RobotError, match="configuration"):
        bench[2].move(index, PATIENCE_S, lambda: "", poll_s=0.02)


def test_motors_off_is_in_the_stream_and_refuses_motions(bench):
    clock, controller, robot = bench
    wait_until(lambda: clock.link.clients, "link")
    controller.program.set_motors(False)

    def off():
        sample = robot.take(0.1)
        return sample is not None and not sample.motors_on

    wait_until(off, "motors off")
    with pytest.raises(RobotError, match="motor"):
        robot.move(1, PATIENCE_S, lambda: "", poll_s=0.02)


@pytest.fixture
def leading(bench):
    """A bench whose robot can be led; another one refuses, and stands."""
    clock, _, robot = bench
    if Capability.LEAD in robot.info().capabilities:
        return bench
    before = clock.robot.encoders.copy()
    with pytest.raises(RobotError, match="follows no path"):
        robot.lead(leg_to(3), PATIENCE_S, lambda: "")
    np.testing.assert_array_equal(clock.robot.encoders, before)
    pytest.skip("this robot cannot be led")


def leg_to(index, speed=0.05):
    return Leg(load_configurations().joints(index), speed, 0.15)


def test_a_leg_ends_at_its_joints(leading):
    clock, _, robot = leading
    robot.lead(leg_to(3), PATIENCE_S, lambda: "", poll_s=0.02)
    # Angles go to the controller as decimal degrees.
    assert clock.robot.encoders == pytest.approx(load_configurations().joints(3), abs=1e-7)
    robot.move(1, PATIENCE_S, lambda: "", poll_s=0.02)
    assert clock.robot.target_index == 1


def test_a_leg_is_as_fast_as_stated(leading):
    clock, _, robot = leading
    peak = 0.0

    def watch():
        nonlocal peak
        peak = max(peak, clock.robot.platform_speed)
        return ""

    robot.lead(leg_to(3, speed=0.03), PATIENCE_S, watch, poll_s=0.005)
    assert 0.02 < peak <= 0.03 * 1.001


def test_an_interrupted_leg_stops_the_robot(leading):
    clock, _, robot = leading
    with pytest.raises(MoveAbortedError, match="enough"):
        robot.lead(
            leg_to(5, 0.02), PATIENCE_S, lambda: "enough" if clock.robot.moving else "", 0.01
        )
    wait_until(lambda: not clock.robot.moving, "stop")
    away = np.abs(clock.robot.encoders - load_configurations().joints(5)).max()
    assert away > 1e-3


@pytest.mark.parametrize("speed", [0.0005, 0.3])
def test_the_program_bounds_a_legs_speed_itself(leading, speed):
    clock, _, robot = leading
    before = clock.robot.encoders.copy()
    with pytest.raises(RobotError, match="allows no motion under load at this speed"):
        robot.lead(leg_to(3, speed), PATIENCE_S, lambda: "", poll_s=0.02)
    np.testing.assert_array_equal(clock.robot.encoders, before)
