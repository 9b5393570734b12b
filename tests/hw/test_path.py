# SPDX-License-Identifier: Apache-2.0
"""Paths of the loaded robot: their points, and the speeds that the safety envelope allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cabols_control.errors import CabolsError
from cabols_control.kinematics import structure_matrix
from cabols_control.rig import load_rig
from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_control.tension import distribute
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.abb.path import path_points
from cabols_hw.abb.speed_limit import allowed_speed
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety
from cabols_hw.safety.pose import PATH_HELD_S, PoseWatch

HEADER = "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n"
LOADING = OperatingMode.LOADING


def test_stored_configurations_and_a_file_give_the_same_points(tmp_path):
    stored = load_configurations()
    rows = "".join(",".join(map(repr, stored.configurations[i])) + "\n" for i in (2, 0, 7))
    (tmp_path / "path.csv").write_text(HEADER + rows)
    expected = path_points(stored, [2, 0, 7], "", tmp_path)
    np.testing.assert_array_equal(path_points(stored, [], "path.csv", tmp_path), expected)
    assert expected.shape == (3, 6)


@pytest.mark.parametrize(
    "text",
    [
        "",
        HEADER,
        "1,2,3,4,5,6\n",
        HEADER + "1,2,3,4,5\n",
        HEADER + "1,2,3,4,5,6,7\n",
        HEADER + "1,2,3,4,5,nan\n",
        HEADER + "1,2,3,4,5,inf\n",
        HEADER + "1,2,3,4,5,4000\n",
        HEADER + "1,2,3,4,5,x\n",
        HEADER + "0,0,0,0,0,0\n" * 201,
    ],
)
def test_files_that_are_no_path_are_refused(tmp_path, text):
    (tmp_path / "path.csv").write_text(text)
    with pytest.raises(CabolsError, match=r"path\.csv.*expected"):
        path_points(load_configurations(), [], "path.csv", tmp_path)


@pytest.mark.parametrize(("index", "file"), [([], ""), ([1], "path.csv"), ([99], ""), ([-1], "")])
def test_neither_both_and_unknown_configurations_are_refused(tmp_path, index, file):
    with pytest.raises(CabolsError, match="expected"):
        path_points(load_configurations(), index, file, tmp_path)


def moved(watch, rig, speed, seconds, mode, announced=None, start_s=0.0, at=0.0):
    """First fault of a platform at a constant speed along x, which is told every 4 ms."""
    for k in range(1, round(seconds / 0.004) + 1):
        now_s = start_s + 0.004 * k
        if announced is not None and k % 12 == 1:
            watch.allow_path(now_s, *announced)
        place = rig.geometry.reference_position + np.eye(3)[0] * (at + speed * (now_s - start_s))
        watch.hear(now_s, place, rig.geometry.reference_rotation)
        if (fault := watch.judge(now_s, mode)) is not None:
            return fault
    return None


@pytest.fixture
def watched():
    rig = load_rig()
    return PoseWatch(rig, load_safety()), rig


def test_without_an_announcement_the_loaded_platform_keeps_its_old_limit(watched):
    fault = moved(*watched, 0.03, 1.0, LOADING)
    assert fault is not None
    assert fault.name == FaultName.POSE_SPEED


def test_an_announced_path_allows_its_speed_and_no_more(watched):
    assert moved(*watched, 0.05, 1.0, LOADING, (0.05, 0.1)) is None
    fault = moved(*watched, 0.065, 1.0, LOADING, (0.05, 0.1), start_s=1.0, at=0.05)
    assert fault is not None
    assert fault.name == FaultName.POSE_SPEED


def test_the_file_bounds_what_a_path_may_announce(watched):
    fault = moved(*watched, 0.12, 1.0, LOADING, (0.24, 1.0))
    assert fault is not None
    assert fault.name == FaultName.POSE_SPEED


@pytest.mark.parametrize("speed", [np.nan, np.inf, -1.0, 0.0])
def test_an_announcement_that_is_no_speed_allows_nothing(watched, speed):
    assert moved(*watched, 0.03, 1.0, LOADING, (speed, 0.1)) is not None


def test_a_silent_path_ends(watched):
    watch, rig = watched
    watch.allow_path(0.0, 0.05, 0.1)
    assert moved(watch, rig, 0.05, PATH_HELD_S - 0.05, LOADING) is None
    fault = moved(watch, rig, 0.05, 1.0, LOADING, start_s=PATH_HELD_S, at=0.05 * PATH_HELD_S)
    assert fault is not None
    assert fault.name == FaultName.POSE_SPEED


def test_a_jump_during_a_path_is_a_jump(watched):
    watch, rig = watched
    assert moved(watch, rig, 0.05, 0.5, LOADING, (0.05, 0.1)) is None
    place = rig.geometry.reference_position + np.eye(3)[0] * 0.045
    assert not watch.hear(0.504, place, rig.geometry.reference_rotation)


def test_a_rig_whose_file_has_no_path_speed_allows_none_beyond_the_old_limit():
    rig, config = load_rig(), replace(load_safety(), speed_path=None, rotation_speed_path=None)
    assert moved(PoseWatch(rig, config), rig, 0.03, 1.0, LOADING, (0.05, 0.1)) is not None


def test_the_stop_allows_less_the_more_the_cables_pull():
    rig, safety, card = load_rig(), load_safety(), load_card()
    geometry = rig.geometry
    matrix = structure_matrix(geometry, geometry.reference_position, geometry.reference_rotation)
    found = []
    for force in (0.0, 50.0, 100.0, 140.0):
        tension = distribute(matrix, [force, 0, 0, 0, 0, 0], 1.0, 150.0).tension
        args = (rig, safety.tension_max, safety.wrench_max, card.sensor_limits, 0.3, tension)
        found.append(allowed_speed(*args))
    assert found == sorted(found, reverse=True)
    assert found[-1] < 0.02 < found[1] < 0.1
    # What is left of the force's limit, over the stiffest way of the platform, in the time to stop.
    stiffness = rig.limbs.stiffness * np.linalg.eigvalsh(matrix[:3] @ matrix[:3].T).max()
    assert found[2] == pytest.approx((155.0 - 100.0) / stiffness / (0.1 + 0.02 + 0.15), rel=0.01)
