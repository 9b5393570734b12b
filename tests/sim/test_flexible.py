# SPDX-License-Identifier: Apache-2.0
"""Flexible joints: balance, energy, virtual work, hysteresis, the linear limit."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from cabols_control.errors import OutOfRangeError
from cabols_sim.devices.robot.flexible import FlexibleJoints
from cabols_sim.devices.robot.robot_config import RobotConfig
from cabols_sim.devices.robot.robot_target import RobotTarget

STIFFNESS = [966398.0, 731208.0, 317900.0, 13277.0, 7744.0, 2141.0]
WRENCH = np.array([40.0, -30.0, 35.0, 3.0, -4.0, 2.0])


def settle(robot: RobotTarget, wrench, steps: int = 200) -> None:
    for _ in range(steps):
        robot.step(np.asarray(wrench, dtype=float), 0.001)


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"cubic": [1e12, 1e12, 1e12, 1e10, 1e10, 1e9]},
        {"hysteresis_torque": [5.0, 5.0, 5.0, 1.0, 1.0, 0.5]},
        {"cubic": [1e12] * 6, "hysteresis_torque": [2.0] * 6},
    ],
    ids=["linear", "cubic", "hysteresis", "both"],
)
def test_settled_joints_balance_the_wrench(more):
    robot = RobotTarget(RobotConfig(STIFFNESS, **more))
    settle(robot, WRENCH)
    _, _, jacobian = robot.arm.solve(robot.encoders + robot.deflection)
    wanted = jacobian.T @ WRENCH
    # 40 time constants: what is left is rounding.
    np.testing.assert_allclose(robot._flexible.torque(robot.deflection), wanted, atol=1e-9)
    assert np.abs(robot.deflection).max() > 1e-5


def test_linear_joints_follow_hookes_law():
    robot = RobotTarget(RobotConfig(STIFFNESS))
    small = 0.01 * WRENCH
    start = robot.position.copy()
    settle(robot, small)
    _, _, jacobian = robot.arm.solve(robot.encoders)
    compliance = jacobian @ np.diag(1.0 / np.array(STIFFNESS)) @ jacobian.T
    expected = compliance @ small
    # First order in a deflection of some 1e-6 m: the second is a millionth of it.
    np.testing.assert_allclose(robot.position - start, expected[:3], rtol=1e-4, atol=1e-12)


def test_encoders_do_not_see_the_deflection():
    robot = RobotTarget(RobotConfig(STIFFNESS))
    before = robot.encoders.copy()
    settle(robot, WRENCH)
    np.testing.assert_array_equal(robot.encoders, before)
    np.testing.assert_allclose(robot.joints - before, robot.deflection, atol=1e-15)


@pytest.mark.parametrize("cubic", [0.0, 1e10])
def test_slow_loading_stores_what_the_wrench_does(cubic):
    """Work of the wrench on the platform is the springs' energy (virtual work, no losses)."""
    robot = RobotTarget(RobotConfig(STIFFNESS, cubic=[cubic] * 6))
    # Each position weighed with the trapezium of its wrenches: an error of second order.
    work, levels = 0.0, np.linspace(0.0, 1.0, 201)
    for before, after in itertools.pairwise(levels):
        deflection, joints = robot.deflection, robot.joints.copy()
        settle(robot, after * WRENCH, 60)
        _, _, jacobian = robot.arm.solve(0.5 * (joints + robot.joints))
        twist = jacobian @ (robot.deflection - deflection)
        work += 0.5 * (before + after) * WRENCH @ twist
    x = robot.deflection
    energy = float(np.sum(0.5 * np.array(STIFFNESS) * x**2 + 0.25 * cubic * x**4))
    assert work == pytest.approx(energy, rel=1e-4)
    assert energy > 1e-3


def one_joint(torque_levels, joints: FlexibleJoints) -> np.ndarray:
    """Deflection of joint 5 under a slow torque, with a Jacobian that hands it through."""
    found = []
    for torque in torque_levels:
        for _ in range(100):
            joints.step(np.eye(6), np.array([0.0, 0.0, 0.0, 0.0, torque, 0.0]), 0.001)
        found.append(joints.deflection[4])
    return np.array(found)


def cycle(amplitude: float, points: int = 60) -> np.ndarray:
    up, down = (
        np.linspace(-amplitude, amplitude, points),
        np.linspace(amplitude, -amplitude, points),
    )
    return np.concatenate((up, down[1:]))


def loop_area(torque, deflection) -> float:
    return abs(float(np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(deflection))))


def test_hysteresis_loop_is_closed_and_loses_energy():
    joints = FlexibleJoints(STIFFNESS, hysteresis_torque=[1.0] * 6)
    levels = cycle(5.0)
    one_joint(levels, joints)
    second = one_joint(levels, joints)
    third = one_joint(levels, joints)
    np.testing.assert_allclose(third, second, atol=1e-12)
    assert second[0] == pytest.approx(second[-1], abs=1e-12)
    # Each slider rubs over the whole swing less its own give, both ways: friction times way.
    swing = second.max() - second.min()
    give = 2.0 * 1e-4 * np.arange(1, 5) / 4.0
    expected = float(np.sum(2.0 * 0.25 * (swing - give)))
    assert loop_area(levels, second) == pytest.approx(expected, rel=0.02)


def test_without_hysteresis_the_loop_has_no_area():
    joints = FlexibleJoints(STIFFNESS, cubic=[1e9] * 6)
    levels = cycle(5.0)
    deflection = one_joint(levels, joints)
    full = 5.0 * (deflection.max() - deflection.min())
    # The lag leaves exp(-20) of every step.
    assert loop_area(levels, deflection) < 1e-8 * full


def test_hysteresis_is_stiffer_where_it_turns():
    joints = FlexibleJoints(STIFFNESS, hysteresis_torque=[1.0] * 6)
    loaded, back = one_joint([5.0, 4.9], joints)
    # With all sliders holding, their springs carry, too.
    total = STIFFNESS[4] + float(joints.stiffness[4].sum())
    assert 0.1 / (loaded - back) == pytest.approx(total, rel=1e-6)


def test_stiffness_must_be_positive():
    with pytest.raises(OutOfRangeError, match="linear"):
        FlexibleJoints([0.0] * 6)
    with pytest.raises(OutOfRangeError, match="cubic"):
        FlexibleJoints(STIFFNESS, cubic=[-1.0] + [0.0] * 5)
