# SPDX-License-Identifier: Apache-2.0
"""The description for ros2_control: read by others, and with what the plugin reads."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pinocchio
import pytest

from cabols_control.geometry import load_geometry
from cabols_control.kinematics import structure_matrix
from cabols_control.rig_tools.rig_urdf import main
from cabols_control.wrench_control.joint_commands import limb_joints, wrench_joints


@pytest.fixture(scope="module")
def text(tmp_path_factory):
    path = tmp_path_factory.mktemp("urdf") / "rig.urdf"
    assert main(["--ros2-control", "--output", str(path)]) == 0
    return path.read_text(encoding="utf-8")


def test_limbs_slide_along_their_cables(text):
    model = pinocchio.buildModelFromXML(text)
    data = model.createData()
    pinocchio.forwardKinematics(model, data, pinocchio.neutral(model))
    geometry = load_geometry()
    structure = structure_matrix(geometry, geometry.reference_position, geometry.reference_rotation)
    for i, name in enumerate(limb_joints(geometry.cables)):
        joint = model.getJointId(name)
        pinocchio.computeJointJacobians(model, data, pinocchio.neutral(model))
        along = pinocchio.getJointJacobian(model, data, joint, pinocchio.WORLD)[
            :3, model.idx_vs[joint]
        ]
        # A cable pulls the platform towards its anchor, the way it is wound in.
        np.testing.assert_allclose(along, structure[:3, i], atol=1e-12)
        np.testing.assert_allclose(data.oMi[joint].translation, geometry.base_points[i], atol=1e-12)


def test_mujoco_reads_it(text):
    model = mujoco.MjModel.from_xml_string(text)
    names = {model.joint(i).name for i in range(model.njnt)}
    assert {*limb_joints(8), *wrench_joints()} <= names


def test_joints_of_the_tags_are_joints_of_the_robot(text):
    """As the controller manager checks: each is there, once, and none is fixed."""
    root = ET.fromstring(text)
    moving = [j.get("name") for j in root.findall("joint") if j.get("type") != "fixed"]
    systems = {system.get("name"): system for system in root.findall("ros2_control")}
    assert {system.get("type") for system in systems.values()} == {"system"}
    told = [joint.get("name") for s in systems.values() for joint in s.findall("joint")]
    assert sorted(told) == sorted([*limb_joints(8), *wrench_joints()])
    assert set(told) <= set(moving)
    limbs = systems["limbs"]
    for joint in limbs.findall("joint"):
        assert [c.get("name") for c in joint.findall("command_interface")] == ["effort"]
    parameters = {p.get("name"): p.text for p in limbs.find("hardware").findall("param")}
    assert parameters["joint_states_topic"] == "/cabols/limb_joint_states"
    assert parameters["joint_commands_topic"] == "/cabols/limb_joint_commands"
    assert float(parameters["trigger_joint_command_threshold"]) < 0
    others = systems["platform_wrench"]
    assert not others.findall("joint/command_interface")


def test_without_the_option_nothing_moves_but_the_robot(tmp_path):
    path = tmp_path / "plain.urdf"
    assert main(["--output", str(path)]) == 0
    assert "ros2_control" not in path.read_text(encoding="utf-8")
