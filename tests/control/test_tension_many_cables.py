# SPDX-License-Identifier: Apache-2.0
"""p-norm, barycentre and analytic centre for 9 to 12 cables and for robots in a plane.

Second opinions: the conditions of Karush, Kuhn and Tucker with scipy's nnls, quadprog for p = 2,
a random walk for the barycentre, and the compiled loops where both can be asked.
"""

from __future__ import annotations

import numpy as np
import pytest
import quadprog
from scipy.optimize import nnls

from cabols_control.errors import CabolsError
from cabols_control.tension import CHOICES, distribute
from cabols_control.tension.many_cables import choose_in_polytope
from tension_cases import HIGH, LOW, random_rig

NEW = [method for method in CHOICES if method != "min_norm"]
MIDDLE, HALF = 0.5 * (LOW + HIGH), 0.5 * (HIGH - LOW)


def null_columns(matrix):
    _, values, rows = np.linalg.svd(matrix)
    return rows[int((values > 1e-9 * values[0]).sum()) :].T


def planar(rng, cables):
    """A robot in the x-y plane as a (6, n) matrix: two forces and the torque about z."""
    anchor = rng.uniform(-1.0, 1.0, (cables, 2)) + 2.0 * np.array(
        [[np.cos(a), np.sin(a)] for a in np.linspace(0.0, 2.0 * np.pi, cables, endpoint=False)]
    )
    own = rng.uniform(-0.2, 0.2, (cables, 2))
    along = anchor - own
    along /= np.linalg.norm(along, axis=1)[:, None]
    matrix = np.zeros((6, cables))
    matrix[:2] = along.T
    matrix[5] = own[:, 0] * along[:, 1] - own[:, 1] * along[:, 0]
    return matrix


def cases():
    rng = np.random.default_rng(18)
    made = [random_rig(rng, cables) for cables in (9, 10, 11, 12) for _ in range(3)]
    made += [planar(rng, cables) for cables in (4, 5, 6, 7, 8) for _ in range(2) if cables >= 6]
    return [(matrix, matrix @ rng.uniform(LOW, HIGH, matrix.shape[1])) for matrix in made]


CASES = cases()


@pytest.mark.parametrize("method", NEW)
@pytest.mark.parametrize("case", range(len(CASES)))
def test_the_wrench_is_kept_inside_the_limits(case, method):
    matrix, wrench = CASES[case]
    found = distribute(matrix, wrench, LOW, HIGH, method=method, exact=True)
    assert found.feasible
    assert found.tension.min() >= LOW
    assert found.tension.max() <= HIGH
    np.testing.assert_allclose(matrix @ found.tension, wrench, atol=1e-7)
    np.testing.assert_allclose(found.residual, matrix @ found.tension - wrench, atol=1e-12)


@pytest.mark.parametrize("exponent", [2.0, 4.0, 16.0])
@pytest.mark.parametrize("case", range(len(CASES)))
def test_no_feasible_tension_has_a_smaller_p_norm(case, exponent):
    """The gradient lies in the cone of the limits that are met: nnls leaves nothing of it."""
    matrix, wrench = CASES[case]
    found = distribute(matrix, wrench, LOW, HIGH, "p_norm", exponent=exponent, exact=True)
    basis, deviation = null_columns(matrix), (found.tension - MIDDLE) / HALF
    size = np.abs(deviation)
    gradient = basis.T @ (size ** (exponent - 1.0) * np.sign(deviation))
    met = size > 1.0 - 1e-6
    outwards = (basis[met] * np.sign(deviation[met])[:, None]).T
    left = nnls(outwards, -gradient)[1] if met.any() else np.linalg.norm(gradient)
    assert left < 1e-5


@pytest.mark.parametrize("case", range(len(CASES)))
def test_p_of_two_is_the_quadratic_programme(case):
    matrix, wrench = CASES[case]
    found = distribute(matrix, wrench, LOW, HIGH, "p_norm", exponent=2.0, exact=True).tension
    n = matrix.shape[1]
    rows = matrix[np.linalg.norm(matrix, axis=1) > 0.0]
    given = wrench[np.linalg.norm(matrix, axis=1) > 0.0]
    limits = np.hstack([rows.T, np.eye(n), -np.eye(n)])
    bounds = np.concatenate([given, np.full(n, LOW), np.full(n, -HIGH)])
    wanted = quadprog.solve_qp(np.eye(n), np.full(n, MIDDLE), limits, bounds, len(rows))[0]
    np.testing.assert_allclose(found, wanted, atol=2e-5 * HIGH)


@pytest.mark.parametrize("case", range(len(CASES)))
def test_the_analytic_centre_has_no_slope(case):
    """Strictly inside, and the barrier's gradient has no part that keeps the wrench."""
    matrix, wrench = CASES[case]
    found = distribute(matrix, wrench, LOW, HIGH, "analytic_centre", exact=True).tension
    below, above = found - LOW, HIGH - found
    basis = null_columns(matrix)
    free = np.linalg.norm(basis, axis=1) > 1e-9
    assert min(below[free].min(), above[free].min()) > 0.0
    slope = basis[free].T @ (1.0 / above - 1.0 / below)[free]
    curve = (1.0 / above**2 + 1.0 / below**2)[free]
    newton = np.linalg.solve((basis[free].T * curve) @ basis[free], slope)
    assert slope @ newton < 1e-12


@pytest.mark.parametrize("case", [0, 3, 6, 12, 14])
def test_the_barycentre_is_the_mean_of_a_random_walk(case):
    """Hit and run: every point of the polytope is as likely as any other."""
    matrix, wrench = CASES[case]
    found = distribute(matrix, wrench, LOW, HIGH, "barycentre", exact=True).tension
    basis, rng = null_columns(matrix), np.random.default_rng(case)
    now, total, blocks = found.copy(), np.zeros(len(found)), []
    with np.errstate(divide="ignore"):
        for step in range(8000):
            along = basis @ rng.standard_normal(basis.shape[1])
            ends = np.sort([(LOW - now) / along, (HIGH - now) / along], axis=0)
            now = now + rng.uniform(ends[0].max(), ends[1].min()) * along
            total += now
            if step % 400 == 399:
                blocks.append(total / 400.0)
                total = np.zeros(len(found))
    blocks = np.array(blocks)
    error = blocks.std(axis=0, ddof=1) / np.sqrt(len(blocks))
    assert (np.abs(blocks.mean(axis=0) - found) < 4.5 * error + 1e-6).all()


@pytest.mark.parametrize("method", NEW)
@pytest.mark.parametrize("cables", [7, 8])
def test_both_ways_to_compute_agree(cables, method):
    rng = np.random.default_rng(cables)
    for _ in range(20):
        matrix = random_rig(rng, cables)
        wrench = matrix @ rng.uniform(LOW, HIGH, cables)
        compiled = distribute(matrix, wrench, LOW, HIGH, method=method, exact=True).tension
        least = distribute(matrix, wrench, LOW, HIGH, exact=True).tension
        limits = np.full(cables, LOW), np.full(cables, HIGH)
        wide = choose_in_polytope(matrix, least, *limits, CHOICES[method], 4.0)
        np.testing.assert_allclose(wide, compiled, atol=2e-4 * HIGH)


@pytest.mark.parametrize("method", NEW)
def test_tensions_run_into_the_least_norm_at_the_boundary(method):
    """Along a ray of wrenches out to the boundary and beyond nothing jumps."""
    matrix, _ = CASES[4]
    middle = matrix @ np.full(matrix.shape[1], MIDDLE)
    away = np.random.default_rng(3).standard_normal(6) * [1.0, 1.0, 1.0, 0.1, 0.1, 0.1]
    shares = np.concatenate([np.linspace(0.0, 90.0, 10), np.linspace(93.0, 94.5, 31)])
    rows = [distribute(matrix, middle + share * away, LOW, HIGH, method) for share in shares]
    feasible = np.array([row.feasible for row in rows])
    assert feasible[0]
    assert not feasible[-1]
    least = [distribute(matrix, middle + share * away, LOW, HIGH).tension for share in shares]
    steps, allowed = (
        np.abs(np.diff(tensions, axis=0)).max()
        for tensions in ([row.tension for row in rows], least)
    )
    assert steps < 1.1 * allowed + 2.0


def test_what_no_method_is_stays_refused():
    matrix, wrench = CASES[0]
    with pytest.raises(CabolsError, match="exponent"):
        distribute(matrix, wrench, LOW, HIGH, "p_norm", exponent=1.0)
    with pytest.raises(CabolsError, match="exponent"):
        distribute(matrix, wrench, LOW, HIGH, "p_norm", exponent=float("nan"))
    with pytest.raises(CabolsError, match="method"):
        distribute(matrix, wrench, LOW, HIGH, "centre")


@pytest.mark.parametrize("method", NEW)
def test_cables_that_nothing_moves_stay_at_their_one_tension(method):
    """Limits that meet leave nothing to choose; nothing is divided by their distance."""
    matrix, _ = CASES[2]
    n = matrix.shape[1]
    low, high = np.full(n, LOW), np.full(n, HIGH)
    low[1] = high[1] = MIDDLE
    found = distribute(matrix, matrix @ np.full(n, MIDDLE), low, high, method, exact=True)
    assert found.feasible
    assert found.tension[1] == pytest.approx(MIDDLE)
    least = distribute(matrix, matrix @ np.full(n, MIDDLE), low, high, exact=True).tension
    assert np.abs(found.tension - least).max() > 1.0
