# SPDX-License-Identifier: Apache-2.0
"""Robots of seven joints, with a rail, and with a ball bar instead of a tracker.

Kinematics from the makers' data sheets; the loaded robot is a product of homogeneous matrices.
"""

from __future__ import annotations

import numpy as np
import pytest

import independent_arm as arm
from cabols_control.errors import CabolsError
from cabols_stiffness import identify, load_robot
from cabols_stiffness.model.compensation import correct
from cabols_stiffness.model.prediction import predict
from cabols_stiffness.model.result_file import read_result, write_result
from cabols_stiffness.table.laboratory import Stated, to_samples
from cabols_stiffness.table.reading import read_table
from serial_robots import CHAINS, REFLECTOR, STIFFNESS, urdf


def table_of(folder, name, chain, measured, rng, force_n, torque_nm, count=(14, 5)):
    """Write a laboratory's CSV; `measured` makes the last cells of the loaded and unloaded pose."""
    q = rng.uniform(-1.2, 1.2, (count[0], len(chain.joints)))
    wrenches = arm.loads(rng, count[1], force_n, torque_nm)
    header = [f"q{i + 1}_{'m' if s else 'rad'}" for i, (_, _, s) in enumerate(chain.joints)]
    header = ["config", *header, "fx_N", "fy_N", "fz_N", "mx_Nm", "my_Nm", "mz_Nm"]
    lines = []
    for i, joints in enumerate(q):
        start = chain.frames(joints)[0] @ arm.TOOL
        for wrench in wrenches:
            end = chain.settle(joints, wrench, STIFFNESS[name], follows=False)[0]
            noise = rng.normal(size=6) * ([0.5] * 3 + [0.05] * 3)
            names, values = measured(start, end, rng)
            cells = [i, *joints, *(wrench + noise), *values]
            lines.append(",".join(repr(float(cell)) for cell in cells))
    path = folder / f"{name}.csv"
    path.write_text("\n".join([",".join([*header, *names]), *lines]), encoding="utf-8")
    return path


def seen(pose):
    """Reflector of a pose."""
    return pose[:3, :3] @ REFLECTOR + pose[:3, 3]


def displacement(start, end, rng):
    moved = seen(end) - seen(start) + rng.normal(size=3) * 15e-6
    return ["dx_m", "dy_m", "dz_m"], moved


@pytest.mark.parametrize(
    ("name", "force_n", "torque_nm"),
    [("ur10", 60, 15), ("irb6640", 1500, 300), ("kr210", 2000, 400), ("iiwa", 40, 10)],
)
def test_four_robots_are_identified_from_positions(tmp_path, name, force_n, torque_nm):
    path = urdf(tmp_path, name)
    chain = arm.Chain(path)
    robot = load_robot(path, tool_position=arm.TOOL_POSITION)
    rng = np.random.default_rng(3)
    file = table_of(tmp_path, name, chain, displacement, rng, force_n, torque_nm)
    table = read_table(file, robot.n)
    stated = Stated(position_m=15e-6, reflector=REFLECTOR)
    first = identify(to_samples(table, robot, stated), robot, judged=False)
    found = identify(to_samples(table, robot, stated, first), robot)
    assert found.identifiable.all()
    assert found.adequate, found.verdict.reason
    error = (found.stiffness - STIFFNESS[name]) / found.standard_deviation
    assert np.abs(error).max() < 3.0
    assert np.sqrt(np.mean(error**2)) < 1.7
    write_result(tmp_path / "result.yaml", found, robot)
    again = read_result(tmp_path / "result.yaml")
    q, wrench = np.full(robot.n, 0.4), np.array([force_n, 0.0, -force_n, 0.0, 0.0, torque_nm])
    moved = predict(again, robot, q, wrench).deflection
    start = chain.frames(q)[0] @ arm.TOOL
    true = chain.settle(q, wrench, STIFFNESS[name], follows=False)[0]
    np.testing.assert_allclose(
        moved[:3], true[:3, 3] - start[:3, 3], atol=2e-2 * np.abs(moved).max()
    )
    command = correct(again, robot, q, wrench).joints
    reached = chain.settle(command, wrench, STIFFNESS[name], follows=False)[0]
    left = np.linalg.norm(reached[:3, 3] - start[:3, 3])
    assert left < 0.05 * np.linalg.norm(true[:3, 3] - start[:3, 3])
    with pytest.raises(CabolsError, match="expected one of"):
        predict(again, load_robot(), np.full(6, 0.4), wrench)


def test_iiwa_with_a_ball_bar(tmp_path):
    """One length for each load: nothing but the distance to a fixed ball is measured."""
    path = urdf(tmp_path, "iiwa")
    chain, anchor = arm.Chain(path), np.array([0.9, -0.6, 0.1])

    def length(start, end, rng):
        before, after = (np.linalg.norm(seen(pose) - anchor) for pose in (start, end))
        return ["distance_mm"], [1e3 * (after - before) + 5e-3 * rng.normal()]

    rng = np.random.default_rng(4)
    file = table_of(tmp_path, "iiwa", chain, length, rng, 40, 10, (30, 6))
    robot = load_robot(path, tool_position=arm.TOOL_POSITION)
    stated = Stated(position_m=5e-6, reflector=REFLECTOR, anchor=tuple(anchor))
    table = read_table(file, robot.n)
    first = identify(to_samples(table, robot, stated), robot, judged=False)
    found = identify(to_samples(table, robot, stated, first), robot)
    error = (found.stiffness - STIFFNESS["iiwa"]) / found.standard_deviation
    assert found.identifiable.all()
    assert np.abs(error).max() < 3.0
    assert found.degrees_of_freedom == 30 * 6 - 7


def test_rail_can_be_locked(tmp_path):
    path = urdf(tmp_path, "kr210")
    free, held = load_robot(path), load_robot(path, locked={"axis_1": 1.5})
    q = np.array([0.3, -0.4, 0.8, 0.2, 0.5, -0.7])
    np.testing.assert_allclose(held.forward(q)[0], free.forward(np.r_[1.5, q])[0], atol=1e-12)
    with pytest.raises(CabolsError, match="locked"):
        load_robot(path, locked={"jaw": 0.0})


@pytest.mark.parametrize("name", sorted(CHAINS))
def test_kinematics_are_pinocchios(tmp_path, name):
    pinocchio = pytest.importorskip("pinocchio")
    path = urdf(tmp_path, name)
    text = path.read_text(encoding="utf-8").replace('"continuous"', '"revolute"')
    path.write_text(text, encoding="utf-8")
    robot, model = load_robot(path), pinocchio.buildModelFromUrdf(str(path))
    q = np.random.default_rng(1).uniform(-1.0, 1.0, robot.n)
    data, whole = model.createData(), np.r_[q, 0.0]
    frame = model.getFrameId("tool0")
    pinocchio.framesForwardKinematics(model, data, whole)
    position, rotation = robot.forward(q)
    np.testing.assert_allclose(position, data.oMf[frame].translation, atol=1e-12)
    np.testing.assert_allclose(rotation, data.oMf[frame].rotation, atol=1e-12)
    axes = pinocchio.LOCAL_WORLD_ALIGNED
    jacobian = pinocchio.computeFrameJacobian(model, data, whole, frame, axes)[:, : robot.n]
    np.testing.assert_allclose(robot.jacobian(q), jacobian, atol=1e-12)


def test_complementary_stiffness_with_a_rail_is_the_torques_derivative(tmp_path):
    robot = load_robot(urdf(tmp_path, "kr210"))
    random = np.random.default_rng(2)
    q, wrench, step = random.uniform(-1.0, 1.0, 7), random.normal(size=6), 1e-6
    numeric = np.column_stack(
        [
            (robot.jacobian(q + e).T @ wrench - robot.jacobian(q - e).T @ wrench) / (2.0 * step)
            for e in step * np.eye(7)
        ]
    )
    np.testing.assert_allclose(robot.complementary_stiffness(q, wrench), numeric, atol=1e-8)
