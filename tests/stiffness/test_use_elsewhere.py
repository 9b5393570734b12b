# SPDX-License-Identifier: Apache-2.0
"""Identified stiffness used outside: springs in simulators' files, corrected programs."""

from __future__ import annotations

import csv
import io
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pytest

import independent_arm as arm
from cabols_control.rig_folder import rig_file
from cabols_stiffness import load_robot
from cabols_stiffness.export.gazebo import to_sdf, to_urdf
from cabols_stiffness.export.mujoco import to_mujoco
from cabols_stiffness.export.springs import springs_of
from cabols_stiffness.model.prediction import predict
from cabols_stiffness.model.result_file import read_result
from cabols_stiffness.table.command import main

CASES = Path(__file__).parent.parent / "cases" / "stiffness"
OPTIONS = ["--tool", "0", "0", "0.15", "--reflector", "0", "0.1", "0.05", "--deviation-um", "21"]
Q = np.array([1.2, 0.3, -0.2, 0.4, 0.8, 0.9])
NEAR, FAR = np.array([[0.1, -0.2, 0.1, 0.3, -0.1, 0.2], [0.0, 0.0, 0.0, 3.0, 0.0, 0.0]])
LOAD = np.array([60.0, -40.0, -50.0, 4.0, -3.0, 5.0])


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """result.yaml of the laboratory's table."""
    folder = tmp_path_factory.mktemp("identified")
    assert main(["identify", str(CASES / "lab.csv"), *OPTIONS, "--output", str(folder)]) == 0
    return folder / "result.yaml"


@pytest.fixture(scope="module")
def result(identified):
    return read_result(identified)


@pytest.fixture(scope="module")
def robot():
    return load_robot(tool_position=arm.TOOL_POSITION)


def test_mujoco_balances_the_load_where_the_prediction_is(result, robot):
    """Springs, torques of the wrench and pose of the tool are MuJoCo's own."""
    springs = springs_of(result, robot)
    model = mujoco.MjModel.from_xml_string(to_mujoco(robot, springs, Q))
    data = mujoco.MjData(model)
    tool = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "tool")
    data.qpos[:] = Q
    mujoco.mj_forward(model, data)
    start = data.site_xpos[tool].copy()
    found = predict(result, robot, Q, LOAD)
    data.qpos[:] = Q + found.joints
    mujoco.mj_forward(model, data)
    by_point, by_turn = np.zeros((3, 6)), np.zeros((3, 6))
    mujoco.mj_jacSite(model, data, by_point, by_turn, tool)
    torque = by_point.T @ LOAD[:3] + by_turn.T @ LOAD[3:]
    np.testing.assert_allclose(data.qfrc_passive, -torque, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(data.site_xpos[tool] - start, found.deflection[:3], atol=1e-10)
    np.testing.assert_allclose(model.jnt_stiffness, result.stiffness, rtol=1e-8)


def test_urdf_keeps_what_it_had_and_gets_springs(tmp_path, result, robot):
    source = rig_file("robot.urdf")
    path = tmp_path / "with_springs.urdf"
    path.write_text(to_urdf(source, robot, springs_of(result, robot), Q), encoding="utf-8")
    again = load_robot(path, tool_position=arm.TOOL_POSITION)
    assert again.kinematics == robot.kinematics
    springs = {
        one.get("reference"): float(one.find("springStiffness").text)
        for one in ET.parse(path).getroot().findall("gazebo")
        if one.find("springStiffness") is not None
    }
    np.testing.assert_allclose([springs[n] for n in robot.joint_names], result.stiffness, rtol=1e-8)
    with pytest.raises(Exception, match="springs of joint_1"):
        to_urdf(path, robot, springs_of(result, robot), Q)


def test_sdf_has_the_chain_and_its_springs(result, robot):
    root = ET.fromstring(to_sdf(robot, springs_of(result, robot), Q))
    joints = {one.get("name"): one for one in root.iter("joint")}
    pose = np.eye(4)
    for j, name in enumerate(robot.joint_names):
        numbers = [float(word) for word in joints[name].find("pose").text.split()]
        roll, pitch, yaw = numbers[3:]
        turned = arm.turn([0, 0, yaw]) @ arm.turn([0, pitch, 0]) @ arm.turn([roll, 0, 0])
        axis = np.array([float(w) for w in joints[name].find("axis/xyz").text.split()])
        pose = pose @ arm.placed(turned, numbers[:3]) @ arm.placed(arm.turn(axis * Q[j]), [0, 0, 0])
        stiffness = float(joints[name].find("axis/dynamics/spring_stiffness").text)
        assert stiffness == pytest.approx(result.stiffness[j], rel=1e-8)
    for name in ("flange", "tool"):
        frame = next(one for one in root.iter("frame") if one.get("name") == name)
        numbers = [float(word) for word in frame.find("pose").text.split()]
        roll, pitch, yaw = numbers[3:]
        turned = arm.turn([0, 0, yaw]) @ arm.turn([0, pitch, 0]) @ arm.turn([roll, 0, 0])
        pose = pose @ arm.placed(turned, numbers[:3])
    np.testing.assert_allclose(pose[:3, 3], robot.forward(Q)[0], atol=1e-12)


@pytest.mark.parametrize("to", ["urdf", "sdf", "mujoco", "csv"])
def test_command_exports(tmp_path, identified, to):
    path = tmp_path / "robot.out"
    words = ["export", str(identified), "--to", to, "--output", str(path)]
    assert main(words) == 0
    assert "stiffness" in path.read_text(encoding="utf-8").lower()
    assert main(words) == 2, "it does not overwrite unasked"
    assert main([*words, "--overwrite"]) == 0


def program(path, rows, header="point,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,speed_mm/s"):
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def point(name, q, speed="v50"):
    return ",".join([name, *(f"{angle:.9f}" for angle in np.degrees(q)), speed])


def test_corrected_program_reaches_its_points(tmp_path, identified, result):
    """The loaded robot is none of the project's code; what is left is the stiffness's error."""
    chain, places = arm.Chain(), [Q, Q + NEAR]
    rows = [point(f"p{i}", q) for i, q in enumerate(places)]
    source = program(tmp_path / "weld.csv", rows)
    words = ["correct", str(source), "--result", str(identified)]
    words += ["--wrench", *(f"{value:g}" for value in LOAD)]
    assert main(words) == 0
    text = (tmp_path / "weld_corrected.csv").read_text(encoding="utf-8")
    found = list(csv.DictReader(io.StringIO(text)))
    assert [row["point"] for row in found] == ["p0", "p1"]
    assert [row["speed_mm/s"] for row in found] == ["v50", "v50"]
    for row, q in zip(found, places, strict=True):
        command = np.radians([float(row[f"q{j}_deg"]) for j in range(1, 7)])
        wanted = (chain.frames(q)[0] @ arm.TOOL)[:3, 3]
        without = chain.settle(q, LOAD, follows=False)[0][:3, 3] - wanted
        left = chain.settle(command, LOAD, follows=False)[0][:3, 3] - wanted
        assert np.linalg.norm(left) < 0.1 * np.linalg.norm(without)
        moved = np.array([float(row[f"moved_{axis}_mm"]) for axis in "xyz"])
        np.testing.assert_allclose(moved, 1e3 * without, atol=0.1 * 1e3 * np.linalg.norm(without))
        shifted = (chain.frames(command)[0] @ arm.TOOL)[:3, 3] - wanted
        shift = np.array([float(row[f"shift_{axis}_mm"]) for axis in "xyz"])
        np.testing.assert_allclose(shift, 1e3 * shifted, atol=2e-5)


def test_wrench_of_each_point_in_other_units(tmp_path, identified):
    header = "q1_rad;q2_rad;q3_rad;q4_rad;q5_rad;q6_rad;fx_kN;fy_N;fz_N;mx_Nm;my_Nm;mz_N mm"
    row = [*Q, 0.06, *LOAD[1:5], 5000.0]
    text = ";".join(f"{value:.9f}".replace(".", ",") for value in row)
    one = program(tmp_path / "one.csv", [text], header)
    other = program(tmp_path / "other.csv", [point("p", Q)])
    common = ["--result", str(identified)]
    load = ["--wrench", *(f"{value:g}" for value in LOAD)]
    assert main(["correct", str(one), *common]) == 0
    assert main(["correct", str(other), *common, *load]) == 0
    a = next(csv.DictReader((tmp_path / "one_corrected.csv").open(encoding="utf-8")))
    b = next(csv.DictReader((tmp_path / "other_corrected.csv").open(encoding="utf-8")))
    for j in range(1, 7):
        assert float(a[f"q{j}_rad"]) == pytest.approx(np.radians(float(b[f"q{j}_deg"])), abs=1e-8)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rows": [point("a", Q), point("far", Q + FAR)]}, "line 3: joints: exp"),
        ({"load": 8.0 * LOAD}, "line 2: wrench: expected one that deflects"),
        ({"result": "ur10_result.yaml"}, "expected one of the robot"),
        ({"load": None}, "expected the wrench either as columns"),
        ({"rows": [point("a", Q).replace("v50", "v50").replace(",", ",x", 1)]}, "line 2: q1_deg"),
        ({"header": "p,q1,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,v"}, "expected a unit"),
    ],
)
def test_what_cannot_be_corrected_writes_nothing(tmp_path, identified, capsys, change, said):
    header = {"header": change["header"]} if "header" in change else {}
    source = program(tmp_path / "p.csv", change.get("rows", [point("a", Q)]), **header)
    result = CASES / change["result"] if "result" in change else identified
    load = change.get("load", LOAD)
    words = ["correct", str(source), "--result", str(result)]
    words += [] if load is None else ["--wrench", *(f"{value:g}" for value in load)]
    assert main(words) == 1
    assert said in capsys.readouterr().err
    assert not (tmp_path / "p_corrected.csv").exists()


@pytest.mark.parametrize("to", ["mujoco", "urdf"])
def test_result_of_another_robot_or_a_bad_fit_is_not_exported(tmp_path, identified, capsys, to):
    text = identified.read_text(encoding="utf-8")
    bad = tmp_path / "result.yaml"
    bad.write_text(text.replace("grade: good", "grade: doubtful"), encoding="utf-8")
    for source in (CASES / "ur10_result.yaml", bad):
        path = tmp_path / "out.xml"
        assert main(["export", str(source), "--to", to, "--output", str(path)]) == 1
        assert "expected" in capsys.readouterr().err
        assert not path.exists()
