# SPDX-License-Identifier: Apache-2.0
"""Wrenches in frames: against pinocchio, and one wrench in many frames gives the same tensions."""

from __future__ import annotations

import shutil

import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.spatial.transform import Rotation

from cabols_control.errors import CabolsError, ShapeError
from cabols_control.frames import Frame, load_frames, load_wrench_frames
from cabols_control.geometry import load_geometry
from cabols_control.rig import load_rig
from cabols_control.rig_folder import find_rig
from cabols_control.supervision.modes import OperatingMode
from cabols_control.wrench_control.controller import DesiredWrench, WrenchController
from cabols_control.wrench_control.frames import WrenchFrame, wrench_frames

ANGLES = [25.0, -40.0, 110.0]
OWN = {
    "tip": WrenchFrame([0.1, -0.05, 0.2], ANGLES),
    "tip_in_base_axes": WrenchFrame([0.1, -0.05, 0.2], axes="base"),
    "tip_in_platform_axes": WrenchFrame([0.1, -0.05, 0.2], ANGLES, axes="platform"),
    "knee": WrenchFrame([0.4, 1.3, 0.9], ANGLES, parent="base"),
    "knee_in_base_axes": WrenchFrame([0.4, 1.3, 0.9], ANGLES, parent="base", axes="base"),
    "knee_in_platform_axes": WrenchFrame([0.4, 1.3, 0.9], parent="base", axes="platform"),
}
TOOL = Frame([0.01, -0.02, 0.15], [10.0, 20.0, -30.0])
SENSOR = Frame([0.0, 0.01, -0.03], [0.0, 90.0, 45.0])


@pytest.fixture(scope="module")
def frames():
    return wrench_frames("base", "platform", TOOL, SENSOR, OWN)


def poses(count, seed=0):
    random = np.random.default_rng(seed)
    for _ in range(count):
        turned = Rotation.from_rotvec(random.normal(size=3)).as_matrix()
        yield random.normal(size=3), turned, random.normal(size=6) * 50.0


def se3(name, position, rotation):
    """Pose of a frame in the base by pinocchio, and the axes in which its wrenches are."""
    platform = pin.SE3(rotation, position)
    own = {"sensor": SENSOR, **OWN}
    if name in ("platform", "tool"):
        return platform
    if name == "flange":
        return platform * pin.SE3(TOOL.rotation, np.array(TOOL.position)).inverse()
    frame = own[name]
    placed = pin.SE3(frame.rotation, np.array(frame.position))
    placed = placed if getattr(frame, "parent", "platform") == "base" else platform * placed
    axes = getattr(frame, "axes", "own")
    turn = {"own": placed.rotation, "base": np.eye(3), "platform": rotation}[axes]
    return pin.SE3(turn, placed.translation)


@pytest.mark.parametrize("name", ["platform", "tool", "flange", "sensor", *OWN])
def test_transport_agrees_with_pinocchio(frames, name):
    for position, rotation, wrench in poses(20):
        # About the base's origin first, then about the platform's, in base axes.
        moved = se3(name, position, rotation).act(pin.Force(wrench[:3], wrench[3:]))
        moved = pin.SE3(np.eye(3), position).actInv(moved)
        found = frames.to_base(name, wrench, position, rotation)
        scale = np.abs(moved.vector).max()
        assert found == pytest.approx(moved.vector, abs=1e-12 * scale)
        back = frames.from_base(name, found, position, rotation)
        assert back == pytest.approx(wrench, abs=1e-12 * scale)


def test_the_base_frame_is_about_the_platforms_origin(frames):
    position, rotation, wrench = next(poses(1))
    for name in ("", "base"):
        assert np.array_equal(frames.to_base(name, wrench, position, rotation), wrench)


def test_power_is_the_same_in_each_frame(frames):
    """Virtual work: a wrench in a frame and the twist of its origin, in the same axes."""
    random = np.random.default_rng(5)
    for position, rotation, wrench in poses(10, seed=2):
        velocity, turning = random.normal(size=3), random.normal(size=3)
        power = wrench @ np.concatenate([velocity, turning])
        for name in frames.names[1:]:
            placed = se3(name, position, rotation)
            there = frames.from_base(name, wrench, position, rotation)
            at = velocity + np.cross(turning, placed.translation - position)
            twist = np.concatenate([placed.rotation.T @ at, placed.rotation.T @ turning])
            assert there @ twist == pytest.approx(power, rel=1e-12, abs=1e-10)


def test_one_wrench_in_five_frames_gives_one_set_of_tensions(frames):
    rig = load_rig()
    reference = rig.geometry.reference_position
    turned = Rotation.from_rotvec([0.1, -0.05, 0.08]).as_matrix()
    rotation = turned @ rig.geometry.reference_rotation
    wrench = np.array([20.0, -15.0, 30.0, 1.0, -2.0, 1.5])
    found = []
    for name in ("base", "platform", "flange", "tip", "knee"):
        given = frames.from_base(name, wrench, reference, rotation)
        controller = WrenchController(rig)
        controller.set_pose(reference, rotation)
        for k in range(1, 50):
            desired = DesiredWrench(0.001 * k, given, frames.record(name))
            tension = controller.step(0.001 * k, np.zeros(6), OperatingMode.LOADING, desired)
        assert controller.active
        assert controller.desired == pytest.approx(wrench, abs=1e-11)
        found.append(tension.copy())
    for other in found[1:]:
        assert other == pytest.approx(found[0], abs=1e-9)


def test_a_moving_platform_takes_its_wrench_along(frames):
    rig = load_rig()
    controller = WrenchController(rig)
    given = np.array([0.0, 0.0, 30.0, 0.0, 0.0, 1.0])
    frame = frames.record("tip")
    reference = rig.geometry.reference_position
    for k in range(1, 200):
        now_s = 0.001 * k
        turned = Rotation.from_rotvec([0.0, 0.3 * now_s, 0.1 * now_s]).as_matrix()
        pose = (reference + 0.05 * now_s * np.eye(3)[0], turned)
        controller.hear_pose(now_s, *pose)
        controller.place(now_s)
        desired = DesiredWrench(now_s, given, frame)
        controller.step(now_s, np.zeros(6), OperatingMode.LOADING, desired)
    assert controller.desired == pytest.approx(frames.to_base("tip", given, *pose), abs=1e-9)


@pytest.mark.parametrize("name", ["base", "platform", "knee"])
def test_a_stale_wrench_commands_nothing_in_any_frame(frames, name):
    """Desired before LOADING began, in a frame that would be led: it never was in force."""
    rig = load_rig()
    controller = WrenchController(rig)
    stale = DesiredWrench(0.0, np.array([40.0, 0.0, 0.0, 0.0, 0.0, 2.0]), frames.record(name))
    pose = rig.geometry.reference_position, rig.geometry.reference_rotation
    for k in range(200):
        now_s = 10.0 + 0.001 * k
        controller.hear_pose(now_s, *pose)
        controller.place(now_s)
        controller.step(now_s, np.zeros(6), OperatingMode.LOADING, stale)
    assert controller.active
    assert not controller.desired.any()
    assert controller.control == pytest.approx(np.zeros(6), abs=1e-9)


def test_the_rigs_file_holds_the_users_frames(tmp_path):
    shutil.copytree(find_rig().path, tmp_path / "mine")
    file = tmp_path / "mine" / "frames.yaml"
    content = yaml.safe_load(file.read_text())
    content["wrench_frames"] = {"tip": {"position": [0.1, 0.0, 0.0], "axes": "base"}}
    file.write_text(yaml.safe_dump(content))
    found = load_wrench_frames(load_geometry(), str(tmp_path / "mine"))
    assert "tip" in found.names
    moved = found.to_base("tip", [0.0, 0.0, 10.0, 0.0, 0.0, 0.0], np.zeros(3), np.eye(3))
    assert moved == pytest.approx([0.0, 0.0, 10.0, 0.0, -1.0, 0.0])


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        ({"position": [0.1, 0.0, 0.0], "parent": "robot"}, "parent"),
        ({"position": [0.1, 0.0]}, "position"),
        ({"position": [0.1, 0.0, 0.0], "axes": "world"}, "axes"),
        ({"rotation_xyz_deg": [0.0, 0.0, 0.0]}, "position"),
    ],
)
def test_frames_that_are_none_are_refused(tmp_path, frame, said):
    shutil.copytree(find_rig().path, tmp_path / "mine")
    file = tmp_path / "mine" / "frames.yaml"
    content = yaml.safe_load(file.read_text())
    content["wrench_frames"] = {"tip": frame}
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(CabolsError, match=said):
        load_frames(str(tmp_path / "mine"))


def test_taken_and_unknown_names_are_refused(frames):
    for name in ("base", "platform", "tool", "sensor", "flange", ""):
        with pytest.raises(CabolsError, match="wrench_frames"):
            wrench_frames("base", "platform", TOOL, SENSOR, {name: OWN["tip"]})
    with pytest.raises(CabolsError, match=r"knee_in_base_axes, .*got tipp"):
        frames.record("tipp")


@pytest.mark.parametrize("name", ["/tip", "tip ", "a\nb", "a\0b", "1", "t" * 65])
def test_names_that_no_message_should_carry_are_refused(name):
    with pytest.raises(CabolsError, match="letters, digits"):
        wrench_frames("base", "platform", TOOL, SENSOR, {name: OWN["tip"]})


@pytest.mark.parametrize("x", [100.0, -1e300])
def test_an_origin_in_millimetres_is_refused(x):
    far = {"tip": WrenchFrame([x, 0.0, 0.0])}
    with pytest.raises(CabolsError, match="in metres"):
        wrench_frames("base", "platform", TOOL, SENSOR, far)


@pytest.mark.parametrize("given", [[1.0] * 5, [1.0] * 12, [1j] * 6, None, ["a"] * 6, 3.0])
def test_what_is_no_wrench_is_refused(frames, given):
    for move in (frames.to_base, frames.from_base):
        with pytest.raises(ShapeError, match="wrenches"):
            move("tip", given, np.zeros(3), np.eye(3))


def test_poses_that_do_not_belong_together_are_refused(frames):
    for positions, rotations in (
        (np.zeros((2, 3)), np.eye(3)[None]),
        (np.zeros(3), np.eye(3)),
        (np.zeros((1, 4)), np.eye(3)[None]),
    ):
        with pytest.raises(ShapeError, match=r"positions|rotations"):
            frames.along("tip", positions, rotations)
    levers, turns = frames.along("tip", [[0, 0, 0]], [np.eye(3).tolist()])
    assert levers.shape == (1, 3)
    assert turns.shape == (1, 3, 3)
