# SPDX-License-Identifier: Apache-2.0
"""Tensions commanded in joint space: limits, rate, staleness, and back to the wrench."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.supervision.modes import OperatingMode
from cabols_control.wrench_control.controller import DesiredWrench, WrenchController
from cabols_control.wrench_control.tension_setpoint import DesiredTension, TensionReference

PERIOD_S = 0.001


def test_tensions_are_reached_at_the_limited_rate(rig):
    reference = TensionReference(rig)
    wanted = np.full(8, 60.0)
    for k in range(100):
        assert reference.step(k * PERIOD_S, PERIOD_S, DesiredTension(k * PERIOD_S, wanted), None)
    rate = rig.control.unload_tension_rate
    np.testing.assert_allclose(reference.tension, rig.holding_tension + 100 * rate * PERIOD_S)
    for k in range(100, 400):
        reference.step(k * PERIOD_S, PERIOD_S, DesiredTension(k * PERIOD_S, wanted), None)
    np.testing.assert_array_equal(reference.tension, wanted)
    assert not reference.limited


@pytest.mark.parametrize("asked", [0.0, 1000.0, -5.0])
def test_tensions_stay_inside_the_limits(rig, asked):
    reference = TensionReference(rig)
    for k in range(2000):
        wanted = DesiredTension(k * PERIOD_S, np.full(8, asked))
        reference.step(k * PERIOD_S, PERIOD_S, wanted, None)
    assert reference.limited
    control = rig.control
    clipped = np.clip(asked, control.tension_min, control.tension_max)
    np.testing.assert_array_equal(reference.tension, clipped)


def test_stale_tensions_are_let_down_and_then_forgotten(rig):
    reference = TensionReference(rig)
    for k in range(400):
        reference.step(k * PERIOD_S, PERIOD_S, DesiredTension(k * PERIOD_S, np.full(8, 60.0)), None)
    last = DesiredTension(0.399, np.full(8, 60.0))
    highest = []
    for k in range(400, 1200):
        reference.step(k * PERIOD_S, PERIOD_S, last, None)
        highest.append(reference.tension.max())
    assert highest[200] == 60.0, "held until the desired value is stale"
    assert (np.diff(highest) <= 0.0).all()
    assert not reference.active
    np.testing.assert_allclose(reference.tension, rig.holding_tension)


def run(controller, seconds, start_s, tension=None, mode=OperatingMode.LOADING, wrench=None):
    """Sensor and cables are ideal: the wrench is what the tensions make."""
    for k in range(round(seconds / PERIOD_S)):
        now_s = start_s + k * PERIOD_S
        wanted = None if tension is None else DesiredTension(now_s, tension)
        desired = None if wrench is None else DesiredWrench(now_s, wrench)
        measured = controller._matrix @ controller.tension
        controller.step(now_s, measured, mode, desired, wanted)
    return now_s + PERIOD_S


def test_wrench_controller_follows_tensions_before_a_wrench(rig):
    controller = WrenchController(rig)
    goal = np.array([60.0, 50.0, 6.0, 70.0, 6.0, 6.0, 40.0, 6.0])
    now_s = run(controller, 0.5, 0.0, goal, wrench=np.full(6, 20.0))
    np.testing.assert_array_equal(controller.tension, goal)
    np.testing.assert_allclose(controller.control, controller._matrix @ goal)
    assert controller.active
    assert controller.feasible
    # Nobody asks any more: down, then the wrench (none is asked for, either) without a jump.
    before = controller.tension.copy()
    steps, last = [], DesiredTension(now_s, goal)
    for k in range(1500):
        measured = controller._matrix @ controller.tension
        controller.step(now_s, measured, OperatingMode.LOADING, None, last)
        now_s += PERIOD_S
        steps.append(np.abs(controller.tension - before).max())
        before = controller.tension.copy()
        if k == 10:
            assert not controller.notice
        if k == 300:
            assert "desired_tension is older" in controller.notice.reason
    # Taking over, the least tensions for the same wrench may differ from rest by the rest itself.
    assert max(steps) <= rig.holding_tension
    assert controller.active
    assert np.abs(controller._matrix @ controller.tension).max() < 15.0


def test_leaving_loading_forgets_the_tensions(rig):
    controller = WrenchController(rig)
    now_s = run(controller, 0.5, 0.0, np.full(8, 60.0))
    now_s = run(controller, 0.1, now_s, np.full(8, 60.0), OperatingMode.UNLOADING)
    assert not controller.active
    run(controller, 2 * PERIOD_S, now_s, np.full(8, 60.0))
    np.testing.assert_allclose(controller.tension, rig.holding_tension, atol=1.0)


def test_not_finite_wrench_ends_a_load_by_tensions_too(rig):
    controller = WrenchController(rig)
    now_s = run(controller, 0.2, 0.0, np.full(8, 60.0))
    for _ in range(20):
        wanted = DesiredTension(now_s, np.full(8, 60.0))
        controller.step(now_s, np.full(6, np.nan), OperatingMode.LOADING, None, wanted)
        now_s += PERIOD_S
    assert not controller.active
    assert "not finite" in controller.fault.reason
