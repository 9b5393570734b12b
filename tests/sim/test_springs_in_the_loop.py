# SPDX-License-Identifier: Apache-2.0
"""Limbs of different springs, and cables that give way by their length, under control.

The plant's true tensions are the second opinion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cabols_control.kinematics import cable_lengths
from cabols_sim.plant.target import RigidTarget
from rig_harness import RigInOneProcess

SHARE = np.array([1.25, 0.8, 1.1, 0.9, 1.2, 0.85, 1.0, 1.15])
PER_METRE = 6.55e-5
LOAD = np.array([40.0, 0.0, 60.0, 0.0, 0.0, 2.0])
AWAY_M = np.array([0.2, -0.2, 0.2])


def lengths_at_reference(rig):
    shape = rig.geometry
    return cable_lengths(shape, shape.reference_position, shape.reference_rotation)


def worst_error(bench):
    """Largest error of a tension estimate under load [N]; the load stands."""
    bench.load(LOAD)
    assert bench.guard.fault is None
    return np.abs(bench.bridge.tension - bench.plant.tension).max()


def with_springs(rig, plant_config, k_e):
    """A plant whose limbs have these k_e at the reference pose."""
    spring = 1.0 / (1.0 / k_e - PER_METRE * lengths_at_reference(rig))
    return replace(
        plant_config, limbs=replace(plant_config.limbs, spring_stiffness=spring.tolist())
    )


def test_each_limb_is_driven_by_its_own_spring(rig, card, plant_config):
    k_e = 2200.0 * SHARE
    plant = with_springs(rig, plant_config, k_e)
    believed = replace(rig, limbs=replace(rig.limbs, stiffness=k_e.tolist()))
    bench = RigInOneProcess(believed, card, plant, seed=1)
    assert worst_error(bench) < 0.5
    assert np.abs(bench.plant.wrench - LOAD)[:3].max() < 1.0


def test_one_k_e_for_all_is_wrong_by_newtons(rig, card, plant_config):
    plant = with_springs(rig, plant_config, 2200.0 * SHARE)
    bench = RigInOneProcess(rig, card, plant, seed=1)
    assert worst_error(bench) > 5.0


@pytest.mark.parametrize("known", [True, False])
def test_a_cable_that_is_longer_is_softer(rig, card, plant_config, known):
    """The plant's cables give way by 65.5 um/(N m); with it the estimate holds far away, too."""
    k_e = 1.0 / (1.0 / 2768.0 + PER_METRE * lengths_at_reference(rig))
    limbs = replace(rig.limbs, stiffness=k_e.tolist())
    if known:
        limbs = replace(limbs, axial_stiffness=1.0 / PER_METRE)
    believed = replace(rig, limbs=limbs)
    shape = rig.geometry
    away = replace(shape, reference_position=shape.reference_position + AWAY_M)
    target = RigidTarget(away)
    exact = replace(plant_config, limbs=replace(plant_config.limbs, backlash=0.0))
    bench = RigInOneProcess(believed, card, exact, seed=1, target=target)
    bench.tell_pose()
    error = worst_error(bench)
    if known:
        assert error < 0.1
    else:
        assert error > 2.0
