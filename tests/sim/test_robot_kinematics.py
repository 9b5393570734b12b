# SPDX-License-Identifier: Apache-2.0
"""The robot's kinematics against pinocchio and finite differences; its stored configurations."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.errors import CabolsError, ConfigError, ShapeError
from cabols_control.kinematics import structure_matrix
from cabols_control.rig_folder import rig_file
from cabols_control.tension import distribute
from cabols_hw.abb.configurations import load_configurations
from cabols_sim.devices.robot.kinematics import Arm, load_arm
from cabols_sim.devices.robot.robot_checks import check_robot
from cabols_sim.devices.robot.robot_target import NOWHERE, RobotTarget
from cabols_sim.devices.robot.trajectory import duration_s, quintic

# ABB's data sheet, written down independently of the kernel: parent offset and axis of each joint.
URDF_JOINTS = [
    ("0 0 0.4865", "0 0 1"),
    ("0.150 0 0", "0 1 0"),
    ("0 0 0.700", "0 1 0"),
    ("0 0 0", "1 0 0"),
    ("0.600 0 0", "0 1 0"),
    ("0.065 0 0", "1 0 0"),
]


def urdf() -> str:
    parts = ['<robot name="irb1600"><link name="l0"/>']
    for j, (xyz, axis) in enumerate(URDF_JOINTS, 1):
        parts.append(
            f'<link name="l{j}"/><joint name="j{j}" type="revolute"><parent link="l{j - 1}"/>'
            f'<child link="l{j}"/><origin xyz="{xyz}" rpy="0 0 0"/><axis xyz="{axis}"/>'
            '<limit lower="-7" upper="7" effort="1" velocity="1"/></joint>'
        )
    parts.append(
        '<link name="flange"/><joint name="jf" type="fixed"><parent link="l6"/>'
        f'<child link="flange"/><origin xyz="0 0 0" rpy="0 {np.pi / 2} 0"/></joint></robot>'
    )
    return "".join(parts)


@pytest.fixture(scope="module")
def configurations():
    return load_configurations()


@pytest.fixture(scope="module")
def target():
    return RobotTarget()


def random_arm(random) -> Arm:
    return Arm(
        random.uniform(-1.0, 1.0, 3),
        Rotation.random(rng=random).as_matrix(),
        random.uniform(-0.3, 0.3, 3),
        Rotation.random(rng=random).as_matrix(),
    )


def test_pose_and_jacobian_are_pinocchios(random):
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromXML(urdf())
    data = model.createData()
    frame = model.getFrameId("flange")
    for _ in range(20):
        arm = random_arm(random)
        q = random.uniform(-3.0, 3.0, 6)
        pinocchio.computeJointJacobians(model, data, q)
        pinocchio.updateFramePlacements(model, data)
        base = pinocchio.SE3(arm.base_rotation, arm.base_position)
        tool = pinocchio.SE3(arm.tool_rotation, arm.tool_position)
        expected = base * data.oMf[frame] * tool
        position, rotation, jacobian = arm.solve(q)
        np.testing.assert_allclose(position, expected.translation, atol=1e-12)
        np.testing.assert_allclose(rotation, expected.rotation, atol=1e-12)
        local = pinocchio.getFrameJacobian(model, data, frame, pinocchio.ReferenceFrame.LOCAL)
        at_platform = tool.toActionMatrixInverse() @ local
        in_base = np.vstack(
            (expected.rotation @ at_platform[:3], expected.rotation @ at_platform[3:])
        )
        np.testing.assert_allclose(jacobian, in_base, atol=1e-12)


def other_robot(random, joints=6) -> str:
    """URDF of a robot whose joints sit and turn anyhow, with a fixed link between two of them."""
    parts = ['<robot name="other"><link name="l0"/>']
    for j in range(1, joints + 2):
        kind = "fixed" if j == joints + 1 else "revolute"
        numbers = [" ".join(map(repr, map(float, random.uniform(-1, 1, 3)))) for _ in range(3)]
        parts.append(
            f'<link name="m{j}"/><joint name="k{j}" type="fixed"><parent link="l{j - 1}"/>'
            f'<child link="m{j}"/><origin xyz="{numbers[2]}" rpy="0.1 {0.2 * j} -0.3"/></joint>'
            f'<link name="l{j}"/><joint name="j{j}" type="{kind}"><parent link="m{j}"/>'
            f'<child link="l{j}"/><origin xyz="{numbers[0]}" rpy="{numbers[1]}"/>'
            f'<axis xyz="{numbers[2]}"/><limit lower="-7" upper="7" effort="1" velocity="1"/>'
            "</joint>"
        )
    return "".join(parts) + "</robot>"


def test_any_robot_of_six_joints_is_simulated_as_pinocchio_has_it(random, tmp_path):
    pinocchio = pytest.importorskip("pinocchio")
    path = tmp_path / "robot.urdf"
    for _ in range(5):
        path.write_text(other_robot(random))
        model = pinocchio.buildModelFromUrdf(str(path))
        data, q = model.createData(), random.uniform(-3.0, 3.0, 6)
        frame = model.getFrameId("l7")
        pinocchio.computeJointJacobians(model, data, q)
        pinocchio.updateFramePlacements(model, data)
        position, rotation, jacobian = Arm(serial=load_arm(path=path)).solve(q)
        np.testing.assert_allclose(position, data.oMf[frame].translation, atol=1e-12)
        np.testing.assert_allclose(rotation, data.oMf[frame].rotation, atol=1e-12)
        aligned = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        expected = pinocchio.getFrameJacobian(model, data, frame, aligned)
        np.testing.assert_allclose(jacobian, expected, atol=1e-12)


def test_robot_of_seven_joints_is_refused(random, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(other_robot(random, joints=7))
    with pytest.raises(ConfigError, match=r"expected 6 joints that turn.*got 7: j1, j2"):
        load_arm(path=path)


def test_configurations_of_another_robot_are_refused(rig, random, tmp_path, configurations):
    bench = check_robot(RobotTarget().arm, configurations, rig.geometry)
    assert bench.refused == bench.odd == []
    path = tmp_path / "robot.urdf"
    path.write_text(other_robot(random))
    found = check_robot(Arm(serial=load_arm(path=path)), configurations, rig.geometry)
    assert "configuration 1: expected the platform between the cables' base points" in str(found)
    narrow = rig_file("robot.urdf").read_text().replace('upper="2.00', 'upper="-2.0000')
    path.write_text(narrow)
    arm = RobotTarget(serial=load_arm(path=path)).arm
    assert "joint_5: expected -115 to -114.6 deg" in str(
        check_robot(arm, configurations, rig.geometry)
    )


def test_jacobian_is_the_derivative_of_the_pose(random):
    arm, step = random_arm(random), 1e-6
    q = random.uniform(-2.0, 2.0, 6)
    _, rotation, jacobian = arm.solve(q)
    for j in range(6):
        ahead, behind = q.copy(), q.copy()
        ahead[j] += step
        behind[j] -= step
        p1, r1, _ = arm.solve(ahead)
        p0, r0, _ = arm.solve(behind)
        spin = (r1 - r0) / (2.0 * step) @ rotation.T
        omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        # Central differences: error of order step^2 plus rounding over step.
        np.testing.assert_allclose(jacobian[:3, j], (p1 - p0) / (2.0 * step), atol=1e-8)
        np.testing.assert_allclose(jacobian[3:, j], omega, atol=1e-8)


def test_joints_are_checked():
    with pytest.raises(ShapeError, match="joints"):
        Arm().solve([0.0] * 5)
    with pytest.raises(ShapeError, match="finite"):
        Arm().solve([0.0] * 5 + [np.nan])


def test_configuration_zero_is_the_reference_pose(rig, target):
    np.testing.assert_allclose(target.position, rig.geometry.reference_position, atol=1e-9)
    np.testing.assert_allclose(target.rotation, rig.geometry.reference_rotation, atol=1e-9)


def test_configurations_can_be_loaded_by_the_cables(rig, target, configurations):
    corners = [
        np.array(signs) * [40.0, 40.0, 40.0, 4.0, 4.0, 4.0]
        for signs in itertools.product((-1.0, 1.0), repeat=6)
    ]
    assert len(configurations) >= 11
    for index in range(len(configurations)):
        joints = configurations.joints(index)
        limits = target.arm.serial.limits
        assert ((joints > limits[:, 0]) & (joints < limits[:, 1])).all()
        position, rotation, jacobian = target.arm.solve(joints)
        assert np.abs(position - rig.geometry.reference_position).max() <= 0.1
        assert np.rad2deg(Rotation.from_matrix(rotation).magnitude()) <= 10.0
        assert np.linalg.cond(jacobian) < 20.0
        matrix = structure_matrix(rig.geometry, position, rotation)
        assert all(distribute(matrix, w, 1.0, 150.0).feasible for w in corners)


def test_unknown_configuration_is_refused(target, configurations):
    with pytest.raises(
        CabolsError, match=f"expected one of the {len(configurations)} that are stored"
    ):
        target.move_to(len(configurations))


def test_rapid_program_holds_the_same_numbers(configurations):
    module = Path(__file__).resolve().parents[2] / "cabols_hw" / "rapid" / "cabols.mod"
    text = module.read_text(encoding="ascii")
    rows = re.findall(r"\[\[([-\d.,\s]+)\],\s*\[9E9", text)
    found = [[float(v) for v in row.split(",")] for row in rows]
    np.testing.assert_allclose(found, configurations.configurations, atol=1e-9)
    tool = re.search(r"tCabols\s*:=\s*\[TRUE,\s*\[\[([^\]]+)\],\s*\[([^\]]+)\]\]", text)
    position, quaternion = ([float(v) for v in part.split(",")] for part in tool.groups())
    np.testing.assert_allclose(np.array(position) / 1000.0, configurations.tool_position, atol=1e-9)
    np.testing.assert_allclose(quaternion, configurations.tool_quaternion, atol=1e-9)


def test_quintic_rests_at_both_ends():
    assert quintic(0.0) == (0.0, 0.0)
    assert quintic(1.0) == pytest.approx((1.0, 0.0))
    slopes = [quintic(u)[1] for u in np.linspace(0.0, 1.0, 1001)]
    assert max(slopes) == pytest.approx(1.875, abs=1e-4)


def test_motion_keeps_its_limits_and_arrives(configurations):
    robot = RobotTarget()
    dt = 0.004
    assert robot.move_to(1)
    assert not robot.move_to(2), "a second motion must wait"
    poses, joints = [robot.position.copy()], [robot.encoders.copy()]
    for _ in range(5000):
        robot.step(np.zeros(6), dt)
        poses.append(robot.position.copy())
        joints.append(robot.encoders.copy())
        if not robot.moving:
            break
    assert robot.arrived
    assert robot.target_index == 1
    np.testing.assert_array_equal(robot.encoders, configurations.joints(1))
    speeds = np.linalg.norm(np.diff(poses, axis=0), axis=1) / dt
    assert 0.05 < speeds.max() <= 0.0601
    rates = np.diff(joints, axis=0) / dt
    assert np.abs(rates).max() <= 0.5 * 1.001
    assert np.abs(np.diff(rates, axis=0) / dt).max() <= 2.0 * 1.01


def test_stop_brakes_on_the_path_and_is_nowhere(configurations):
    robot = RobotTarget()
    robot.move_to(3)
    for _ in range(1500):
        robot.step(np.zeros(6), 0.001)
    robot.stop()
    for _ in range(101):
        robot.step(np.zeros(6), 0.001)
    assert not robot.moving
    assert robot.target_index == NOWHERE
    assert robot.platform_speed == 0.0
    way = configurations.joints(3) - configurations.joints(0)
    gone = robot.encoders - configurations.joints(0)
    part = gone @ way / (way @ way)
    assert 0.0 < part < 1.0
    np.testing.assert_allclose(gone, part * way, atol=1e-12)


def test_disabled_robot_stops_and_refuses():
    robot = RobotTarget()
    robot.move_to(1)
    robot.disabled = True
    for _ in range(200):
        robot.step(np.zeros(6), 0.001)
    assert not robot.moving
    assert not robot.move_to(2)


def test_duration_obeys_the_joint_limits(target):
    start = target.encoders
    goal = start + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    # Joint 6 turns about the flange's z, on which the platform lies: only the joint limits count.
    by_speed = duration_s(target.arm, start, goal, 10.0, 0.5, 100.0)
    by_acceleration = duration_s(target.arm, start, goal, 10.0, 10.0, 2.0)
    assert by_speed == pytest.approx(1.875 / 0.5)
    assert by_acceleration == pytest.approx(np.sqrt(10.0 / np.sqrt(3.0) / 2.0))
