# SPDX-License-Identifier: Apache-2.0
"""Robots of one file in the workspace tool: limits by cable, weight, length, nothing by stealth."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from cabols_control.errors import ConfigError
from cabols_control.workspace.capacity import PlatformWeight, capacity_along
from cabols_control.workspace.robot import GRAVITY_M_S2, load_robot
from cabols_control.workspace.tool.command import main as workspace
from cabols_control.workspace.wrench_set import wrench_box
from case_robots import FOLDER, load
from wrench_lps import box_vertices, feasible_poses


def robot_file(tmp_path, name, **changes):
    content = yaml.safe_load((FOLDER / f"{name}.yaml").read_text("utf-8"))
    path = tmp_path / f"{name}.yaml"
    path.write_text(yaml.safe_dump({**content, **changes}), encoding="utf-8")
    return path


def test_a_robot_of_one_file_is_read_whole(tmp_path):
    high = [1000.0, 5000.0, 1000.0, 5000.0, 5000.0, 5000.0]
    words = {"mass": 2.0, "centre_of_mass": [0.0, 0.1, 0.0], "characteristic_length": 2.0}
    path = robot_file(tmp_path, "robocrane", tension_min=0.0, tension_max=high, **words)
    robot = load_robot(geometry=path)
    np.testing.assert_array_equal(robot.tension_max, high)
    assert robot.platform == PlatformWeight(2.0 * GRAVITY_M_S2, (0.0, 0.1, 0.0))
    np.testing.assert_array_equal(robot.weights, [1, 1, 1, 0.5, 0.5, 0.5])
    assert not robot.own_bodies
    assert robot.notes == ()


def test_what_comes_from_the_bench_is_said(tmp_path, capsys):
    path = robot_file(tmp_path, "cogiro")
    words = ["--tilt", "0", "--scheduler", "inline", "--no-bodies", "--counts", "2", "2", "2"]
    words += ["--output"]
    assert workspace(["map", "--geometry", str(path), *words, str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "tension limits are those of the rig bench" in said
    assert "torques count as forces at 0.15 m" in said


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"tension_min": 1.0}, "tension_max"),
        ({"tension_min": [1.0] * 7, "tension_max": 10.0}, "tension_min"),
        ({"tension_min": 1.0, "tension_max": float("nan")}, "tension_max"),
        ({"tension_min": 9.0, "tension_max": 1.0}, "tension_min"),
        ({"tension_min": 0.0, "tension_max": 9.0, "mass": -1.0}, "mass"),
        ({"characteristic_length": 0.0}, "characteristic_length"),
        ({"cable_length_min": 5.0, "cable_length_max": 1.0}, "cable_length_min"),
        ({"tension_mx": 9.0}, "tension_mx"),
    ],
)
def test_mistakes_in_a_robots_file_are_named(tmp_path, changes, named):
    with pytest.raises(ConfigError, match=named):
        load_robot(geometry=robot_file(tmp_path, "cogiro", **changes))


def test_held_weight_is_that_of_linear_programmes():
    """CoGiRo hangs: with its weight at a point off the origin, turned, against HiGHS."""
    rng = np.random.default_rng(3)
    geometry, low, high, _ = load("cogiro")
    turns = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    centre, weight = np.array([-0.034, -0.013, 0.264]), 893.0
    positions = geometry.reference_position + rng.uniform(-4.0, 4.0, (40, 3)) * [1, 1, 0.5]
    box = [300.0, 300.0, 300.0, 100.0, 100.0, 100.0]
    for rotation in (np.eye(3), turns):
        rotations = np.repeat(rotation[None], 40, axis=0)
        found = capacity_along(
            geometry,
            positions,
            rotations,
            low,
            high,
            wrench_box(box),
            platform=PlatformWeight(weight, tuple(centre)),
        )
        force = np.array([0.0, 0.0, weight])
        held = np.r_[force, np.cross(rotation @ centre, force)]
        whole = capacity_along(geometry, positions, rotations, low, high, wrench_box(box, held))
        np.testing.assert_allclose(found.margin, whole.margin, atol=1e-6)
        vertices = box_vertices(box) + held
        expected = feasible_poses(geometry, positions, rotations, vertices, low, high)[0]
        clear = np.abs(found.margin) > 1e-3
        np.testing.assert_array_equal(found.feasible[clear], expected[clear])
        at_factor = found.factor_high > 0.0
        for k in np.flatnonzero(at_factor)[:5]:
            scaled = wrench_box(found.factor_high[k] * np.array(box), held)
            one = (positions[k : k + 1], rotations[k : k + 1])
            assert abs(capacity_along(geometry, *one, low, high, scaled).margin[0]) < 1e-6


def test_cable_length_limits_are_a_criterion(tmp_path):
    path = robot_file(tmp_path, "cogiro", cable_length_min=2.0, cable_length_max=12.0)
    geometry = load_robot(geometry=path).geometry
    positions = geometry.reference_position + np.random.default_rng(5).uniform(-6, 6, (200, 3))
    rotations = np.repeat(np.eye(3)[None], 200, axis=0)
    found = capacity_along(geometry, positions, rotations, 0.0, 5000.0, wrench_box([1.0] * 6))
    rods = geometry.base_points - geometry.platform_points - positions[:, None]
    lengths = np.linalg.norm(rods, axis=2)
    beyond = (lengths.min(axis=1) < 2.0) | (lengths.max(axis=1) > 12.0)
    assert 0 < beyond.sum() < 200
    np.testing.assert_array_equal(np.isneginf(found.margin), beyond)
    assert not found.closed[beyond].any()
