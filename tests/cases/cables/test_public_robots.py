# SPDX-License-Identifier: Apache-2.0
"""Kinematics and redundancy resolution of public robots (CASPR's models) by independent means."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.tension import distribute
from case_robots import LIMITS, least_norm, load, lp_margin

POSES = 15
STEP = 1e-6


def poses(geometry, rng):
    for _ in range(POSES):
        offset = rng.uniform(-0.15, 0.15, 3) * np.ptp(geometry.base_points, axis=0)
        turn = Rotation.from_euler("XYZ", rng.uniform(-10, 10, 3), degrees=True)
        yield geometry.reference_position + offset, turn.as_matrix()


@pytest.mark.parametrize("name", sorted(LIMITS))
def test_structure_matrix_is_the_slope_of_the_lengths(name):
    """Virtual work: the wrench of one newton in a cable is minus the gradient of its length."""
    geometry = load(name)[0]
    for position, rotation in poses(geometry, np.random.default_rng(7)):
        A = structure_matrix(geometry, position, rotation)
        for j in range(6):
            step = np.eye(6)[j] * STEP
            turn = Rotation.from_rotvec(step[3:]).as_matrix()
            after = cable_lengths(geometry, position + step[:3], turn @ rotation)
            before = cable_lengths(geometry, position - step[:3], turn.T @ rotation)
            slope = (after - before) / (2.0 * STEP)
            np.testing.assert_allclose(slope, -A[j], atol=5e-8 * max(1.0, np.abs(A).max()))


@pytest.mark.parametrize("name", sorted(LIMITS))
def test_feasibility_and_least_norm_are_those_of_highs_and_quadprog(name):
    geometry, low, high, weight = load(name)
    rng, scale = np.random.default_rng(7), high.max()
    for k, (position, rotation) in enumerate(poses(geometry, rng)):
        A = structure_matrix(geometry, position, rotation)
        inside = A @ rng.uniform(low, high)
        beyond = weight + A @ rng.uniform(low, high) * rng.uniform(0.0, 1.5)
        wrench = (weight, inside, beyond)[k % 3]
        margin, found = lp_margin(A, wrench, low, high), distribute(A, wrench, low, high)
        if abs(margin) > 1e-8 * scale:
            assert found.feasible == (margin > 0.0)
        if found.feasible and margin > 1e-6 * scale:
            expected = least_norm(A, wrench, low, high)
            if expected is not None:
                np.testing.assert_allclose(found.tension, expected, atol=1e-12 * scale)
