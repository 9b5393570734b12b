# SPDX-License-Identifier: Apache-2.0
"""What gears do with the amplifiers off, and how fast a platform on its cables then sinks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.optimize import linprog

from cabols_control.commissioning.results import write_results
from cabols_control.configuration import load_config, read_yaml
from cabols_control.errors import ConfigError, OutOfRangeError
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.rig import GearConfig, LimbsConfig, load_rig
from cabols_control.rig_folder import rig_file
from cabols_control.workspace.suspension import (
    held_pulls,
    judge_suspension,
    payout_speeds,
    sinking_speed,
)

RANGE = np.full(3, 0.2)


def geared(rig, **gear):
    return replace(rig, limbs=replace(rig.limbs, gear=GearConfig(**gear)))


def weight_of(rig, mass):
    return np.array([0.0, 0.0, -9.80665 * mass, 0.0, 0.0, 0.0])


def test_self_locking_gears_hold_everything(rig):
    found = judge_suspension(geared(rig, self_locking=True), 10.0, np.zeros(3), RANGE)
    assert found.held.all()
    assert found.sinking == 0.0
    assert not found.payout.any()
    assert "all gears hold 150 N" in found.told()


def test_half_of_the_friction_is_counted(rig):
    found = judge_suspension(
        geared(rig, friction_current=0.03, load_current=2e-4), 2.0, np.zeros(3), RANGE
    )
    np.testing.assert_allclose(found.holds_to, 75.0)
    assert not found.held.any()
    np.testing.assert_allclose(found.payout, np.array(rig.limbs.gain) * (0.03 - 0.015))
    assert 0.0 < found.sinking < np.inf
    assert "8 of 8 gears do not hold 150 N" in found.told()


def test_one_weak_gear_is_named(rig):
    friction = [0.1] * 8
    friction[4] = 0.01
    found = judge_suspension(
        geared(rig, friction_current=friction, load_current=2e-4), 2.0, np.zeros(3), RANGE
    )
    assert found.held.tolist() == [True] * 4 + [False] + [True] * 3
    assert "1 of 8" in found.told()
    assert "limb 5" in found.told()


def test_nothing_is_believed_of_gears_that_the_file_does_not_name(rig):
    found = judge_suspension(rig, 2.0, np.zeros(3), RANGE)
    assert not found.known
    assert not found.held.any()
    assert found.sinking == np.inf
    assert "does not say" in found.told()
    assert not held_pulls(rig.limbs).any()
    assert np.isinf(payout_speeds(rig.limbs, np.ones(8))).all()


def test_the_bound_is_the_fastest_motion_that_the_cables_allow(rig, random):
    """By the other programme: the largest sinking among all twists, with no cable too fast."""
    geometry = rig.geometry
    for _ in range(20):
        position = geometry.reference_position + random.uniform(-0.2, 0.2, 3)
        rotation = np.asarray(geometry.reference_rotation)
        payout, mass = random.uniform(0.0, 0.3, 8), random.uniform(1.0, 20.0)
        weight = weight_of(rig, mass)
        weight[3:] = random.normal(size=3)
        bound = sinking_speed(geometry, position, rotation, weight, payout)
        # Lengths by differences: no structure matrix.
        rates = np.zeros((8, 6))
        for axis in range(3):
            step = np.zeros(3)
            step[axis] = 1e-6
            rates[:, axis] = (
                cable_lengths(geometry, position + step, rotation)
                - cable_lengths(geometry, position - step, rotation)
            ) / 2e-6
        rates[:, 3:] = -structure_matrix(geometry, position, rotation)[3:].T
        found = linprog(-weight, A_ub=rates, b_ub=payout, bounds=(None, None), method="highs")
        assert found.status == 0
        assert bound == pytest.approx(-found.fun / np.linalg.norm(weight[:3]), rel=1e-5)


def test_a_weight_that_cables_cannot_bear_has_no_bound(rig):
    """Far above its frame the platform hangs on nothing."""
    high = np.asarray(rig.geometry.reference_position) + np.array([0.0, 0.0, 5.0])
    rotation = np.asarray(rig.geometry.reference_rotation)
    found = sinking_speed(rig.geometry, high, rotation, weight_of(rig, 2.0), np.full(8, 0.1))
    assert found == np.inf


@pytest.mark.parametrize(
    "gear",
    [
        {},
        {"friction_current": 0.03},
        {"load_current": 0.0},
        {"friction_current": -0.1, "load_current": 1e-4},
        {"friction_current": float("nan"), "load_current": 1e-4},
        {"load_current": [1e-4, 0.0]},
        {"load_current": []},
    ],
)
def test_refuses_gears_that_say_nothing(gear):
    with pytest.raises(ValueError, match=r"load_current|friction_current"):
        GearConfig(**gear)


def test_refuses_gears_of_another_number_of_limbs(rig):
    with pytest.raises(ValueError, match="friction_current: expected one number, or 8"):
        replace(rig.limbs, gear=GearConfig(friction_current=[0.1] * 7, load_current=1e-4))


def test_gears_are_read_from_limbs_yaml(tmp_path):
    content = read_yaml(rig_file("limbs.yaml"))
    path = tmp_path / "limbs.yaml"
    path.write_text(yaml.safe_dump({**content, "gear": {"self_locking": True}}), "utf-8")
    assert load_rig(limbs=path).limbs.gear == GearConfig(self_locking=True)
    path.write_text(yaml.safe_dump({**content, "gear": {"worm": True}}), "utf-8")
    with pytest.raises(ConfigError, match="worm"):
        load_config(LimbsConfig, path)


@pytest.mark.parametrize("mass", [0.0, -1.0, float("nan")])
def test_refuses_a_platform_without_mass(rig, mass):
    with pytest.raises(OutOfRangeError):
        judge_suspension(geared(rig, self_locking=True), mass, np.zeros(3), RANGE)


def test_commissioning_keeps_what_is_known_of_the_gears(tmp_path, rig):
    known = geared(rig, friction_current=[0.03] * 8, load_current=2e-4)
    write_results(tmp_path, known, {})
    assert load_rig(limbs=tmp_path / "limbs.yaml").limbs == known.limbs
