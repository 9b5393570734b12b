# SPDX-License-Identifier: Apache-2.0
"""Tensions that change little with the pose: against a general optimiser, and the exact ones."""

from __future__ import annotations

import numpy as np
import pytest
import quadprog

from cabols_control.geometry import load_geometry
from cabols_control.kinematics import structure_matrix
from cabols_control.tension import (
    DEFAULT_WEIGHTS,
    RigTensionResolver,
    TensionResolver,
    distribute,
)
from tension_cases import random_rig

BENCH = load_geometry()
WEIGHTS = np.array(DEFAULT_WEIGHTS)
LOW, HIGH = 1.0, 150.0
RHO = 100.0 * HIGH
"""What kernels/smooth.py states."""
A = structure_matrix(BENCH, BENCH.reference_position + np.array([1e-5, 0.0, 2e-5]), np.eye(3))


def wrenches(count, seed, longest):
    """Wrenches of random directions, up to a weighted length [N]."""
    rng = np.random.default_rng(seed)
    found = rng.standard_normal((count, 6))
    found /= np.linalg.norm(found, axis=1)[:, None]
    return found * rng.uniform(0.0, longest, count)[:, None] / WEIGHTS


def penalty(tension, wrench):
    """What is minimised."""
    missed = np.linalg.norm(WEIGHTS * (A @ tension - wrench))
    return 0.5 * tension @ tension + RHO * missed


def test_the_penalty_is_least():
    """Against quadprog, with the miss that was found as the weight of its square."""
    soft = 0
    for wrench in wrenches(300, 0, 600.0):
        found = distribute(A, wrench, LOW, HIGH)
        missed = np.linalg.norm(WEIGHTS * found.residual)
        if missed < 1e-6:
            continue
        soft += 1
        B, e = WEIGHTS[:, None] * A, missed / RHO
        P = B.T @ B + e * np.eye(8)
        C = np.hstack([np.eye(8), -np.eye(8)])
        b = np.concatenate([np.full(8, LOW), np.full(8, -HIGH)])
        other = quadprog.solve_qp(P, B.T @ (WEIGHTS * wrench), C, b)[0]
        assert penalty(found.tension, wrench) <= penalty(other, wrench) + 1e-6
        np.testing.assert_allclose(found.tension, other, atol=1e-4)
    assert soft > 50


def test_well_inside_it_is_the_exact_answer():
    for wrench in wrenches(300, 1, 60.0):
        found = distribute(A, wrench, LOW, HIGH)
        assert found.feasible
        assert found.loss == 0.0
        C = np.hstack([A.T, np.eye(8), -np.eye(8)])
        b = np.concatenate([wrench, np.full(8, LOW), np.full(8, -HIGH)])
        other = quadprog.solve_qp(np.eye(8), np.zeros(8), C, b, 6)[0]
        np.testing.assert_allclose(found.tension, other, atol=1e-9)


@pytest.mark.parametrize("method", ["min_norm", "p_norm", "barycentre", "analytic_centre"])
def test_feasible_and_loss_refer_to_the_true_set(method):
    for wrench in wrenches(200, 2, 600.0):
        found = distribute(A, wrench, LOW, HIGH, method)
        exact = distribute(A, wrench, LOW, HIGH, method, exact=True)
        longer = np.linalg.norm(WEIGHTS * found.residual)
        longer -= np.linalg.norm(WEIGHTS * exact.residual)
        assert found.feasible == exact.feasible
        assert found.loss == pytest.approx(longer, abs=1e-6)
        assert found.tension.min() >= LOW
        assert found.tension.max() <= HIGH


def test_one_by_one_and_in_batches_are_the_same():
    many = wrenches(200, 3, 600.0)
    position, rotation = np.array(BENCH.reference_position), np.eye(3)
    at = structure_matrix(BENCH, position, rotation)
    fixed = TensionResolver(at, LOW, HIGH)
    moving = RigTensionResolver(BENCH.base_points, BENCH.platform_points, LOW, HIGH)
    batch, status = fixed.solve_batch(many)
    for k, wrench in enumerate(many):
        one = fixed.solve(wrench)
        assert one.feasible == (status[k] == 0)
        np.testing.assert_array_equal(one.tension, batch[k])
        other = moving.solve(position, rotation, wrench)
        np.testing.assert_allclose(other.tension, one.tension, atol=1e-7)
        np.testing.assert_allclose(
            distribute(at, wrench, LOW, HIGH).tension, one.tension, atol=1e-9
        )


@pytest.mark.parametrize(("seed", "cables", "which"), [(7819, 12, 1), (10332, 9, 2)])
def test_what_does_not_settle_is_never_worse_than_the_exact_answer(seed, cables, which):
    """Torques in N mm beside the weights for N m: the penalty's equations are badly scaled."""
    rng = np.random.default_rng(seed)
    matrix = random_rig(rng, cables)
    matrix[3:] *= 1000.0
    for _ in range(which + 1):
        wrench = matrix @ rng.uniform(0.0, 100.0, cables) * rng.choice([1.0, 3.0])
    most = 100.0

    def penalty_of(found):
        missed = np.linalg.norm(WEIGHTS * found.residual)
        return 0.5 * found.tension @ found.tension + 100.0 * most * missed

    found = distribute(matrix, wrench, 0.0, most)
    exact = distribute(matrix, wrench, 0.0, most, exact=True)
    assert penalty_of(found) <= penalty_of(exact) * (1.0 + 1e-9)
