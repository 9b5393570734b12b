# SPDX-License-Identifier: Apache-2.0
"""p-norm, barycentre, analytic centre: against scipy's polygons and optimisers, and continuity."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, HalfspaceIntersection

from cabols_control.errors import CabolsError
from cabols_control.kinematics import structure_matrix
from cabols_control.supervision.modes import OperatingMode
from cabols_control.tension import (
    CHOICES,
    DEFAULT_WEIGHTS,
    choose_prepared,
    distribute,
    prepare_pose,
    set_method,
    work_size,
)
from cabols_control.wrench_control.controller import DesiredWrench, WrenchController
from tension_cases import HIGH, LOW, REFERENCE, boundary_wrench, random_rig
from tension_path import BOX, largest_jump, tensions_along

# The exact answers; those that change little with the pose: test_tension_smooth.py.
distribute = partial(distribute, exact=True)
MIDDLE, HALF = 0.5 * (LOW + HIGH), 0.5 * (HIGH - LOW)
NEW = [method for method in CHOICES if method != "min_norm"]
WEIGHTS = np.array(DEFAULT_WEIGHTS)


def null_rows(A):
    return np.linalg.svd(A)[2][6:]


def feasible_cases(rng, count, n=8):
    """Random rigs with wrenches of random tensions inside the limits."""
    for _ in range(count):
        A = random_rig(rng, n)
        yield A, A @ rng.uniform(LOW, HIGH, n)


def polygon_centroid(A, tension, inside):
    """Centroid of the feasible tensions from scipy's half-space intersection (qhull)."""
    rows = null_rows(A)
    spaces = np.vstack([np.c_[rows.T, tension - HIGH], np.c_[-rows.T, LOW - tension]])
    corners = HalfspaceIntersection(spaces, rows @ (inside - tension)).intersections
    corners = corners[ConvexHull(corners).vertices]
    middle = corners.mean(axis=0)
    first, second = corners - middle, np.roll(corners, -1, axis=0) - middle
    areas = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    centre = middle + (areas[:, None] * (first + second)).sum(axis=0) / (3.0 * areas.sum())
    return tension + rows.T @ centre


def test_barycentre_is_the_polygons_centroid(random):
    for A, wrench in feasible_cases(random, 60):
        tension = distribute(A, wrench, LOW, HIGH).tension
        inside = distribute(A, wrench, LOW, HIGH, "analytic_centre").tension
        expected = polygon_centroid(A, tension, inside)
        found = distribute(A, wrench, LOW, HIGH, "barycentre").tension
        np.testing.assert_allclose(found, expected, atol=1e-7)


def test_analytic_centre_has_no_slope_left(random):
    for n in (7, 8):
        for A, wrench in feasible_cases(random, 100, n):
            found = distribute(A, wrench, LOW, HIGH, "analytic_centre")
            slope = 1.0 / (HIGH - found.tension) - 1.0 / (found.tension - LOW)
            scale = np.abs(slope).max()
            assert np.abs(null_rows(A) @ slope).max() < 1e-7 * scale
            assert (found.tension > LOW).all()
            assert (found.tension < HIGH).all()


@pytest.mark.parametrize("exponent", [3.0, 4.0, 8.0])
def test_p_norm_is_least(random, exponent):
    """Against SLSQP, whose answers are only good to 1e-8 of the objective; and never worse."""
    for A, wrench in feasible_cases(random, 15):
        start = distribute(A, wrench, LOW, HIGH).tension
        rows = null_rows(A)

        def objective(z, start=start, rows=rows):
            return np.sum(np.abs((start + rows.T @ z - MIDDLE) / HALF) ** exponent)

        limits = [
            {"type": "ineq", "fun": lambda z, s=start, r=rows: s + r.T @ z - LOW},
            {"type": "ineq", "fun": lambda z, s=start, r=rows: HIGH - s - r.T @ z},
        ]
        options = {"ftol": 1e-16, "maxiter": 500}
        other = minimize(
            objective, np.zeros(2), constraints=limits, method="SLSQP", options=options
        )
        found = distribute(A, wrench, LOW, HIGH, "p_norm", exponent=exponent).tension
        own = np.sum(np.abs((found - MIDDLE) / HALF) ** exponent)
        assert own <= other.fun * (1.0 + 1e-7)
        # SLSQP may leave the limits by its tolerance, so it may be a trace lower.
        assert own >= other.fun * (1.0 - 1e-6)


def test_p_norm_of_two_is_nearest_to_the_middle(random):
    """Then it is a projection, where that keeps the limits."""
    seen = 0
    for n in (7, 8):
        for A, wrench in feasible_cases(random, 40, n):
            plain, rows = distribute(A, wrench, LOW, HIGH).tension, null_rows(A)
            nearest = plain + rows.T @ (rows @ (MIDDLE - plain))
            if nearest.min() > LOW and nearest.max() < HIGH:
                seen += 1
                found = distribute(A, wrench, LOW, HIGH, "p_norm", exponent=2.0).tension
                np.testing.assert_allclose(found, nearest, atol=1e-9)
    assert seen > 20


def test_limits_that_meet_leave_the_others_to_choose(random):
    """A cable that is held at one tension counts for no method."""
    low, high = np.full(8, LOW), np.full(8, HIGH)
    low[2] = high[2] = 40.0
    A = random_rig(random)
    tension = random.uniform(40.0, 110.0, 8)
    tension[2] = 40.0
    for method in NEW:
        found = distribute(A, A @ tension, low, high, method)
        assert found.feasible
        assert abs(found.residual).max() < 1e-9
        assert found.tension[2] == 40.0


def test_one_degree_of_redundancy_takes_the_intervals_middle(random):
    for A, wrench in feasible_cases(random, 50, 7):
        found = distribute(A, wrench, LOW, HIGH, "barycentre").tension
        row = null_rows(A)[0]
        ends = np.concatenate([(LOW - found) / row, (HIGH - found) / row])
        assert abs(ends[ends > 0.0].min() + ends[ends < 0.0].max()) < 1e-9 * HIGH


@settings(max_examples=150)
@given(st.integers(0, 2**32 - 1), st.sampled_from(NEW), st.sampled_from([6, 7, 8]))
def test_equilibrium_and_limits_hold_up_to_the_boundary(seed, method, n):
    """Inside, on the boundary of the feasible wrenches and beyond it."""
    rng = np.random.default_rng(seed)
    A = random_rig(rng, n)
    wrench, normal = boundary_wrench(rng, A, LOW, HIGH)
    for step in (0.0, -(10.0 ** rng.uniform(-9.0, 1.0)), 10.0 ** rng.uniform(-6.0, 2.0)):
        side = 1.0 if normal @ (wrench - A @ np.full(n, 75.0)) > 0.0 else -1.0
        target = wrench + side * step * normal
        plain = distribute(A, target, LOW, HIGH)
        found = distribute(A, target, LOW, HIGH, method)
        assert found.feasible == plain.feasible
        assert (found.tension >= LOW).all()
        assert (found.tension <= HIGH).all()
        if found.feasible and np.linalg.cond(A) < 1e4:
            assert np.abs(found.residual).max() <= 1e-9
        if not found.feasible:
            np.testing.assert_allclose(found.residual, plain.residual, atol=1e-7)


@pytest.mark.parametrize("method", CHOICES)
def test_tensions_are_continuous_along_a_path(rig, method):
    """Steps four times as short give jumps about four times as small; a real jump would stay."""
    coarse, fine = (
        largest_jump(tensions_along(rig.geometry, method, count, LOW, HIGH)[0])
        for count in (501, 2001)
    )
    assert coarse < 8.0
    assert fine < 0.35 * coarse


@pytest.mark.parametrize("method", NEW)
def test_tensions_stay_continuous_where_the_wrench_becomes_infeasible(method):
    """At the symmetric pose the polygon shrinks to a segment: all along it is the nearest wrench.

    The method must choose on it, too, or the tensions would jump to the segment's least norm.
    """
    direction = np.array([1.0, 0.3, -0.2, 0.02, 0.01, -0.03])
    scales = np.linspace(0.0, 400.0, 4001)
    answers = [distribute(REFERENCE, s * direction, LOW, HIGH, method) for s in scales]
    feasible = np.array([answer.feasible for answer in answers])
    assert feasible[0]
    assert not feasible[-1]
    edge = int(feasible.argmin())
    jump = np.abs(answers[edge].tension - answers[edge - 1].tension).max()
    assert jump < 1.0


def test_centres_stay_away_from_the_limits(random):
    """What they are for: the least slack is several times the minimum norm's."""
    slack = {method: [] for method in CHOICES}
    for wrench in random.uniform(-0.4, 0.4, (100, 6)) * BOX:
        for method, found in slack.items():
            t = distribute(REFERENCE, wrench, LOW, HIGH, method).tension
            found.append(min((t - LOW).min(), (HIGH - t).min()))
    assert np.median(slack["min_norm"]) < 1e-9
    assert all(min(slack[method]) > 10.0 for method in NEW)


def test_a_share_mixes_with_the_minimum_norm():
    wrench = 0.3 * BOX
    work, tension, residual = np.zeros(work_size(8)), np.zeros(8), np.zeros(6)
    prepare_pose(REFERENCE, np.full(8, LOW), np.full(8, HIGH), WEIGHTS, work)
    found = []
    for share in (0.0, 0.25, 1.0):
        set_method(work, 8, "barycentre", share=share)
        choose_prepared(work, wrench, tension, residual)
        found.append(tension.copy())
    np.testing.assert_allclose(found[1], 0.75 * found[0] + 0.25 * found[2], atol=1e-12)
    np.testing.assert_allclose(found[0], distribute(REFERENCE, wrench, LOW, HIGH).tension)


def test_refusals_say_what_is_possible():
    with pytest.raises(CabolsError, match="expected one of min_norm, p_norm"):
        set_method(np.zeros(work_size(8)), 8, "middle")
    with pytest.raises(CabolsError, match="2 degrees of redundancy at most"):
        set_method(np.zeros(work_size(9)), 9, "barycentre")
    with pytest.raises(CabolsError, match="exponent: expected 2 to 32"):
        set_method(np.zeros(work_size(8)), 8, "p_norm", exponent=float("nan"))
    with pytest.raises(CabolsError, match="share"):
        set_method(np.zeros(work_size(8)), 8, "p_norm", share=float("nan"))
    with pytest.raises(CabolsError, match='expected "min_norm" for 9 cables'):
        set_method(np.zeros(work_size(9)), 9, "analytic_centre")


def with_method(rig, method):
    return replace(rig, control=replace(rig.control, tension_method=method))


@pytest.mark.parametrize("method", NEW)
def test_controller_fades_from_the_minimum_norm_to_its_method(rig, method):
    """No cable's command steps at the start, and the wrench is the same all the while."""
    controller = WrenchController(with_method(rig, method))
    geometry = rig.geometry
    matrix = structure_matrix(geometry, geometry.reference_position, geometry.reference_rotation)
    wrench, before = 0.2 * BOX, None
    for k in range(700):
        wanted = DesiredWrench(0.001 * k, wrench)
        tension = controller.step(0.001 * k, wrench, OperatingMode.LOADING, wanted).copy()
        np.testing.assert_allclose(matrix @ tension, controller.control, atol=1e-9)
        if before is not None:
            assert np.abs(tension - before).max() < 0.5
        before = tension
    expected = distribute(matrix, controller.control, LOW, HIGH, method).tension
    np.testing.assert_allclose(before, expected, atol=1e-9)
    # Loading that ends and begins again fades again.
    controller.step(0.7, wrench, OperatingMode.STOPPED, None)
    first = controller.step(0.701, wrench, OperatingMode.LOADING, DesiredWrench(0.701, wrench))
    plain = distribute(matrix, controller.control, LOW, HIGH).tension
    assert np.abs(first - plain).max() < 0.5


def test_control_file_names_the_method(rig):
    """pydantic's error is a ValueError, as all of cabols'; load_config adds file and key."""
    with pytest.raises(ValueError, match="expected one of min_norm"):
        with_method(rig, "middle")
