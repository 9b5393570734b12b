# SPDX-License-Identifier: Apache-2.0
"""Samples that come late: a limb that moves through a gap is neither jammed nor jumping."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.scaling import LIMB_READING
from cabols_hw.safety.config import load_safety
from cabols_hw.safety.limb_rules import LIMB_LIMITS, LIMB_WATCH, forget_motion, judge_limbs
from cabols_hw.safety.rules import Rule
from rig_harness import RigInOneProcess

GAIN, TIME_CONSTANT = 0.9, 0.36  # k [m/s/A] and T [s] of limb 1 of the bench
CURRENT_A = 0.8


def rules():
    """Limits of the bench and the memory of one limb that has a zero."""
    config = load_safety()
    limits = np.zeros(1, LIMB_LIMITS)
    for name in LIMB_LIMITS.names:
        if hasattr(config, name):
            limits[name] = getattr(config, name)
    limits["acts"], limits["current_limit"] = 1, 3.0
    limits["cable_tension"] = 1e3
    watch = np.zeros(1, LIMB_WATCH)
    watch["gain"], watch["time_constant"] = GAIN, TIME_CONSTANT
    watch["began"] = watch["slack_stretch"] = np.nan
    forget_motion(watch)
    return limits, watch


def judge(gap_s, jams_at_s=np.inf):
    """Wind in by (3.11) for 60 ms with one long sample; the broken rules."""
    limits, watch = rules()
    readings = np.zeros(1, LIMB_READING)
    readings["stiffness"] = 2200.0
    speed = length = now_s = 0.0
    found = []
    for k in range(60):
        dt_s = gap_s if k == 40 else 0.001
        for _ in range(20):
            speed += dt_s / 20.0 * (GAIN * CURRENT_A - speed) / TIME_CONSTANT
            if now_s > jams_at_s:
                speed = 0.0
            length += dt_s / 20.0 * speed
        now_s += dt_s
        if dt_s > 0.005:
            forget_motion(watch)
        readings["stretch"] = length
        rule, _ = judge_limbs(
            dt_s, limits, watch, readings, np.array([length]), np.array([1.0]),
            np.array([CURRENT_A]), np.array([False]),
        )  # fmt: skip
        found.append(rule)
    return found


@pytest.mark.parametrize("gap_ms", [1, 2, 3, 4, 4.9, 5.1, 8, 12, 19])
def test_gap_while_a_limb_moves_breaks_no_rule(gap_ms):
    assert set(judge(1e-3 * gap_ms)) == {Rule.FINE}


@pytest.mark.parametrize("gap_ms", [1, 4, 8])
def test_limb_that_jams_is_found_in_spite_of_a_gap(gap_ms):
    found = judge(1e-3 * gap_ms, jams_at_s=0.01)
    assert Rule.MOTION in found


def test_gauge_that_shows_the_same_number_after_a_gap_is_not_flat(rig, card, plant_config):
    """Of two samples a quarter of a second apart nothing is known in between."""
    bench = RigInOneProcess(rig, card, plant_config, seed=3)
    bench.run(0.1)
    envelope, now_s = bench.guard.safety, bench.now_s
    for k in range(1, 4):
        found = envelope.judge(now_s + 0.25 * k, bench.bridge, OperatingMode.STOPPED)
        assert found is None, found.reason
    for k in range(1, 300):
        found = found or envelope.judge(
            now_s + 0.75 + 1e-3 * k, bench.bridge, OperatingMode.STOPPED
        )
    assert found.name == "sensor_flat"
