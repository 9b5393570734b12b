# SPDX-License-Identifier: Apache-2.0
"""Geometries in millimetres, swapped, with a cable twice: said or refused when they are loaded."""

from __future__ import annotations

import copy
import warnings

import numpy as np
import yaml

from cabols_control.errors import CabolsError
from cabols_control.geometry import load_geometry
from case_robots import FOLDER
from cases import outcome

GOOD = yaml.safe_load((FOLDER / "cogiro.yaml").read_text("utf-8"))


def in_mm(rows):
    return (1000.0 * np.array(rows)).tolist()


def all_in_mm():
    pose = {
        "position": in_mm(GOOD["reference_pose"]["position"]),
        "rotation_xyz_deg": [0, 0, 0],
    }
    points = {key: in_mm(GOOD[key]) for key in ("base_points", "platform_points")}
    return {**points, "reference_pose": pose}


def cable_twice():
    return {
        key: GOOD[key][:3] + GOOD[key][2:3] + GOOD[key][4:]
        for key in ("base_points", "platform_points")
    }


def load(tmp_path, changes):
    """What loading gives (the geometry or the error), and the warnings beside it."""
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump({**copy.deepcopy(GOOD), **changes}), encoding="utf-8")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        return outcome(lambda: load_geometry(path)), [str(warning.message) for warning in said]


def test_good_geometry_loads_without_a_word(tmp_path):
    found, said = load(tmp_path, {})
    assert found.cables == 8
    assert not said


def test_frame_in_millimetres_is_said(tmp_path):
    found, said = load(tmp_path, all_in_mm())
    assert isinstance(found, CabolsError) or said


def test_platform_in_millimetres_is_refused(tmp_path):
    found, _ = load(tmp_path, {"platform_points": in_mm(GOOD["platform_points"])})
    assert isinstance(found, CabolsError)


def test_base_and_platform_swapped_are_refused(tmp_path):
    swapped = {"base_points": GOOD["platform_points"], "platform_points": GOOD["base_points"]}
    found, _ = load(tmp_path, swapped)
    assert isinstance(found, CabolsError)


def test_cable_that_is_there_twice_is_said(tmp_path):
    found, said = load(tmp_path, cable_twice())
    assert isinstance(found, CabolsError) or said
