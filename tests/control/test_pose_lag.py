# SPDX-License-Identifier: Apache-2.0
"""The lag of the robot's poses, identified from motions under load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bag_builder import BagBuilder
from cabols_control.commissioning.pose_lag import (
    PoseLagError,
    PoseRecording,
    identify_pose_lag,
)
from cabols_control.commissioning.pose_lag_command import main
from cabols_control.errors import CabolsError
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.rig import load_rig
from cabols_control.supervision.modes import OperatingMode
from cabols_control.tension import distribute

WRENCH = np.array([30.0, 0.0, 20.0, 0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def rig():
    return load_rig()


def recording(rig, lag_s, size_m=0.03, noise_n=0.0, backlash_m=0.0, duration_s=6.0):
    """Ideal springs on a platform that goes to and fro; poses are stamped late by the lag."""
    geometry, random = rig.geometry, np.random.default_rng(1)
    home, turned = geometry.reference_position, geometry.reference_rotation

    def pose(t):
        phase = 2.0 * np.pi * t / 2.0
        place = home + size_m * np.array([np.sin(phase), 0.4 * np.cos(1.3 * phase), 0.0])
        turn = Rotation.from_rotvec([0.0, 0.02 * np.sin(0.7 * phase), 0.0]).as_matrix()
        return place, turn @ turned

    time = np.arange(0.0, duration_s, 0.004)
    wound, wrench, before = [], [], None
    side = np.zeros(geometry.cables)
    for t in time:
        place, rotation = pose(t)
        matrix = structure_matrix(geometry, place, rotation)
        tension = distribute(matrix, WRENCH, 2.0, 140.0).tension
        stretch = tension / rig.limbs.stiffness - cable_lengths(geometry, place, rotation)
        if before is not None:
            side = np.where(stretch != before, np.sign(stretch - before), side)
        before = stretch
        wound.append(stretch + 0.7 + 0.5 * backlash_m * side)
        local = np.concatenate([rotation.T @ WRENCH[:3], rotation.T @ WRENCH[3:]])
        wrench.append(local + noise_n * random.standard_normal(6) * [1, 1, 1, 0.1, 0.1, 0.1])
    stamps = np.arange(-0.1, duration_s + 0.1, 0.004)
    poses = [pose(t) for t in stamps]
    rows = [np.concatenate([p, Rotation.from_matrix(r).as_quat()]) for p, r in poses]
    return PoseRecording(time, np.array(wound), np.array(wrench), stamps + lag_s, np.array(rows))


@pytest.mark.parametrize("lag_s", [0.0, 0.0083, 0.016])
def test_a_lag_is_found_to_a_tenth_of_a_millisecond(rig, lag_s):
    found = identify_pose_lag(rig, recording(rig, lag_s))
    assert found.lag == pytest.approx(lag_s, abs=1e-4)
    assert found.residual < 0.05


def test_noise_and_backlash_do_not_move_it_far(rig):
    found = identify_pose_lag(rig, recording(rig, 0.012, noise_n=0.3, backlash_m=4e-5))
    assert found.lag == pytest.approx(0.012, abs=5e-4)
    assert 0.0 < found.deviation < 1e-3
    assert found.residual < found.residual_without


def test_a_platform_that_stands_says_nothing(rig):
    with pytest.raises(PoseLagError, match="no lag can be told from standing"):
        identify_pose_lag(rig, recording(rig, 0.012, size_m=0.0001))


def test_a_lag_out_of_range_is_no_lag(rig):
    with pytest.raises(PoseLagError, match="end of that range"):
        identify_pose_lag(rig, recording(rig, 0.09))


def test_recordings_that_are_none_are_refused(rig):
    given = recording(rig, 0.01, duration_s=2.0)
    bad = given.wrench.copy()
    bad[3, 2] = np.nan
    for broken in (
        replace(given, wrench=bad),
        replace(given, wound=given.wound[:, :5]),
        replace(given, pose_time=given.pose_time + 100.0),
        replace(given, pose_time=np.zeros_like(given.pose_time)),
        replace(given, pose=given.pose[:-1]),
    ):
        with pytest.raises(CabolsError):
            identify_pose_lag(rig, broken)


def test_the_command_reads_a_bag(rig, tmp_path, monkeypatch, capsys):
    given = recording(rig, 0.0105, duration_s=3.0)
    began_ns = 1_700_000_000_000_000_000
    with BagBuilder(tmp_path / "bag") as bag:
        for t, wound, wrench in zip(given.time, given.wound, given.wrench, strict=True):
            at = began_ns + round(1e9 * t)
            state = {"wound_length": wound, "mode": int(OperatingMode.LOADING)}
            bag.add("limb_state", "cabols_msgs/msg/LimbState", at, **state)
            force, torque = (
                bag.make("geometry_msgs/msg/Vector3", **dict(zip("xyz", part, strict=True)))
                for part in (wrench[:3], wrench[3:])
            )
            felt = bag.make("geometry_msgs/msg/Wrench", force=force, torque=torque)
            bag.add("wrench", "geometry_msgs/msg/WrenchStamped", at, wrench=felt)
        for t, row in zip(given.pose_time, given.pose, strict=True):
            place = bag.make("geometry_msgs/msg/Point", **dict(zip("xyz", row[:3], strict=True)))
            turn = dict(zip("xyzw", row[3:], strict=True))
            turned = bag.make("geometry_msgs/msg/Quaternion", **turn)
            pose = bag.make("geometry_msgs/msg/Pose", position=place, orientation=turned)
            at = began_ns + round(1e9 * t)
            bag.add("platform_pose", "geometry_msgs/msg/PoseStamped", at, pose=pose)
    monkeypatch.setattr("sys.argv", ["pose_lag", str(tmp_path / "bag")])
    assert main() == 0
    said = capsys.readouterr().out
    assert float(said.split()[1]) == pytest.approx(0.0105, abs=2e-4)
