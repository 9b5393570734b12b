# SPDX-License-Identifier: Apache-2.0
"""Commands that jump: limbs and wrench still arrive, and nothing calls it a fault."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.kinematics import structure_matrix
from cabols_control.limb_control.controller import TensionSetpoint
from cabols_control.supervision.modes import OperatingMode
from cabols_control.tension import distribute
from one_process import OneProcess
from rig_harness import RigInOneProcess

WRENCH_MAX = np.array([135.0, 135.0, 400.0, 12.0, 12.0, 12.0])
"""Less than what the safety envelope allows, for the overshoot."""


@pytest.mark.parametrize("seed", range(3))
def test_limbs_arrive_after_any_jump_of_the_tensions(rig, card, plant_config, seed):
    random = np.random.default_rng(seed)
    bench = OneProcess(rig, card, plant_config, seed)
    bench.pretighten()
    bench.mode = OperatingMode.LOADING
    for _ in range(4):
        wanted = random.choice([5.0, 60.0, 100.0, 140.0], 8) + random.uniform(-4.0, 4.0, 8)
        bench.setpoint = TensionSetpoint(bench.now_s, wanted, True)
        tension = bench.run(0.6)
        assert tension.max() < 150.0
        np.testing.assert_allclose(bench.bridge.tension, wanted, atol=1.5)


def wrenches(rig, random):
    """Random feasible wrenches, most of the way to the cables' or the sensor's limit."""
    geometry = rig.geometry
    A = structure_matrix(geometry, geometry.reference_position, geometry.reference_rotation)
    while True:
        direction = random.normal(size=6) * WRENCH_MAX
        direction *= 1.0 / np.abs(direction / WRENCH_MAX).max()
        shares = np.linspace(1.0, 0.05, 20)
        feasible = [distribute(A, s * direction, 1.0, 135.0).feasible for s in shares]
        if any(feasible):
            yield shares[int(np.argmax(feasible))] * direction


@pytest.mark.parametrize("seed", range(3))
def test_wrench_arrives_after_any_jump(rig, card, plant_config, seed):
    random = np.random.default_rng(seed)
    bench = RigInOneProcess(rig, card, plant_config, seed)
    bench.load(np.zeros(6))
    for _, wanted in zip(range(4), wrenches(rig, random), strict=False):
        bench.desired = wanted
        bench.run(1.2)
        assert bench.guard.fault is None
        np.testing.assert_allclose(bench.plant.wrench / WRENCH_MAX, wanted / WRENCH_MAX, atol=0.02)
