# SPDX-License-Identifier: Apache-2.0
"""Robots whose drives are coupled, and arms of few or many joints."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import independent_arm as arm
from cabols_control.errors import CabolsError, ConfigError
from cabols_stiffness import identify, load_robot
from cabols_stiffness.ladder.identified import identify_ladder
from cabols_stiffness.table.command import main

DRIVES = np.eye(6)
DRIVES[2, 1], DRIVES[4, 3], DRIVES[5, 4] = 1.0, 0.2, 0.3
"""Positions of the drives by those of the joints: a parallelogram, a wrist."""
COUPLING = np.linalg.inv(DRIVES)


@pytest.fixture(scope="module")
def samples():
    chain, rng = arm.Chain(), np.random.default_rng(4)
    Q, W = arm.configurations(rng, 6), arm.loads(rng, 5)
    matrix = DRIVES.T @ np.diag(arm.STIFFNESS) @ DRIVES
    columns = arm.truth(Q, W, lambda i, q, w: chain.settle(q, w, matrix))
    return Q, W, matrix, columns


def on_drives(found, robot):
    return replace(found, joints=robot.drives(found.joints))


def test_stiffness_is_that_of_the_drives(samples):
    robot = arm.robot().coupled(COUPLING)
    measured = on_drives(arm.noisy(samples[3], np.random.default_rng(5)), robot)
    found = identify(measured, robot)
    assert found.adequate, found.verdict.reason
    assert np.all(np.abs(found.stiffness - arm.STIFFNESS) < 4.0 * found.standard_deviation)
    with pytest.raises(CabolsError, match="linear or cubic"):
        identify_ladder(measured, robot)


def test_without_the_coupling_it_is_not_adequate(samples):
    assert not identify(arm.noisy(samples[3], np.random.default_rng(5)), arm.robot()).adequate


def test_posture_of_drives_is_the_derivative_of_the_pose():
    robot = arm.robot().coupled(COUPLING)
    drives, wrench = np.array([[0.3, 0.2, -0.4, 0.5, 0.6, -0.2]]), np.arange(6.0)[None] + 1.0
    posture, step = robot.posture(drives), 1e-6
    for j in range(6):
        sides = [robot.posture(drives + sign * step * np.eye(6)[j]) for sign in (-1.0, 1.0)]
        speed = (sides[1].position - sides[0].position) / (2.0 * step)
        np.testing.assert_allclose(posture.speeds[:, j], speed, atol=1e-8)
        slope = (sides[1].torque(wrench) - sides[0].torque(wrench)) / (2.0 * step)
        np.testing.assert_allclose(
            posture.complementary_stiffness(wrench)[:, :, j], slope, atol=1e-6
        )


@pytest.mark.parametrize("matrix", [np.zeros((6, 6)), np.eye(5), "rail"])
def test_a_coupling_that_is_none_is_refused(tmp_path, matrix, lab_csv):
    place = tmp_path / "coupling.yaml"
    content = matrix if isinstance(matrix, str) else matrix.tolist()
    place.write_text(yaml.safe_dump({"joints_by_drives": content}), encoding="utf-8")
    assert main(["identify", str(lab_csv), "--coupling", str(place)]) != 0


@pytest.fixture
def lab_csv():
    return Path(__file__).parent.parent / "cases" / "stiffness" / "lab.csv"


def scara(folder):
    """Four joints of which the third slides, as its parameters are printed."""
    path = folder / "scara.yaml"
    rows = [
        "{name: j1, a_mm: 325, alpha_deg: 0, d_mm: 340, theta_deg: 0}",
        "{name: j2, a_mm: 275, alpha_deg: 180, d_mm: 0, theta_deg: 0}",
        "{name: j3, type: prismatic, a_mm: 0, alpha_deg: 0, d_mm: 0, theta_deg: 0}",
        "{name: j4, a_mm: 0, alpha_deg: 0, d_mm: 50, theta_deg: 0}",
    ]
    joints = "\n".join(f"  - {row}" for row in rows)
    path.write_text(f"name: scara\nconvention: standard\njoints:\n{joints}\n", encoding="utf-8")
    return path


def test_scara_is_identified(tmp_path, capsys):
    """To first order about the pose, by plane geometry that is not the project's."""
    rng, true = np.random.default_rng(2), np.array([4e4, 2e4, 3e6, 3e3])
    rows = []
    for config in range(6):
        q1, q2, q3, q4 = [*rng.uniform(-1.2, 1.2, 2), rng.uniform(0.05, 0.2), rng.uniform(-1, 1)]
        for load in range(8):
            force, moment = rng.uniform(-60, 60, 3), rng.uniform(-8, 8, 3)
            elbow = np.array([0.325 * np.cos(q1), 0.325 * np.sin(q1), 0.0])
            wrist = elbow + np.array([0.275 * np.cos(q1 + q2), 0.275 * np.sin(q1 + q2), 0.0])
            torque = np.array([
                wrist[0] * force[1] - wrist[1] * force[0] + moment[2],
                (wrist - elbow)[0] * force[1] - (wrist - elbow)[1] * force[0] + moment[2],
                -force[2],
                -moment[2],
            ])  # fmt: skip
            deflection = torque / true
            moved = deflection[0] * np.array([-wrist[1], wrist[0], 0.0])
            moved += deflection[1] * np.array([-(wrist - elbow)[1], (wrist - elbow)[0], 0.0])
            moved[2] -= deflection[2]
            turned = np.array([0.0, 0.0, deflection[0] + deflection[1] - deflection[3]])
            moved, turned = moved + 2e-6 * rng.normal(size=3), turned + 8e-6 * rng.normal(size=3)
            joints = [np.degrees(q1), np.degrees(q2), 1e3 * q3, np.degrees(q4)]
            rows.append([config, load, *joints, *force, *moment, *(1e3 * moved), *(1e3 * turned)])
    path = tmp_path / "loads.csv"
    header = "config,load,q1_deg,q2_deg,q3_mm,q4_deg,fx_N,fy_N,fz_N,mx_Nm,my_Nm,mz_Nm,"
    with path.open("w", newline="", encoding="utf-8") as stream:
        stream.write(header + "dx_mm,dy_mm,dz_mm,rx_mrad,ry_mrad,rz_mrad\n")
        csv.writer(stream).writerows([f"{value:.9g}" for value in row] for row in rows)
    words = ["identify", str(path), "--robot", str(scara(tmp_path)), "--deviation-um", "2"]
    words += ["--deviation-urad", "8", "--deviation-n", "0.05", "--deviation-nm", "0.01"]
    assert main(words) == 0, capsys.readouterr()
    joints = yaml.safe_load((tmp_path / "loads" / "result.yaml").read_text("utf-8"))["joints"]
    for joint, stiffness in zip(joints, true, strict=True):
        values = [value for key, value in joint.items() if key.startswith("stiffness")]
        assert values[0] == pytest.approx(stiffness, rel=0.01)


def test_coupling_between_turning_and_sliding_joints_is_refused(tmp_path):
    robot = load_robot(scara(tmp_path), least=1)
    matrix = np.eye(4)
    matrix[2, 3] = 0.1
    with pytest.raises(ConfigError, match="which turn with each other"):
        robot.coupled(matrix)
