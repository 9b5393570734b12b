# SPDX-License-Identifier: Apache-2.0
"""Suspended robots that must hold their weight within 10 %: the factor of the required set."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.workspace.capacity import capacity_along
from cabols_control.workspace.wrench_set import wrench_box
from case_robots import load


@pytest.mark.parametrize("name", ["swin_susp", "caroca"])
def test_no_infeasible_pose_has_a_factor_above_one(name):
    """With a least tension a multiple of the set can be feasible where the set itself is not."""
    rng = np.random.default_rng(0)
    geometry, low, high, weight = load(name)
    low = np.maximum(low, 0.1 * high.max())
    spread = rng.uniform(-0.25, 0.25, (60, 3)) * np.ptp(geometry.base_points, axis=0)
    half = np.r_[
        np.full(3, 0.1 * weight[2]), np.full(3, 0.02 * weight[2] * geometry.platform_radius)
    ]
    turns = np.repeat(np.eye(3)[None], 60, axis=0)
    found = capacity_along(
        geometry, geometry.reference_position + spread, turns, low, high, wrench_box(half, weight)
    )
    assert (~found.feasible).any()
    assert not np.any(found.factor[~found.feasible] > 1.0)
