# SPDX-License-Identifier: Apache-2.0
"""Speeds of the platform: late deliveries make none, and wrong stamps hide none."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.poses.track import pose_time
from cabols_control.rig import load_rig
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.safety.config import load_safety
from cabols_hw.safety.pose import PoseWatch

LOADING = OperatingMode.LOADING
EVERY_S = 0.004
ALLOWED = 0.02
"""Under load [m/s]."""


def fault_after(speed, arrivals, stamps):
    """When a motion at a constant speed is found too fast, from its beginning [s]; None: never."""
    rig = load_rig()
    watch, start = PoseWatch(rig, load_safety()), rig.geometry.reference_position
    assert load_safety().speed_loaded == ALLOWED
    for k, (arrival_s, stamp_s) in enumerate(zip(arrivals, stamps, strict=True)):
        position = start + np.array([speed * EVERY_S * k, 0.0, 0.0])
        moment_s = pose_time(stamp_s, arrival_s)
        assert watch.hear(arrival_s, position, np.eye(3), moment_s)
        if watch.judge(arrival_s, LOADING) is not None:
            return arrival_s - arrivals[0]
    return None


def late(moments, seed):
    """Arrivals behind stalls of up to 25 ms, in order."""
    random = np.random.default_rng(seed)
    stalls = np.where(random.uniform(size=moments.size) < 0.1, random.uniform(0.0, 0.025), 0.0)
    return np.maximum.accumulate(moments + stalls)


@pytest.mark.parametrize("seed", range(20))
def test_late_deliveries_make_no_speed(seed):
    moments = EVERY_S * np.arange(400)
    arrivals = late(moments, seed)
    assert fault_after(0.97 * ALLOWED, arrivals, moments) is None
    assert fault_after(1.03 * ALLOWED, arrivals, moments) is not None


MOMENTS = 10.0 + EVERY_S * np.arange(400)


@pytest.mark.parametrize(
    ("stamps", "within_s"),
    [
        pytest.param(MOMENTS, 0.03, id="right"),
        pytest.param(np.full(400, MOMENTS[0]), 0.1, id="standing still"),
        pytest.param(2.0 * MOMENTS[0] - MOMENTS, 0.1, id="running back"),
        pytest.param(MOMENTS - 1000.0, 0.03, id="of another clock"),
        pytest.param(2.0 * MOMENTS - MOMENTS[0], 0.3, id="twice as fast"),
        pytest.param(np.full(400, np.nan), 0.03, id="no numbers"),
    ],
)
def test_wrong_stamps_hide_no_speed(stamps, within_s):
    found_s = fault_after(1.5 * ALLOWED, MOMENTS, stamps)
    assert found_s is not None
    assert found_s <= within_s
