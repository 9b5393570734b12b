# SPDX-License-Identifier: Apache-2.0
"""Robot model: kinematics against the simulation's and pinocchio's, K_C, moved screws."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cabols_control.errors import ConfigError, ShapeError
from cabols_control.rig_folder import rig_file
from cabols_sim.devices.robot.kinematics import Arm
from cabols_stiffness import load_robot
from cabols_stiffness.model.balance import Law, balance
from cabols_stiffness.model.screws import (
    deflected_arm,
    exponential,
    logarithm,
    shift_deflection,
    shift_wrench,
)

JOINT_LIMITS_DEG = [(-180, 180), (-90, 150), (-245, 65), (-200, 200), (-115, 115), (-400, 400)]
"""Working range of ABB's data sheet."""
TOOL = np.array([0.02, -0.03, 0.15])
TURN = Rotation.from_euler("XYZ", [20, -40, 110], degrees=True).as_matrix()
angles = st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6).map(np.array)
wrenches = st.lists(st.floats(-100.0, 100.0), min_size=6, max_size=6).map(np.array)


@pytest.fixture(scope="module")
def robot():
    return load_robot(tool_position=TOOL, tool_rotation=TURN)


@settings(max_examples=30)
@given(angles)
def test_urdf_agrees_with_the_simulated_arm(q):
    robot, arm = (
        load_robot(tool_position=TOOL, tool_rotation=TURN),
        Arm((0, 0, 0), np.eye(3), TOOL, TURN),
    )
    position, rotation, jacobian = arm.solve(q)
    found = robot.forward(q)
    np.testing.assert_allclose(found[0], position, atol=1e-14)
    np.testing.assert_allclose(found[1], rotation, atol=1e-14)
    np.testing.assert_allclose(robot.jacobian(q), jacobian, atol=1e-14)


def test_joint_limits_are_the_data_sheets(robot):
    np.testing.assert_allclose(np.rad2deg(robot.limits), JOINT_LIMITS_DEG, atol=1e-9)


def test_kinematics_and_k_c_agree_with_pinocchio(robot):
    model = pinocchio.buildModelFromUrdf(str(rig_file("robot.urdf")))
    frame = model.addFrame(
        pinocchio.Frame(
            "tool",
            6,
            model.getFrameId("tool0"),
            model.frames[model.getFrameId("tool0")].placement * pinocchio.SE3(TURN, TOOL),
            pinocchio.FrameType.OP_FRAME,
        )
    )
    data = model.createData()
    random = np.random.default_rng(0)
    for _ in range(5):
        q, wrench, speed = random.uniform(-2, 2, 6), random.normal(size=6), random.normal(size=6)
        aligned = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        pinocchio.computeJointJacobiansTimeVariation(model, data, q, speed)
        pinocchio.updateFramePlacements(model, data)
        jacobian = pinocchio.getFrameJacobian(model, data, frame, aligned)
        np.testing.assert_allclose(robot.jacobian(q), jacobian, atol=1e-13)
        # K_C applied to joint speeds is dJ^T/dt w.
        change = pinocchio.getFrameJacobianTimeVariation(model, data, frame, aligned)
        found = robot.complementary_stiffness(q, wrench) @ speed
        np.testing.assert_allclose(found, change.T @ wrench, atol=1e-12)


@settings(max_examples=20)
@given(angles, wrenches, st.booleans())
def test_jacobian_and_k_c_against_finite_differences(q, wrench, follows):
    robot, offset, eps = load_robot(tool_position=TOOL), np.array([0.1, 0.2, -0.1]), 1e-6
    start = robot.forward(q)[1]

    def pose(x):
        position, rotation = robot.forward(x)
        return position + rotation @ offset, rotation

    def torque(x):
        load = wrench
        if follows:
            change = robot.forward(x)[1] @ start.T
            load = np.concatenate([change @ wrench[:3], change @ wrench[3:]])
        return robot.jacobian(x, offset).T @ load

    jacobian, stiffness = np.empty((6, 6)), np.empty((6, 6))
    for j, unit in enumerate(np.eye(6)):
        (p_up, r_up), (p_down, r_down) = pose(q + eps * unit), pose(q - eps * unit)
        jacobian[:3, j] = (p_up - p_down) / (2 * eps)
        jacobian[3:, j] = logarithm(r_up @ r_down.T) / (2 * eps)
        stiffness[:, j] = (torque(q + eps * unit) - torque(q - eps * unit)) / (2 * eps)
    np.testing.assert_allclose(robot.jacobian(q, offset), jacobian, atol=1e-8)
    found = robot.complementary_stiffness(q, wrench, offset, follows)
    # Rounding of the difference: 1e-16 times torques of 300 N m over 1e-6 rad.
    np.testing.assert_allclose(found, stiffness, atol=1e-6)


@settings(max_examples=20)
@given(angles, wrenches)
def test_spindle_end_is_a_frame_of_its_own(q, wrench):
    """The same load and deflection, told at the tool's origin and at a virtual spindle's end."""
    robot = load_robot(tool_position=TOOL, tool_rotation=TURN)
    spindle = np.array([0.05, 0.0, 0.25])
    end = robot.with_tool(TOOL + TURN @ spindle, TURN)
    law = Law(np.array([9e5, 7e5, 3e5, 1.3e4, 7.7e3, 2.1e3]), np.zeros(6))
    # A sensor's wrench, in the tool's axes: its lever arm is fixed there, deflected or not.
    at_origin = balance(robot, q[None], wrench[None], law, follows=True)
    at_end = balance(end, q[None], shift_wrench(wrench, spindle)[None], law, follows=True)
    np.testing.assert_allclose(at_end.deflection, at_origin.deflection, atol=1e-12)
    # In base axes, the arm is the deflected one.
    before = robot.posture(q[None])
    deflection = np.concatenate(
        [
            (at_origin.posture.position - before.position)[0],
            logarithm(at_origin.posture.rotation @ before.rotation.swapaxes(1, 2))[0],
        ]
    )
    arm = deflected_arm(before.rotation[0] @ spindle, deflection)
    np.testing.assert_allclose(shift_wrench(at_origin.wrench[0], arm), at_end.wrench[0], atol=1e-9)
    moved = shift_deflection(deflection, before.rotation[0] @ spindle)
    np.testing.assert_allclose(
        moved[:3], at_end.posture.position[0] - end.forward(q)[0], atol=1e-12
    )


def test_moved_wrench_does_the_same_work():
    random = np.random.default_rng(1)
    wrench, offset, small = (
        random.normal(size=6),
        random.normal(size=3),
        1e-7 * random.normal(size=6),
    )
    work = wrench @ small
    moved = shift_wrench(wrench, offset) @ shift_deflection(small, offset)
    assert moved == pytest.approx(work, rel=1e-5)


def test_balance_is_an_equilibrium():
    robot = load_robot(tool_position=TOOL)
    law = Law(
        np.array([9e5, 7e5, 3e5, 1.3e4, 7.7e3, 2.1e3]), np.array([1e12, 1e12, 1e12, 1e8, 1e8, 1e7])
    )
    random = np.random.default_rng(2)
    joints = random.uniform(-1.0, 1.0, (8, 6))
    wrench = random.normal(size=(8, 6)) * [80, 80, 80, 8, 8, 8]
    found = balance(robot, joints, wrench, law, follows=False)
    for q, d, w in zip(joints, found.deflection, wrench, strict=True):
        torque = robot.jacobian(q + d).T @ w
        np.testing.assert_allclose(torque, law.cubic * d**3 + law.stiffness * d, atol=1e-7)


def test_exponential_and_logarithm_are_inverse():
    vectors = np.random.default_rng(3).uniform(-1.0, 1.0, (5, 3))
    np.testing.assert_allclose(logarithm(exponential(vectors)), vectors, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": "/nowhere.urdf"}, "nowhere"),
        ({"tool_frame": "hand"}, "expected a frame named 'hand', got"),
        ({"tool_frame": "link_4"}, "behind the last joint"),
    ],
)
def test_bad_robots_are_refused(change, message):
    with pytest.raises(ConfigError, match=message):
        load_robot(**change)


def test_another_number_of_joints_is_refused(tmp_path):
    text = rig_file("robot.urdf").read_text(encoding="utf-8")
    path = tmp_path / "five.urdf"
    path.write_text(text.replace('name="joint_5" type="revolute"', 'name="joint_5" type="fixed"'))
    with pytest.raises(ConfigError, match="chain of 6 revolute joints"):
        load_robot(path)


def test_nan_is_refused(robot):
    with pytest.raises(ShapeError, match="finite"):
        robot.jacobian([0, 0, np.nan, 0, 0, 0])
    with pytest.raises(ShapeError, match="wrench"):
        shift_wrench(np.ones(5), np.zeros(3))
