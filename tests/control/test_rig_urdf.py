# SPDX-License-Identifier: Apache-2.0
"""The rig's URDF, read by pinocchio and MuJoCo, gives the project's own kinematics."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.errors import ConfigError
from cabols_control.frame_tree import pose_in, read_links
from cabols_control.frames import load_frames
from cabols_control.geometry import load_geometry
from cabols_control.placement import Frame
from cabols_control.rig_folder import find_rig
from cabols_control.rig_tools.rig_urdf import main, rig_urdf, urdf_text
from cabols_control.serial_arm import read_serial_arm
from cabols_hw.abb.configurations import load_configurations

TOLERANCE = 1e-12
BASE = Frame([0.3, -1.2, 0.45], rotation_xyz_deg=[2.0, -3.0, 130.0])
JOINTS = [f"joint_{i}" for i in range(1, 7)]


def angles():
    stored = load_configurations()
    rng = np.random.default_rng(7)
    return [stored.joints(i) for i in range(len(stored))] + list(rng.uniform(-2, 2, (50, 6)))


def expected(q, base=BASE):
    """The platform's pose, of the arm as the stiffness model has it, and of frames.yaml."""
    arm = read_serial_arm(find_rig().file("robot.urdf"))
    position, rotation = np.array(base.position), base.rotation
    for i, angle in enumerate(q):
        position = position + rotation @ arm.origins[i]
        rotation = rotation @ arm.rotations[i]
        rotation = rotation @ Rotation.from_rotvec(angle * arm.axes[i]).as_matrix()
    position, rotation = position + rotation @ arm.flange_position, rotation @ arm.flange_rotation
    tool = load_frames().tool_frame
    return position + rotation @ np.array(tool.position), rotation @ tool.rotation


@pytest.fixture(scope="module")
def urdf():
    return urdf_text(rig_urdf("", BASE))


def places(q, base=BASE):
    """Every frame that the rig's files give, in the rig's base."""
    position, rotation = expected(q, base)
    geometry, frames = load_geometry(), load_frames()
    found = {"platform": (position, rotation)}
    for i in range(geometry.cables):
        found[f"anchor_{i + 1}"] = (geometry.base_points[i], np.eye(3))
        at = position + rotation @ geometry.platform_points[i]
        found[f"attachment_{i + 1}"] = (at, rotation)
    for i, reflector in enumerate(frames.reflectors):
        found[f"reflector_{i + 1}"] = (position + rotation @ np.array(reflector), rotation)
    found["tracker"] = (np.array(frames.tracker_frame.position), frames.tracker_frame.rotation)
    sensor = frames.sensor_frame
    found["sensor"] = (position + rotation @ np.array(sensor.position), rotation @ sensor.rotation)
    return found


def test_pinocchio_agrees(urdf):
    model = pinocchio.buildModelFromXML(urdf)
    data = model.createData()
    for q in angles():
        pinocchio.framesForwardKinematics(model, data, np.array(q))
        for name, (position, rotation) in places(q).items():
            frame = data.oMf[model.getFrameId(name)]
            np.testing.assert_allclose(frame.translation, position, atol=TOLERANCE, rtol=0)
            np.testing.assert_allclose(frame.rotation, rotation, atol=TOLERANCE, rtol=0)


def test_mujoco_agrees(urdf):
    model = mujoco.MjModel.from_xml_string(urdf)
    data = mujoco.MjData(model)
    for q in angles():
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        for name, (position, rotation) in places(q).items():
            body = data.body(name)
            np.testing.assert_allclose(body.xpos, position, atol=TOLERANCE, rtol=0)
            np.testing.assert_allclose(body.xmat.reshape(3, 3), rotation, atol=TOLERANCE, rtol=0)


def test_own_frames_agree(urdf):
    links = read_links(ET.fromstring(urdf))
    for q in angles():
        at = dict(zip(JOINTS, q, strict=True))
        for name, (position, rotation) in places(q).items():
            found = pose_in(links, "rig_base", name, at)
            np.testing.assert_allclose(found[0], position, atol=TOLERANCE, rtol=0)
            np.testing.assert_allclose(found[1], rotation, atol=TOLERANCE, rtol=0)


@pytest.mark.parametrize("pitch", [90.0, -90.0, 89.9999999, 90.0000001, 89.99, 12.0])
def test_rotations_keep_their_digits_at_a_pitch_of_90_degrees(pitch):
    rotation = Rotation.from_euler("xyz", [25.0, pitch, -70.0], degrees=True)
    x, y, z, w = rotation.as_quat()
    base = Frame([0.1, 0.2, 0.3], quaternion_wxyz=[float(v) for v in (w, x, y, z)])
    text = urdf_text(rig_urdf("", base))
    model = pinocchio.buildModelFromXML(text)
    data = model.createData()
    q = angles()[3]
    pinocchio.framesForwardKinematics(model, data, np.array(q))
    frame = data.oMf[model.getFrameId("platform")]
    position, turned = expected(q, base)
    np.testing.assert_allclose(frame.translation, position, atol=TOLERANCE, rtol=0)
    np.testing.assert_allclose(frame.rotation, turned, atol=TOLERANCE, rtol=0)


def test_without_a_robot_the_platform_stands_at_its_reference(tmp_path):
    rig = tmp_path / "rigid"
    shutil.copytree(find_rig().path, rig)
    (rig / "robot.urdf").unlink()
    geometry = load_geometry()
    position, rotation = pose_in(read_links(rig_urdf(str(rig))), "rig_base", "platform", {})
    np.testing.assert_allclose(position, geometry.reference_position, atol=TOLERANCE)
    np.testing.assert_allclose(rotation, geometry.reference_rotation, atol=TOLERANCE)


def test_a_robot_whose_links_are_named_as_the_rigs_is_refused(tmp_path):
    rig = tmp_path / "clash"
    shutil.copytree(find_rig().path, rig)
    path = rig / "robot.urdf"
    path.write_text(path.read_text().replace('"link_3"', '"platform"'))
    with pytest.raises(ConfigError, match="expected each link once, got platform twice"):
        rig_urdf(str(rig))


def test_the_command_writes_it(tmp_path, capsys):
    assert main(["--output", str(tmp_path / "rig.urdf"), "--robot-position", "0.3,-1.2,0.45"]) == 0
    assert ET.parse(tmp_path / "rig.urdf").getroot().get("name") == "bench"
    assert main([]) == 0
    assert "<link name=" in capsys.readouterr().out
