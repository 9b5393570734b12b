# SPDX-License-Identifier: Apache-2.0
"""Redundancy resolution against other solvers and against the reference rig's known figures.

Solvers agree to their own tolerance only (quadprog and DAQP to 1e-8 N or so), so a reference is
polished: its active limits are taken and the least-norm tensions with those held are solved for
directly, which is exact to rounding. Where the feasible set shrinks to a point the slope of the
tensions over the wrench has no bound and no two codes need agree: there, only equilibrium and
limits are asked for.
"""

from __future__ import annotations

import importlib
import subprocess
import sys
from functools import partial

import daqp
import highspy
import numpy as np
import pytest
import quadprog
from scipy.optimize import lsq_linear

from cabols_control.cable_kernels import cable_records, structure_matrix_into
from cabols_control.errors import CabolsError, ShapeError
from cabols_control.tension import (
    DEFAULT_WEIGHTS,
    INVALID,
    RigTensionResolver,
    TensionResolver,
    detect_prepared,
    distribute,
    prepare_pose,
    solve_batch,
    solve_prepared,
    work_size,
)
from tension_cases import (
    CENTRE,
    HIGH,
    LOW,
    REFERENCE,
    boundary_wrench,
    matrix_of,
    random_rig,
    reference_points,
)

# The exact answers; those that change little with the pose: test_tension_smooth.py.
distribute = partial(distribute, exact=True)
TensionResolver = partial(TensionResolver, exact=True)
RigTensionResolver = partial(RigTensionResolver, exact=True)
WEIGHTS = np.array(DEFAULT_WEIGHTS)


def cases(count, n=8, seed=0):
    """Random rigs with feasible, boundary, just and far infeasible wrenches, in turn."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        A = random_rig(rng, n)
        kind = ("inside", "corner", "boundary", "near", "far")[k % 5]
        wrench, normal = boundary_wrench(rng, A, LOW, HIGH)
        if kind == "inside":
            wrench = A @ rng.uniform(LOW, HIGH, n)
        elif kind == "corner":
            tension = rng.uniform(LOW, HIGH, n)
            tension[rng.choice(n, 2, replace=False)] = rng.choice([LOW, HIGH], 2)
            wrench = A @ tension
        elif kind == "near":
            wrench = wrench + normal * rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-4.0, 0.0)
        elif kind == "far":
            wrench = wrench + normal * rng.uniform(1.0, 300.0)
        yield A, wrench, kind


class Margin:
    """Largest s with A t = w and low + s <= t <= high - s, by HiGHS; negative if infeasible."""

    def __init__(self, n):
        self.n = n
        self.solver = highspy.Highs()
        for name, value in (("output_flag", False), ("presolve", "off"), ("threads", 1)):
            self.solver.setOptionValue(name, value)
        for name in ("primal_feasibility_tolerance", "dual_feasibility_tolerance"):
            self.solver.setOptionValue(name, 1e-9)

    def __call__(self, A, wrench):
        n, eye, ones = self.n, np.eye(self.n), np.ones((self.n, 1))
        rows = np.block([[A, np.zeros((6, 1))], [eye, -ones], [eye, ones]])
        lp = highspy.HighsLp()
        lp.num_col_, lp.num_row_ = n + 1, 6 + 2 * n
        lp.col_cost_ = np.append(np.zeros(n), -1.0)
        lp.col_lower_, lp.col_upper_ = np.full(n + 1, -1e30), np.full(n + 1, 1e30)
        free = np.full(n, 1e30)
        lp.row_lower_ = np.concatenate([wrench, np.full(n, LOW), -free])
        lp.row_upper_ = np.concatenate([wrench, free, np.full(n, HIGH)])
        lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
        lp.a_matrix_.start_ = np.arange(7 + 2 * n) * (n + 1)
        lp.a_matrix_.index_ = np.tile(np.arange(n + 1), 6 + 2 * n)
        lp.a_matrix_.value_ = rows.ravel()
        self.solver.passModel(lp)
        self.solver.run()
        assert self.solver.getModelStatus() == highspy.HighsModelStatus.kOptimal
        return -self.solver.getInfo().objective_function_value


def polished(A, wrench, tension, held):
    """Least norm with the `held` cables at their limit: the exact answer for an active set."""
    exact = np.where(np.abs(tension - LOW) < np.abs(tension - HIGH), LOW, HIGH)
    free = ~held
    rest = wrench - A[:, held] @ exact[held]
    exact[free] = np.linalg.lstsq(A[:, free], rest, rcond=1e-13)[0]
    return exact


def by_daqp(A, wrench):
    n = A.shape[1]
    solution, _, flag, info = daqp.solve(
        np.eye(n),
        np.zeros(n),
        A,
        np.concatenate([np.full(n, HIGH), wrench]),
        np.concatenate([np.full(n, LOW), wrench]),
        np.concatenate([np.zeros(n, np.int32), np.full(6, 5, np.int32)]),
    )
    if flag != 1:
        return None
    return polished(A, wrench, np.asarray(solution), np.asarray(info["lam"])[:n] != 0.0)


def by_quadprog(A, wrench):
    n = A.shape[1]
    constraints = np.hstack([A.T, np.eye(n), -np.eye(n)])
    bounds = np.concatenate([wrench, np.full(n, LOW), np.full(n, -HIGH)])
    try:
        solution, *_, active = quadprog.solve_qp(np.eye(n), np.zeros(n), constraints, bounds, 6)
    except ValueError:
        return None
    held = np.zeros(n, dtype=bool)
    held[[(int(k) - 7) % n for k in active if k > 6]] = True
    return polished(A, wrench, solution, held)


def assert_safe(solution, A, wrench):
    assert (solution.tension >= LOW).all()
    assert (solution.tension <= HIGH).all()
    np.testing.assert_allclose(solution.residual, A @ solution.tension - wrench, atol=1e-10)
    if solution.feasible:
        assert np.abs(solution.residual).max() < 1e-9


def test_ten_thousand_random_rigs_agree_with_three_solvers():
    margin_of, compared, counts = Margin(8), 0, {True: 0, False: 0}
    for A, wrench, kind in cases(10_000):
        solution = TensionResolver(A, LOW, HIGH).solve(wrench)
        assert_safe(solution, A, wrench)
        margin = margin_of(A, wrench)
        if abs(margin) > 1e-6:
            assert solution.feasible == (margin > 0.0), (kind, margin)
            counts[solution.feasible] += 1
        if margin <= 1e-6:
            continue
        for reference in (by_daqp(A, wrench), by_quadprog(A, wrench)):
            assert reference is not None, (kind, margin)
            np.testing.assert_allclose(solution.tension, reference, rtol=0.0, atol=1e-9)
            compared += 1
    assert min(counts.values()) > 2000
    assert compared > 4000


@pytest.mark.parametrize("n", [6, 7, 9, 10])
def test_other_numbers_of_cables_agree_with_three_solvers(n):
    margin_of = Margin(n)
    for A, drawn, kind in cases(300, n, seed=n):
        wrench = A @ np.full(n, 50.0) if n < 8 and kind == "corner" else drawn
        solution = TensionResolver(A, LOW, HIGH).solve(wrench)
        assert_safe(solution, A, wrench)
        margin = margin_of(A, wrench)
        if abs(margin) > 1e-6:
            assert solution.feasible == (margin > 0.0), (kind, margin)
        if margin > 1e-6:
            for reference in (by_daqp(A, wrench), by_quadprog(A, wrench)):
                assert reference is not None, (kind, margin)
                # n = 6 has one solution; its error is the condition number's.
                scale = max(1.0, 1e-4 * np.linalg.cond(A))
                np.testing.assert_allclose(solution.tension, reference, rtol=0, atol=1e-9 * scale)


@pytest.mark.parametrize("n", [6, 7, 8, 9, 10])
def test_nearest_wrench_agrees_with_bounded_least_squares(n):
    checked = 0
    for A, wrench, _ in cases(400, n, seed=100 + n):
        solution = TensionResolver(A, LOW, HIGH).solve(wrench)
        if solution.feasible:
            continue
        reference = lsq_linear(
            WEIGHTS[:, None] * A, WEIGHTS * wrench, (LOW, HIGH), method="bvls", tol=1e-15
        )
        ours = np.linalg.norm(WEIGHTS * solution.residual)
        theirs = np.linalg.norm(reference.fun)
        assert ours <= theirs + 1e-10
        np.testing.assert_allclose(WEIGHTS * solution.residual, reference.fun, atol=1e-7)
        checked += 1
    assert checked > 100


def test_nearest_wrench_of_a_symmetric_rig_has_the_least_norm():
    """At the reference pose, the mirror images 0 and 2 (or 1 and 3) span a facet alone.

    The other six cables then give the same wrenches along a line.
    """
    rng = np.random.default_rng(5)
    resolver, shorter = TensionResolver(REFERENCE, LOW, HIGH), 0
    for k in range(60):
        pair = [k % 4, (k % 4 + 2) % 4]
        others = [i for i in range(8) if i not in pair]
        normal = np.linalg.svd(REFERENCE[:, others] * WEIGHTS[:, None])[0][:, -1]
        tension = np.where(normal @ (REFERENCE * WEIGHTS[:, None]) > 0.0, HIGH, LOW)
        tension[others] = rng.uniform(LOW, HIGH, 6)
        wrench = REFERENCE @ tension + normal / WEIGHTS * rng.uniform(0.1, 10.0)
        solution = resolver.solve(wrench)
        assert not solution.feasible
        np.testing.assert_allclose(REFERENCE @ (solution.tension - tension), 0.0, atol=1e-9)
        shorter += np.linalg.norm(solution.tension) < np.linalg.norm(tension) - 1.0
        again = least_norm_by_qp(REFERENCE, REFERENCE @ tension)
        np.testing.assert_allclose(solution.tension, again, atol=1e-5)
    assert shorter > 30


def least_norm_by_qp(A, wrench):
    """Least norm for a wrench on the boundary, by DAQP with the balance softened by 1e-8."""
    n, slack = A.shape[1], 1e-8
    solution, _, flag, _ = daqp.solve(
        np.eye(n),
        np.zeros(n),
        A,
        np.concatenate([np.full(n, HIGH), wrench + slack]),
        np.concatenate([np.full(n, LOW), wrench - slack]),
        np.zeros(n + 6, np.int32),
        primal_tol=1e-10,
    )
    assert flag == 1
    return np.asarray(solution)


def test_nearest_wrench_follows_the_weights():
    wrench = np.array([0.0, 0.0, 600.0, 0.0, 20.0, 0.0])
    torque_first = distribute(REFERENCE, wrench, LOW, HIGH, weights=[1, 1, 1, 1e3, 1e3, 1e3])
    force_first = distribute(REFERENCE, wrench, LOW, HIGH, weights=[1, 1, 1, 1e-2, 1e-2, 1e-2])
    assert np.abs(torque_first.residual[3:]).max() < 1e-2
    assert np.abs(force_first.residual[3:]).max() > 1.0
    assert abs(force_first.residual[2]) < abs(torque_first.residual[2])


@pytest.mark.parametrize("method", ["kkt_enumeration", "daqp"])
def test_other_methods_agree_with_min_norm(method):
    for k, (A, wrench, kind) in enumerate(cases(60, seed=7)):
        if kind == "boundary":
            continue
        ours = distribute(A, wrench, LOW, HIGH)
        theirs = distribute(A, wrench, LOW, HIGH, method=method)
        assert ours.feasible == theirs.feasible, (k, kind)
        np.testing.assert_allclose(ours.tension, theirs.tension, atol=1e-8)
        assert theirs.method == method


def test_missing_daqp_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "daqp", None)
    with pytest.raises(CabolsError, match="pip install daqp"):
        distribute(REFERENCE, np.zeros(6), LOW, HIGH, method="daqp")


def test_every_vertex_of_the_reference_box_is_feasible():
    resolver = TensionResolver(REFERENCE, LOW, HIGH)
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1).T
    box = np.array([94.0, 94.0, 94.0, 9.4, 9.4, 9.4])
    assert all(resolver.feasible(s * box) for s in signs)
    assert not all(resolver.feasible(1.02 * s * box) for s in signs)


@pytest.mark.parametrize(
    ("axis", "reach"), [(0, 254), (1, 222), (2, 375), (3, 55), (4, 59), (5, 53)]
)
def test_single_axes_reach_what_the_reference_says(axis, reach):
    resolver = TensionResolver(REFERENCE, LOW, HIGH)
    unit = np.eye(6)[axis]
    # Printed rounded down.
    for inside, expected in ((reach, True), (reach + 1.0, False)):
        assert (resolver.feasible(inside * unit) and resolver.feasible(-inside * unit)) is expected


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused(value):
    for index in range(6):
        wrench = np.zeros(6)
        wrench[index] = value
        with pytest.raises(ShapeError, match="wrench: expected finite"):
            distribute(REFERENCE, wrench, LOW, HIGH)
        resolver = TensionResolver(REFERENCE, LOW, HIGH)
        with pytest.raises(ShapeError, match="wrench: expected finite"):
            resolver.solve(wrench)
        tension, residual = np.full(8, 77.0), np.zeros(6)
        assert solve_prepared(resolver.work, wrench, tension, residual) == INVALID
        assert (tension == LOW).all()
        assert detect_prepared(resolver.work, wrench) == INVALID
    bad = REFERENCE.copy()
    bad[2, 3] = value
    with pytest.raises(ShapeError, match="A: expected finite"):
        distribute(bad, np.zeros(6), LOW, HIGH)
    for limits in ((value, HIGH), (LOW, value), (np.full(8, value), HIGH)):
        with pytest.raises(ShapeError, match=r"tension_m.*finite"):
            distribute(REFERENCE, np.zeros(6), *limits)


def test_a_pose_that_is_not_finite_is_invalid_not_ok():
    work = np.empty(work_size(8))
    bad = REFERENCE.copy()
    bad[5, 7] = np.nan
    assert prepare_pose(bad, np.full(8, LOW), np.full(8, HIGH), WEIGHTS, work) == 2
    tension, residual = np.empty(8), np.empty(6)
    assert solve_prepared(work, np.zeros(6), tension, residual) == INVALID
    assert (tension == LOW).all()
    rig = RigTensionResolver(*reference_points(), LOW, HIGH)
    with pytest.raises(ShapeError, match="position: expected finite"):
        rig.solve(np.array([np.nan, 0.0, 0.0]), np.eye(3), np.zeros(6))
    assert rig.solve(CENTRE, np.eye(3), np.zeros(6)).feasible


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"A": REFERENCE.T}, "transpose"),
        ({"A": REFERENCE[:, :5]}, "at least 6 columns"),
        ({"wrench": np.zeros(5)}, r"wrench: expected shape \(6\)"),
        ({"wrench": np.full(6, 1e200)}, "check the units"),
        ({"tension_min": np.ones(7)}, "tension_min: expected shape"),
        ({"tension_min": 200.0}, "expected at most tension_max"),
        ({"method": "best"}, "expected one of min_norm"),
        ({"weights": np.zeros(6)}, "positive"),
    ],
)
def test_wrong_arguments_are_named(change, match):
    arguments = {"A": REFERENCE, "wrench": np.zeros(6), "tension_min": LOW, "tension_max": HIGH}
    with pytest.raises(CabolsError, match=match):
        distribute(**{**arguments, **change})


def test_resolver_takes_lists_and_refuses_wrong_lengths():
    resolver = TensionResolver(REFERENCE, LOW, HIGH)
    wrench = [10.0, 0.0, 5.0, 1.0, 0.0, 0.0]
    expected = resolver.solve(np.array(wrench)).tension
    for other in (wrench, np.array(wrench, dtype=np.float32), np.repeat(wrench, 2)[::2]):
        np.testing.assert_array_equal(resolver.solve(other).tension, expected)
    for bad in (np.zeros(5), np.zeros(7), np.zeros((6, 1)), 3.0):
        with pytest.raises(ShapeError, match="wrench"):
            resolver.solve(bad)


@pytest.mark.parametrize("rank", [0, 3, 5])
def test_rank_deficient_matrix_is_solved_as_nearest_wrench(rank):
    rng = np.random.default_rng(rank)
    for _ in range(40):
        A = rng.normal(size=(6, rank)) @ rng.normal(size=(rank, 8))
        wrench = A @ rng.uniform(LOW, HIGH, 8)
        reached = distribute(A, wrench, LOW, HIGH)
        assert reached.feasible
        assert np.abs(reached.residual).max() < 1e-8
        assert (reached.tension >= LOW).all()
        assert (reached.tension <= HIGH).all()
        again = least_norm_by_qp(A, wrench)
        assert np.linalg.norm(reached.tension) <= np.linalg.norm(again) + 1e-5
        missed = distribute(A, wrench + rng.normal(size=6), LOW, HIGH)
        assert not missed.feasible


def test_two_equal_cables_do_no_harm():
    A = REFERENCE.copy()
    A[:, 3] = A[:, 2]
    for scale in (0.1, 1.0, 5.0):
        wrench = A @ np.full(8, 50.0) + scale * np.arange(6.0)
        solution = distribute(A, wrench, LOW, HIGH)
        assert_safe(solution, A, wrench)
        assert solution.tension[2] == pytest.approx(solution.tension[3], abs=1e-8)


def test_equal_limits_leave_one_answer():
    fixed = np.linspace(10.0, 80.0, 8)
    right = distribute(REFERENCE, REFERENCE @ fixed, fixed, fixed)
    assert right.feasible
    np.testing.assert_array_equal(right.tension, fixed)
    wrong = distribute(REFERENCE, REFERENCE @ fixed + 1.0, fixed, fixed)
    assert not wrong.feasible
    np.testing.assert_array_equal(wrong.tension, fixed)
    low, high = np.full(8, LOW), np.full(8, HIGH)
    low[[1, 4]] = high[[1, 4]] = 60.0
    for wrench in (np.zeros(6), np.full(6, 30.0), np.full(6, 300.0)):
        solution = distribute(REFERENCE, wrench, low, high)
        bvls = lsq_linear(
            WEIGHTS[:, None] * np.delete(REFERENCE, [1, 4], 1),
            WEIGHTS * (wrench - REFERENCE[:, [1, 4]].sum(1) * 60.0),
            (LOW, HIGH),
            method="bvls",
            tol=1e-15,
        )
        missed = np.linalg.norm(WEIGHTS * solution.residual)
        assert missed == pytest.approx(np.linalg.norm(bvls.fun), abs=1e-8)


def test_batches_have_the_bits_of_single_calls():
    rng = np.random.default_rng(11)
    wrenches = rng.uniform(-1.0, 1.0, (500, 6)) * np.array([200, 200, 300, 20, 20, 20])
    wrenches[7, 2] = np.nan
    resolver = TensionResolver(REFERENCE, LOW, HIGH)
    tensions, status = resolver.solve_batch(wrenches)
    assert set(status) == {0, 1, 2}
    into, codes = np.empty_like(tensions), np.empty(500, dtype=np.int64)
    solve_batch(resolver.work, wrenches, into, codes)
    np.testing.assert_array_equal(into, tensions)
    for k in np.flatnonzero(status < 2):
        solution = resolver.solve(wrenches[k])
        assert solution.tension.tobytes() == tensions[k].tobytes()
        assert solution.feasible == (status[k] == 0) == resolver.feasible(wrenches[k])


def test_pose_batches_have_the_bits_of_single_calls():
    rng = np.random.default_rng(12)
    base, platform = reference_points()
    rig = RigTensionResolver(base, platform, LOW, HIGH)
    positions = CENTRE + rng.uniform(-0.1, 0.1, (200, 3))
    rotations = np.array(
        [np.linalg.qr(np.eye(3) + 0.05 * m)[0] for m in rng.normal(size=(200, 3, 3))]
    )
    rotations *= np.sign(np.einsum("kii->ki", rotations))[:, None, :]
    wrenches = rng.uniform(-1.0, 1.0, (200, 6)) * np.array([200, 200, 300, 20, 20, 20])
    tensions, status = rig.solve_batch(positions, rotations, wrenches)
    assert set(status) == {0, 1}
    for k in range(200):
        solution = rig.solve(positions[k], rotations[k], wrenches[k])
        assert solution.tension.tobytes() == tensions[k].tobytes()
        A = matrix_of(base, platform, positions[k], rotations[k])
        fixed = TensionResolver(A, LOW, HIGH).solve(wrenches[k])
        assert fixed.feasible == solution.feasible
        np.testing.assert_allclose(fixed.tension, solution.tension, atol=1e-9)


def test_import_does_not_need_daqp():
    code = "import sys; sys.modules['daqp'] = None; "
    code += "import cabols_control.tension as t; print(t.METHODS)"
    path = importlib.import_module("cabols_control").__path__[0].rsplit("/", 1)[0]
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        check=False,
        text=True,
        timeout=60,
        cwd=path,
    )
    assert done.returncode == 0, done.stderr
    assert "min_norm" in done.stdout


def test_outputs_of_the_caller_are_filled():
    resolver = TensionResolver(REFERENCE, 1.0, 150.0)
    wrenches = np.array([[10.0, 0, 0, 0, 0, 1.0], [1e4, 0, 0, 0, 0, 0], [np.nan] * 6])
    out = (np.empty((3, 8)), np.empty(3, dtype=np.int64))
    assert resolver.solve_batch(wrenches, out)[0] is out[0]
    np.testing.assert_array_equal(out[1], [0, 1, 2])
    np.testing.assert_array_equal(out[0], resolver.solve_batch(wrenches)[0])
    with pytest.raises(ShapeError, match="out: expected"):
        resolver.solve_batch(wrenches, (np.empty((2, 8)), out[1]))
    tension = np.empty(8)
    assert resolver.solve_into(wrenches[0], tension)
    np.testing.assert_array_equal(tension, out[0][0])
    assert not resolver.solve_into(wrenches[1], tension)
    np.testing.assert_array_equal(tension, out[0][1])
    with pytest.raises(ShapeError, match="wrench"):
        resolver.solve_into(wrenches[2], tension)
    with pytest.raises(ShapeError, match="tension: expected shape"):
        resolver.solve_into(wrenches[0], np.empty(7))


def test_straight_pose_path_agrees_with_the_general_one():
    """solve_pose_eight, from the Gram matrix, against the orthonormal basis of prepare_pose."""
    rng = np.random.default_rng(31)
    compared = 0
    for _ in range(2000):
        base = rng.uniform(-1.0, 1.0, (8, 3)) * [0.9, 0.8, 0.8]
        points = rng.uniform(-0.15, 0.15, (8, 3))
        moving = RigTensionResolver(base, points, 1.0, 150.0)
        position = rng.uniform(-0.1, 0.1, 3)
        A = np.empty((6, 8))
        structure_matrix_into(cable_records(base, points), position, np.eye(3), A)
        wrench = A @ rng.uniform(1.0, 150.0, 8)
        found, expected = moving.solve(position, np.eye(3), wrench), distribute(A, wrench, 1, 150)
        assert found.feasible == expected.feasible
        scaled = A * WEIGHTS[:, None]
        if expected.feasible and np.linalg.cond(scaled) < 1e3:
            np.testing.assert_allclose(found.tension, expected.tension, atol=1e-9)
            np.testing.assert_allclose(found.residual, 0.0, atol=1e-9)
            compared += 1
    assert compared > 1000
