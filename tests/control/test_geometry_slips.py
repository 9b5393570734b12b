# SPDX-License-Identifier: Apache-2.0
"""Slips in a robot's file that leave finite numbers are said or refused; public robots are not."""

from __future__ import annotations

import copy
import warnings

import numpy as np
import pytest
import yaml

from cabols_control.errors import ConfigError
from cabols_control.geometry import load_geometry
from case_robots import FOLDER

LARGE = {"fast"}
"""600 m across: said for its size."""
PUBLIC = sorted(path.stem for path in FOLDER.glob("*.yaml") if path.stem not in {*LARGE, "limits"})


def said_of(tmp_path, name, **changes):
    """Warnings when a public robot is loaded with changes; `points` maps (base, platform)."""
    content = copy.deepcopy(yaml.safe_load((FOLDER / f"{name}.yaml").read_text("utf-8")))
    points = changes.pop("points", None)
    if points is not None:
        arrays = (np.array(content[key], float) for key in ("base_points", "platform_points"))
        made = points(*arrays)
        content["base_points"], content["platform_points"] = (rows.tolist() for rows in made)
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump({**content, **changes}), encoding="utf-8")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        load_geometry(path)
    return " ".join(str(warning.message) for warning in said)


def moved(index, platform, factor):
    """Multiply one point by a factor."""

    def change(base, held):
        (held if platform else base)[index] *= factor
        return base, held

    return change


@pytest.mark.parametrize("name", PUBLIC)
def test_public_robots_load_in_silence(tmp_path, name):
    assert not said_of(tmp_path, name)


@pytest.mark.parametrize("name", ["cogiro", "caroca", "acrobot", "segesta10", "planar_cross"])
def test_mirrored_platform_is_in_the_way_of_its_cables(tmp_path, name):
    said = said_of(tmp_path, name, points=lambda base, held: (base, held * [-1.0, 1.0, 1.0]))
    assert "in the way of" in said


@pytest.mark.parametrize("name", ["segesta10", "planar_cross"])
def test_exchanged_platform_points_are_in_the_way(tmp_path, name):
    order = lambda held: held[[1, 0, *range(2, len(held))]]  # noqa: E731
    said = said_of(tmp_path, name, points=lambda base, held: (base, order(held)))
    assert "cables 1 and 2" in said


@pytest.mark.parametrize(
    ("name", "platform"), [("ipanema1", True), ("ipanema1", False), ("planar_kntu", False)]
)
def test_one_point_with_a_wrong_factor_is_said(tmp_path, name, platform):
    said = said_of(tmp_path, name, points=moved(1, platform, 10.0))
    assert "cable 2" in said


def test_base_point_inside_the_platform_is_refused(tmp_path):
    def inside(base, held):
        base[2] = middle + 0.3 * held[2]
        return base, held

    middle = load_geometry(FOLDER / "ipanema1.yaml").reference_position
    with pytest.raises(ConfigError, match=r"inside it at the reference pose for cable 3"):
        said_of(tmp_path, "ipanema1", points=inside)


def test_reference_pose_beyond_the_cables_lengths_is_said(tmp_path):
    assert "cable_length_max" in said_of(tmp_path, "cogiro", cable_length_max=5.0)
    assert not said_of(tmp_path, "cogiro", cable_length_min=5.0, cable_length_max=20.0)


def test_cables_across_the_plane_of_a_planar_motion_are_said(tmp_path):
    assert "across that plane" in said_of(tmp_path, "ipanema1", motion="planar_xy")
    assert not said_of(tmp_path, "planar_kntu", motion="planar_xy")
