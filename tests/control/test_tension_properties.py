# SPDX-License-Identifier: Apache-2.0
"""Properties that every answer of the redundancy resolution must have, on generated rigs."""

from __future__ import annotations

from functools import partial

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cabols_control.tension import DEFAULT_WEIGHTS, distribute

# The exact answers; those that change little with the pose: test_tension_smooth.py.
distribute = partial(distribute, exact=True)
WEIGHTS = np.array(DEFAULT_WEIGHTS)
LIMITS = st.tuples(st.floats(0.0, 20.0), st.floats(0.0, 300.0))


@st.composite
def problems(draw):
    """A random matrix with unit force columns, limits, a wrench in or around the feasible set."""
    n = draw(st.integers(6, 11))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    direction = rng.normal(size=(3, n))
    direction /= np.linalg.norm(direction, axis=0)
    A = np.vstack([direction, np.cross(rng.uniform(-0.3, 0.3, (n, 3)), direction.T).T])
    start, width = draw(LIMITS)
    low = np.full(n, start)
    high = low + rng.uniform(0.0, 1.0, n) * width
    wrench = A @ rng.uniform(low, high) * draw(st.sampled_from([1.0, 1.0, 1.3, 5.0]))
    return A, wrench, low, high


def kkt_gap(A, tension, low, high, gradient):
    """How far -gradient is from the normal cone of the limits, in the units of the gradient."""
    scale = max(1.0, float(np.abs(high).max()))
    at_low, at_high = tension <= low + 1e-9 * scale, tension >= high - 1e-9 * scale
    gap = np.abs(gradient)
    gap[at_low] = np.minimum(gap[at_low], np.maximum(0.0, -gradient[at_low]))
    gap[at_high] = np.minimum(gap[at_high], np.maximum(0.0, gradient[at_high]))
    return float(gap.max())


@settings(max_examples=300)
@given(problems())
def test_limits_and_equilibrium_hold(problem):
    A, wrench, low, high = problem
    solution = distribute(A, wrench, low, high)
    assert (solution.tension >= low).all()
    assert (solution.tension <= high).all()
    np.testing.assert_allclose(solution.residual, A @ solution.tension - wrench, atol=1e-9)
    if solution.feasible and np.linalg.cond(A) < 1e6:
        assert np.abs(solution.residual).max() <= 1e-9 * max(1.0, high.max() / 100.0)


@settings(max_examples=300)
@given(problems())
def test_answers_satisfy_the_kkt_conditions(problem):
    A, wrench, low, high = problem
    solution = distribute(A, wrench, low, high)
    scale = max(1.0, float(high.max()), float(np.abs(WEIGHTS * wrench).max()))
    if not solution.feasible:
        gradient = (WEIGHTS[:, None] * A).T @ (WEIGHTS * solution.residual)
        assert kkt_gap(A, solution.tension, low, high, gradient) < 1e-8 * scale
        return
    # Feasible: t - A^T y must be zero off the limits; y from the tensions strictly inside.
    inside = (solution.tension > low + 1e-7 * scale) & (solution.tension < high - 1e-7 * scale)
    part = A[:, inside]
    if np.linalg.matrix_rank(part, tol=1e-3) < 6:
        return
    y = np.linalg.lstsq(part.T, solution.tension[inside], rcond=None)[0]
    gradient = solution.tension - A.T @ y
    assert kkt_gap(A, solution.tension, low, high, gradient) < 1e-6 * scale


@settings(max_examples=200)
@given(problems(), st.floats(1e-3, 1e3))
def test_scaling_wrench_and_limits_scales_the_tensions(problem, factor):
    A, wrench, low, high = problem
    plain = distribute(A, wrench, low, high)
    scaled = distribute(A, factor * wrench, factor * low, factor * high)
    tolerance = 1e-6 * factor * max(1.0, float(high.max()))
    np.testing.assert_allclose(scaled.residual, factor * plain.residual, atol=tolerance)


@settings(max_examples=200)
@given(problems(), st.randoms(use_true_random=False))
def test_the_order_of_the_cables_does_not_matter(problem, random):
    A, wrench, low, high = problem
    order = list(range(A.shape[1]))
    random.shuffle(order)
    plain = distribute(A, wrench, low, high)
    turned = distribute(A[:, order], wrench, low[order], high[order])
    scale = max(1.0, float(high.max()), float(np.abs(WEIGHTS * wrench).max()))
    np.testing.assert_allclose(turned.residual, plain.residual, atol=1e-7 * scale)
    norms = [float(np.linalg.norm(s.tension)) for s in (plain, turned)]
    if plain.feasible and turned.feasible:
        assert abs(norms[0] - norms[1]) < 1e-6 * scale
