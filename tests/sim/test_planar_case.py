# SPDX-License-Identifier: Apache-2.0
"""The 900 m case of section 2.5 and redundancy resolution for planar robots."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from cabols_sim.dynamics import state_at, stream, transmission
from cabols_sim.dynamics.planar_case import (
    DENSITY,
    TENSION_MAX,
    TENSION_MIN,
    Motion,
    case_robot,
    compare,
    models,
    run_case,
)
from cabols_sim.dynamics.redundancy import tensions_for


@pytest.fixture(scope="module")
def runs():
    robot, motion = case_robot(), Motion()
    return {name: run_case(m, motion, 41) for name, m in models(robot, motion).items()}


def test_numbers_of_the_source(runs):
    published = runs["as published"]
    assert DENSITY == 0.215
    assert 800.0 < published.length.min() < published.length.max() < 1000.0
    np.testing.assert_array_equal(published.coordinates[0], Motion().start)
    np.testing.assert_array_equal(published.coordinates[-1], Motion().end)


def test_motions_derivatives():
    motion, step = Motion(), 1e-5
    for time in (0.0, 7.0, 20.0, 33.0):
        ahead, now, behind = motion.at(time + step), motion.at(time), motion.at(time - step)
        np.testing.assert_allclose((ahead[0] - behind[0]) / (2 * step), now[1], atol=1e-6)
        np.testing.assert_allclose((ahead[1] - behind[1]) / (2 * step), now[2], atol=1e-6)


def test_tensions_give_the_force_inside_their_limits(runs):
    robot = case_robot()
    for run in runs.values():
        assert run.feasible
        assert run.tension.min() >= TENSION_MIN
        assert run.tension.max() <= TENSION_MAX
        for x, force, tension in zip(run.coordinates, run.force, run.tension, strict=True):
            given = transmission(robot, x) @ tension
            np.testing.assert_allclose(given, force, rtol=1e-9, atol=1e-7 * np.abs(force).max())


def test_planar_tensions_are_the_least_norm_by_scipy():
    robot = case_robot()
    x = np.array([40.0, -25.0, 0.05])
    state, force = state_at(robot, x), np.array([1500.0, 31000.0, 4000.0])
    found = tensions_for(robot, state, force, TENSION_MIN, TENSION_MAX)
    matrix = transmission(robot, x)
    scale = 1e4
    best = minimize(
        lambda t: t @ t,
        np.full(4, 1.0),
        jac=lambda t: 2.0 * t,
        bounds=[(TENSION_MIN / scale, TENSION_MAX / scale)] * 4,
        constraints={
            "type": "eq",
            "fun": lambda t: matrix @ t - force / scale,
            "jac": lambda _: matrix,
        },
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert best.success
    np.testing.assert_allclose(found.tension, scale * best.x, rtol=1e-6)


def test_infeasible_force_is_said():
    robot = case_robot()
    found = tensions_for(
        robot, state_at(robot, np.zeros(3)), np.array([0.0, -1e6, 0.0]), TENSION_MIN, TENSION_MAX
    )
    assert not found.feasible
    assert found.tension.max() <= TENSION_MAX


def test_leaving_the_stream_out_changes_the_force_by_it_alone(runs):
    """`additional effect of the variable mass is completely described by (2.28)`, as published."""
    published, without = runs["as published"], runs["without (2.28)"]
    np.testing.assert_allclose(without.force - published.force, published.stream, atol=1e-7)
    assert np.abs(published.stream).max() > 100.0


def test_stream_is_rho_half_of_the_rates_squared(runs):
    """(2.28) with d l / d x by finite differences."""
    robot, motion, step = case_robot(), Motion(), 1e-4
    x, x_dot, _ = motion.at(17.0)
    by_place = np.array(
        [
            (
                state_at(robot, x + step * e).cables(robot).length
                - state_at(robot, x - step * e).cables(robot).length
            )
            / (2 * step)
            for e in np.eye(3)
        ]
    )
    expected = 0.5 * DENSITY * by_place @ (x_dot @ by_place) ** 2
    np.testing.assert_allclose(stream(robot, x, x_dot), expected, rtol=1e-5, atol=1e-6)


def test_effect_grows_with_density_and_the_square_of_speed():
    def effect(density, pace):
        robot, motion = case_robot(density=density), Motion(move_s=30.0 / pace)
        variants = models(robot, motion)
        names = ("as published", "without (2.28)")
        a, b = (run_case(variants[name], motion, 31) for name in names)
        return compare(a, b, robot, motion).torque

    one = effect(DENSITY, 1.0)
    assert effect(2.0 * DENSITY, 1.0) == pytest.approx(2.0 * one, rel=1e-9)
    # Samples at other shares of the motion: the largest is met within the grid's step.
    assert effect(DENSITY, 2.0) == pytest.approx(4.0 * one, rel=0.05)
