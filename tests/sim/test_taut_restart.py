# SPDX-License-Identifier: Apache-2.0
"""A bridge that starts again under a load, without a bias, with switches that say the wrong thing.

Nothing is known then: cables that pull read as slack ones, and the sensor's numbers have no zero.
Its changes tell all the same.
"""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.supervision.modes import OperatingMode
from cabols_sim.fault_campaign.in_process.trials import Bench

GROWTH_N = 60.0
"""Most that a limb may gain: what the sensor must see first, by one limb, and its stopping."""
SEARCH_N = 0.06 * 2200.0 + 1.0
"""Where all limbs pull alike no resultant tells: there the search's length ends it."""


@pytest.fixture(scope="module")
def bench():
    return Bench()


def held(bench, load_n, seed):
    """A rig that was cut under a load, and whose bridge has started again without a bias."""
    rig = bench.zeroed(seed)
    direction = np.random.default_rng(seed).normal(size=3)
    rig.mode = OperatingMode.LOADING
    rig.desired[:3] = load_n * direction / np.linalg.norm(direction)
    rig.run(0.8)
    rig.guard.emergency_stop()
    rig.mode = OperatingMode.FAULT
    rig.run(0.3)
    rig.start_again(None)
    rig.run(0.4)
    return rig


def inverted(rig):
    sense = rig.plant.sense

    def senses():
        counts, gauges, lines = sense()
        return counts, gauges, ~lines

    rig.plant.sense = senses


def all_open(rig):
    for limb in range(rig.plant.tension.size):
        rig.plant.inject("switch_open", limb)


@pytest.mark.parametrize("mode", [OperatingMode.PRETIGHTENING, OperatingMode.FREE_MOVING])
@pytest.mark.parametrize("wrong", [inverted, all_open])
@pytest.mark.parametrize("load_n", [0.0, 40.0, 90.0])
def test_no_limb_gains_much_before_the_sensor_tells(bench, mode, wrong, load_n):
    rig = held(bench, load_n, 1)
    wrong(rig)
    assert rig.bridge.tared == (load_n == 0.0)
    before = rig.plant.tension.max()
    peak = 0.0
    rig.mode = mode
    for _ in range(7000):
        rig.cycle()
        peak = max(peak, rig.plant.tension.max())
        if rig.guard.fault is not None and not rig.guard.recovering:
            break
    assert rig.guard.fault is not None
    assert rig.guard.fault.name == "switch"
    assert peak <= before + (GROWTH_N if load_n else SEARCH_N)
    assert peak <= 145.0


@pytest.mark.parametrize("mode", [OperatingMode.PRETIGHTENING, OperatingMode.FREE_MOVING])
@pytest.mark.parametrize("load_n", [25.0, 100.0])
def test_a_load_is_taken_off_without_a_bias_where_the_switches_are_right(bench, mode, load_n):
    rig = held(bench, load_n, 2)
    rig.mode = mode
    rig.run(3.0, lambda: rig.guard.fault is not None)
    assert rig.guard.fault is None
    assert rig.plant.tension.max() < 12.0
