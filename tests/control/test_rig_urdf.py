# SPDX-License-Identifier: Apache-2.0
"""The rig's URDF, read by pinocchio and MuJoCo, gives the project's own kinematics."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.errors import ConfigError
from cabols_control.frames import load_frames
from cabols_control.geometry import load_geometry
from cabols_control.placement import Frame
from cabols_control.rig_folder import find_rig
from cabols_control.rig_tools.new_rig import main as new_rig
from cabols_control.rig_tools.rig_urdf import main, rig_urdf, urdf_text
from cabols_control.serial_arms.arm import read_serial_arm
from cabols_control.serial_arms.frame_tree import pose_in, read_links
from cabols_hw.abb.configurations import load_configurations
from cabols_sim.bench.pulley_rig import make_pulley_rig

ROOT = Path(__file__).resolve().parents[2]
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
    return platform_pose(arm, load_frames().tool_frame, q, base)


def platform_pose(arm, tool, q, base):
    position, rotation = np.array(base.position), base.rotation
    for i, angle in enumerate(q):
        position = position + rotation @ arm.origins[i]
        rotation = rotation @ arm.rotations[i]
        rotation = rotation @ Rotation.from_rotvec(angle * arm.axes[i]).as_matrix()
    position, rotation = position + rotation @ arm.flange_position, rotation @ arm.flange_rotation
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


MESH = '<geometry><mesh filename="package://none/link.stl"/></geometry>'
FINGERS = """
<link name="finger_1"/><link name="finger_2"/>
<joint name="opening" type="prismatic"><parent link="link_6"/><child link="finger_1"/>
<origin xyz="0.1 0.2 0.3"/><axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>
</joint><joint name="other" type="prismatic"><parent link="link_6"/><child link="finger_2"/>
<axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>
<mimic joint="opening" multiplier="-1"/></joint></robot>"""
WORLD = """
<link name="world"/><joint name="stand" type="fixed"><parent link="world"/><child link="base_link"/>
<origin xyz="0.1 0.2 0.3" rpy="0.1 -1.5 2"/></joint></robot>"""
ARMS = {
    "as it is": lambda text: text,
    "on a stand in the world": lambda text: text.replace("</robot>", WORLD),
    "axes of length two": lambda text: text.replace('xyz="0 0 1"', 'xyz="0 0 2"'),
    "a joint without limits": lambda text: text.replace("revolute", "continuous", 1),
    "with a gripper": lambda text: text.replace("</robot>", FINGERS),
    "with meshes": lambda text: text.replace(
        '<link name="link_3"/>',
        f'<link name="link_3"><visual>{MESH}</visual><collision>{MESH}</collision></link>',
    ),
    "with MuJoCo's own settings": lambda text: text.replace(
        "</robot>", '<mujoco><compiler angle="degree"/></mujoco></robot>'
    ),
    "with a simulator's sensor": lambda text: text.replace(
        "</robot>", "<gazebo><sensor:camera/></gazebo></robot>"
    ),
}


@pytest.fixture(params=["7", "10", "ur20", "pulleys", *ARMS])
def other_rig(request, tmp_path, monkeypatch):
    folder = tmp_path / "rig"
    option = {"7": "--cables", "10": "--cables", "ur20": "--robot"}.get(request.param)
    if option:
        value = str(ROOT / "examples/ur20.urdf") if request.param == "ur20" else request.param
        monkeypatch.setattr("sys.argv", ["new_rig", str(folder), option, value])
        assert new_rig() == 0
    elif request.param == "pulleys":
        make_pulley_rig(find_rig(), folder, 0.04, neglected=False)
    else:
        shutil.copytree(find_rig().path, folder)
        path = folder / "robot.urdf"
        text = path.read_text()
        path.write_text(ARMS[request.param](text))
        assert request.param == "as it is" or path.read_text() != text
    return str(folder)


def pinocchio_places(text, joints, q, names):
    model = pinocchio.buildModelFromXML(text)
    data, at = model.createData(), pinocchio.neutral(model)
    for name, angle in zip(joints, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        turns = [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
        at[joint.idx_q : joint.idx_q + joint.nq] = turns
    pinocchio.framesForwardKinematics(model, data, at)
    frames = [data.oMf[model.getFrameId(name)] for name in names]
    return [(frame.translation, frame.rotation) for frame in frames]


def mujoco_places(text, joints, q, names):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for name, angle in zip(joints, q, strict=True):
        data.joint(name).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    bodies = [data.body(name) for name in names]
    return [(body.xpos, body.xmat.reshape(3, 3)) for body in bodies]


def test_other_rigs_agree(other_rig, tmp_path):
    """Cables, pulleys and arms of others, as programs read them that know nothing of this one."""
    output = tmp_path / "rig.urdf"
    words = ["--rig", other_rig, "--output", str(output), "--no-shapes"]
    assert main([*words, "--robot-position", "0.3,-1.2,0.45"]) == 0
    text = output.read_text()
    arm = read_serial_arm(find_rig(other_rig).file("robot.urdf"))
    links = read_links(ET.fromstring(text))
    cables = load_geometry(find_rig(other_rig).file("geometry.yaml")).cables
    names = ["platform", "sensor", "tracker", f"anchor_{cables}", f"attachment_{cables}"]
    base = Frame([0.3, -1.2, 0.45])
    for q in np.random.default_rng(11).uniform(-2.0, 2.0, (5, 6)):
        at = dict(zip(arm.joints, q, strict=True))
        own = [pose_in(links, "rig_base", name, at) for name in names]
        by_arm = platform_pose(arm, load_frames(other_rig).tool_frame, q, base)
        np.testing.assert_allclose(own[0][0], by_arm[0], atol=TOLERANCE, rtol=0)
        np.testing.assert_allclose(own[0][1], by_arm[1], atol=TOLERANCE, rtol=0)
        for places_of in (pinocchio_places, mujoco_places):
            found = places_of(text, arm.joints, q, names)
            for (position, rotation), (wanted, turned) in zip(found, own, strict=True):
                np.testing.assert_allclose(position, wanted, atol=TOLERANCE, rtol=0)
                np.testing.assert_allclose(rotation, turned, atol=TOLERANCE, rtol=0)


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
