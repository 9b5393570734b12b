# SPDX-License-Identifier: Apache-2.0
"""Reading a robot's joints from its URDF: against pinocchio, and what is no such arm."""

from __future__ import annotations

import re

import numpy as np
import pytest

from cabols_control.console.view3d.arm import read_arm
from cabols_control.errors import ConfigError
from cabols_control.rig_folder import rig_file
from cabols_control.serial_arms.arm import NotSerialError, read_serial_arm

BENCH = rig_file("robot.urdf")


def test_joints_are_pinocchios():
    pinocchio = pytest.importorskip("pinocchio")
    arm, model = read_serial_arm(BENCH), pinocchio.buildModelFromUrdf(str(BENCH))
    assert list(arm.joints) == list(model.names)[1:]
    for j, placement in enumerate(model.jointPlacements.tolist()[1:]):
        np.testing.assert_allclose(arm.origins[j], placement.translation, atol=1e-15)
        np.testing.assert_allclose(arm.rotations[j], placement.rotation, atol=1e-15)
    np.testing.assert_allclose(arm.limits[:, 0], model.lowerPositionLimit)
    np.testing.assert_allclose(arm.limits[:, 1], model.upperPositionLimit)
    assert arm.flange == "tool0"


def camera(parent):
    """A link besides the arm, fixed to one of its links."""
    return (
        f'<link name="camera"/><joint name="camera_mount" type="fixed"><parent link="{parent}"/>'
        '<child link="camera"/><origin xyz="0.1 0 0.2"/></joint></robot>'
    )


def changed(tmp_path, old, new):
    """The bench's robot with one text in place of another."""
    path, text = tmp_path / "robot.urdf", BENCH.read_text()
    assert re.search(old, text)
    path.write_text(re.sub(old, new, text, count=1))
    return path


@pytest.mark.parametrize("parent", ["base_link", "link_3", "link_6"])
def test_camera_does_not_become_the_flange(tmp_path, parent):
    path = changed(tmp_path, "</robot>", camera(parent))
    arm, bench = read_serial_arm(path), read_serial_arm(BENCH)
    assert arm.flange == "tool0"
    np.testing.assert_array_equal(arm.flange_position, bench.flange_position)
    assert len(read_serial_arm(path, "camera").joints if parent == "link_3" else arm.joints) in (
        3,
        6,
    )


def test_named_flange_ends_the_arm(tmp_path):
    arm = read_serial_arm(changed(tmp_path, "</robot>", camera("link_3")), "camera")
    assert arm.joints == ("joint_1", "joint_2", "joint_3")
    np.testing.assert_allclose(arm.flange_position, [0.1, 0.0, 0.2])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('type="revolute"', 'type="prismatic"', "'joint_1'.*prismatic"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="joint_1"/>', "'joint_2'.*mimic"),
        ('child link="tool0"', 'child link="base_link"', "expected a link 'tool0'.*got link_1"),
    ],
)
def test_what_is_no_such_arm_is_refused_with_the_joint(tmp_path, old, new, said):
    path = changed(tmp_path, old, new)
    with pytest.raises(NotSerialError, match=said):
        read_serial_arm(path)
    assert read_arm(path) is None


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("</robot>", "", "expected a URDF"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', "'joint_2'.*expected an axis"),
        ('xyz="0.150 0 0.4865"', 'xyz="0.150 0"', "'joint_2'.*expected 3 finite numbers"),
        ('xyz="0.150 0 0.4865"', 'xyz="nan 0 0"', "'joint_2'.*expected 3 finite numbers"),
        ('lower="-1.570796326794897"', 'lower="3"', "'joint_2'.*expected limits lower < upper"),
    ],
)
def test_broken_file_is_named(tmp_path, old, new, said):
    with pytest.raises(ConfigError, match=said):
        read_serial_arm(changed(tmp_path, old, new))


def test_continuous_joint_has_no_limits(tmp_path):
    path = changed(tmp_path, 'name="joint_1" type="revolute"', 'name="joint_1" type="continuous"')
    assert np.isinf(read_serial_arm(path).limits[0]).all()
