# SPDX-License-Identifier: Apache-2.0
"""Stiffness of the platform against the energy's second derivative, and the map of it."""

from __future__ import annotations

import csv
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from cabols_control.errors import CabolsError
from cabols_control.geometry import load_geometry
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.rig_folder import rig_file
from cabols_control.tension import distribute
from cabols_control.workspace.capacity import PlatformWeight
from cabols_control.workspace.elastic import (
    limb_stiffness,
    platform_stiffness,
    weight_stiffness,
    yield_under,
)
from cabols_control.workspace.tool.command import main

BENCH = load_geometry()
RIGS = {"points": BENCH, "pulleys": replace(BENCH, pulley_radius=0.05)}
K_E = np.linspace(1800.0, 2600.0, 8)
AXIAL_N = 15000.0
SPATIAL = np.arange(6)


def balanced(geometry, position, rotation):
    """Tensions without a net wrench."""
    matrix = structure_matrix(geometry, position, rotation)
    return distribute(matrix, np.zeros(6), 10.0, 150.0).tension


def pose(seed):
    rng = np.random.default_rng(seed)
    position = BENCH.reference_position + rng.uniform(-0.1, 0.1, 3)
    return position, Rotation.from_rotvec(rng.uniform(-0.2, 0.2, 3)).as_matrix()


def energy_of(geometry, position, rotation, tension):
    """Energy of springs that are stretched by the tensions at a pose, by a motion from it."""
    length = cable_lengths(geometry, position, rotation)
    each = limb_stiffness(K_E, AXIAL_N, length)
    rest = length - tension / each

    def energy(motion):
        turned = Rotation.from_rotvec(motion[3:]).as_matrix() @ rotation
        stretch = cable_lengths(geometry, position + motion[:3], turned) - rest
        return 0.5 * float(each @ stretch**2)

    return energy


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_second_derivative_of_the_energy(name, seed):
    geometry, (position, rotation) = RIGS[name], pose(seed)
    tension = balanced(geometry, position, rotation)
    energy = energy_of(geometry, position, rotation, tension)
    h, axes = 1e-4, np.eye(6)
    found = platform_stiffness(geometry, position, rotation, tension, K_E, AXIAL_N)
    for i in range(6):
        for j in range(6):
            ends = [
                energy(h * (a * axes[i] + b * axes[j])) * a * b for a in (1, -1) for b in (1, -1)
            ]
            assert found[i, j] == pytest.approx(sum(ends) / (4.0 * h * h), abs=0.02)


@pytest.mark.parametrize("name", RIGS)
def test_a_load_moves_it_where_the_energy_is_least(name):
    """A twentieth of the rated load: the minimum of energy less work is where K^-1 w says."""
    geometry, (position, rotation) = RIGS[name], pose(5)
    tension = balanced(geometry, position, rotation)
    energy = energy_of(geometry, position, rotation, tension)
    load = np.array([2.0, -1.0, 1.5, 0.1, 0.05, -0.1])
    scale = np.array([1e-3] * 3 + [1e-2] * 3)
    least = minimize(lambda x: energy(scale * x) - load @ (scale * x), np.zeros(6), tol=1e-14)
    stiffness = platform_stiffness(geometry, position, rotation, tension, K_E, AXIAL_N)
    expected = scale * least.x
    found = yield_under(stiffness, load[None], SPATIAL, 0.15)
    assert found.moved == pytest.approx(np.linalg.norm(expected[:3]), rel=0.03)
    assert found.turned == pytest.approx(np.linalg.norm(expected[3:]), rel=0.03)


def test_weight_below_the_origin_holds_it_upright_and_above_it_tips_it():
    """Against the second derivative of the weight's energy."""
    weight = PlatformWeight(200.0, (0.02, -0.03, -0.4))
    rotation = pose(4)[1]
    centre = rotation @ np.array(weight.centre_of_mass)

    def energy(turn):
        return weight.weight * float((Rotation.from_rotvec(turn).as_matrix() @ centre)[2])

    h, axes = 1e-3, np.eye(3)
    found = weight_stiffness(weight, rotation)
    for i in range(3):
        for j in range(3):
            ends = [
                energy(h * (a * axes[i] + b * axes[j])) * a * b for a in (1, -1) for b in (1, -1)
            ]
            assert found[3 + i, 3 + j] == pytest.approx(sum(ends) / (4.0 * h * h), abs=1e-3)
    assert found[3, 3] > 0.0
    assert not found[:3].any()


@pytest.mark.parametrize("seed", range(2))
def test_carried_weight_counts_beside_the_tensions(seed):
    geometry, (position, rotation) = BENCH, pose(seed)
    words = (geometry, position, rotation, np.full(8, 40.0), K_E, AXIAL_N)
    heavy = PlatformWeight(150.0, (0.0, 0.0, -0.2))
    more = platform_stiffness(*words, platform=heavy) - platform_stiffness(*words)
    np.testing.assert_allclose(more, weight_stiffness(heavy, rotation), atol=1e-9)


def rows_of(folder):
    return list(csv.DictReader((folder / "stiffness.csv").read_text().splitlines()))


def test_poses_beyond_the_cables_lengths_are_out_of_reach_in_the_map_too(tmp_path):
    text = rig_file("geometry.yaml").read_text(encoding="utf-8")
    robot = tmp_path / "short.yaml"
    limits = "cable_length_max: 1.5\ntension_min: 1.0\ntension_max: 150.0\n"
    robot.write_text(text + limits, encoding="utf-8")
    words = ["--counts", "3", "3", "3", "--half-widths", "0.3", "0.3", "0.3", "--spring", "2200"]
    words = ["stiffness", "--geometry", str(robot), *words, "--output", str(tmp_path / "out")]
    assert main(words) == 0
    rows = rows_of(tmp_path / "out")
    longest = [
        cable_lengths(BENCH, [float(row[f"{axis}_m"]) for axis in "xyz"], np.eye(3)).max()
        for row in rows
    ]
    far = np.array(longest) > 1.5
    assert 0 < far.sum() < 27
    assert (np.isinf([float(row["moved_mm"]) for row in rows]) == far).all()


def test_loads_in_platform_axes_turn_with_it(tmp_path):
    loads = tmp_path / "loads.csv"
    loads.write_text("50,0,0,0,0,0\n", encoding="utf-8")
    common = ["stiffness", "--counts", "1", "1", "1", "--tilt", "20", "--wrenches", str(loads)]
    found = {}
    for name, more in (("base", []), ("platform", ["--platform-axes"])):
        assert main([*common, *more, "--output", str(tmp_path / name)]) == 0
        found[name] = np.array([float(row["moved_mm"]) for row in rows_of(tmp_path / name)])
    assert found["base"][0] == found["platform"][0]
    assert np.abs(found["base"] - found["platform"]).max() > 0.1


def test_a_target_that_holds_and_a_pose_that_does_not():
    position, rotation = pose(1)
    tension = balanced(BENCH, position, rotation)
    free = platform_stiffness(BENCH, position, rotation, tension, K_E)
    held = platform_stiffness(BENCH, position, rotation, tension, K_E, target=1e9 * np.eye(6))
    load = np.eye(6)[:1] * 50.0
    assert yield_under(held, load, SPATIAL, 0.15).moved < 1e-7
    assert yield_under(free, load, SPATIAL, 0.15).moved > 1e-3
    unstable = yield_under(free - 1e5 * np.eye(6), load, SPATIAL, 0.15)
    assert unstable.moved == unstable.turned == inf
    assert unstable.least < 0.0
    unknown = yield_under(np.full((6, 6), np.nan), load, SPATIAL, 0.15)
    assert unknown.moved == inf


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan")])
def test_stiffness_that_is_none_is_refused(wrong):
    with pytest.raises(CabolsError):
        limb_stiffness(wrong, AXIAL_N, np.ones(8))
    with pytest.raises(CabolsError):
        limb_stiffness(K_E, wrong, np.ones(8))


def test_the_map_is_written(tmp_path, capsys):
    words = ["stiffness", "--counts", "3", "3", "3", "--axial", "20000", "--output", str(tmp_path)]
    assert main(words) == 0
    rows = list(csv.DictReader((tmp_path / "stiffness.csv").read_text().splitlines()))
    assert len(rows) == 27
    middle = [float(rows[13][name]) for name in ("moved_mm", "turned_mrad", "least_n_per_m")]
    assert np.isfinite(middle).all()
    assert 1.0 < middle[0] < 200.0
    assert "held by cables" in capsys.readouterr().out
