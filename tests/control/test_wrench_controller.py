# SPDX-License-Identifier: Apache-2.0
"""The wrench controller: windup, bumpless start, stale and bad inputs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.kinematics import structure_matrix
from cabols_control.supervision.modes import OperatingMode
from cabols_control.wrench_control.controller import DesiredWrench, WrenchController

LOADING = OperatingMode.LOADING


@pytest.fixture
def controller(rig):
    return WrenchController(rig)


def wanted(stamp_s, *values):
    return DesiredWrench(stamp_s, np.array(values, dtype=float))


def run(controller, measured, desired, steps, start=0.0):
    for k in range(steps):
        stamp = start + 0.001 * k
        controller.step(stamp, measured, LOADING, DesiredWrench(stamp, desired))


def test_starts_where_the_platform_is(controller, rig):
    measured = np.array([3.0, -2.0, 5.0, 0.2, 0.1, -0.3])
    controller.step(0.0, measured, LOADING, wanted(0.0, *measured))
    np.testing.assert_allclose(controller.control, measured, atol=0.05)
    matrix = structure_matrix(
        rig.geometry, rig.geometry.reference_position, rig.geometry.reference_rotation
    )
    np.testing.assert_allclose(matrix @ controller.tension, controller.control, atol=1e-9)
    assert controller.active
    assert controller.feasible


def test_infeasible_wrench_does_not_wind_up(controller):
    """After seconds beyond the limits, u is back inside as soon as the error turns."""
    infeasible = np.array([900.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    run(controller, np.zeros(6), infeasible, 5000)
    assert not controller.feasible
    assert controller.infeasible_cycles > 4000
    assert np.abs(controller.residual).max() > 1.0
    first = controller.control[0]
    run(controller, np.array([250.0, 0, 0, 0, 0, 0]), np.zeros(6), 50, start=5.0)
    assert controller.feasible
    assert controller.control[0] < first - 200.0


def test_tensions_stay_within_limits(controller, rig, random):
    for k in range(500):
        stamp = 0.001 * k
        load = random.uniform(-500, 500, 6)
        tension = controller.step(stamp, np.zeros(6), LOADING, DesiredWrench(stamp, load))
        assert tension.min() >= rig.control.tension_min - 1e-9
        assert tension.max() <= rig.control.tension_max + 1e-9


def test_stale_reference_unloads_at_the_set_rate(controller, rig):
    desired = np.array([50.0, 0.0, 0.0, 0.0, 3.0, 0.0])
    run(controller, np.zeros(6), desired, 100)
    last = DesiredWrench(0.099, desired)
    timeout = rig.control.desired_timeout
    seen = []
    for k in range(1500):
        controller.step(0.1 + 0.001 * k, np.zeros(6), LOADING, last)
        seen.append(controller.desired.copy())
    seen = np.array(seen)
    assert not controller.desired.any() or "unloading" in controller.notice.reason
    np.testing.assert_array_equal(seen[-1], 0.0)
    force_rate, torque_rate = rig.control.unload_rates
    assert np.abs(np.diff(seen[:, 0])).max() <= force_rate * 0.001 + 1e-9
    assert np.abs(np.diff(seen[:, 4])).max() <= torque_rate * 0.001 + 1e-9
    held = int(timeout * 1000) - 10
    np.testing.assert_array_equal(seen[held], desired)


def test_clock_that_is_set_back_gives_the_load_up(controller):
    desired = np.array([50.0, 0.0, 0.0, 0.0, 3.0, 0.0])
    wanted = DesiredWrench(1000.0, desired)
    controller.step(1000.0, np.zeros(6), LOADING, wanted)
    controller.step(1000.001, np.zeros(6), LOADING, wanted)
    assert controller.active
    controller.step(5.0, np.zeros(6), LOADING, wanted)
    assert not controller.active
    assert "went back by 995 s" in controller.fault.reason
    controller.step(5.001, np.zeros(6), OperatingMode.STOPPED, None)
    controller.step(5.002, np.zeros(6), LOADING, wanted)
    assert controller.active
    assert not controller.desired.any(), "a wish from the future does not count"


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_bad_samples_are_skipped_then_fatal(controller, bad):
    run(controller, np.zeros(6), np.zeros(6), 10)
    before = controller.tension.copy()
    spoiled = np.zeros(6)
    spoiled[3] = bad
    for k in range(5):
        controller.step(0.01 + 0.001 * k, spoiled, LOADING, None)
        np.testing.assert_array_equal(controller.tension, before)
        assert controller.active
    controller.step(0.02, spoiled, LOADING, None)
    assert not controller.active
    assert "not finite" in controller.fault.reason


def test_leaving_loading_forgets_everything(controller):
    run(controller, np.zeros(6), np.array([50.0, 0, 0, 0, 0, 0]), 100)
    controller.step(0.2, np.zeros(6), OperatingMode.STOPPED, None)
    assert not controller.active
    assert not controller.control.any()
    controller.step(0.3, np.zeros(6), LOADING, None)
    np.testing.assert_allclose(controller.control, 0.0, atol=1e-9)


def test_turned_platform(controller, rig):
    rotation = Rotation.from_euler("z", 20, degrees=True).as_matrix()
    position = rig.geometry.reference_position + np.array([0.05, 0.0, -0.02])
    controller.set_pose(position, rotation)
    np.testing.assert_allclose(
        controller.to_base_axes(np.array([1.0, 0, 0, 0, 1.0, 0])),
        [*rotation[:, 0], *rotation[:, 1]],
    )
    controller.step(0.0, np.zeros(6), LOADING, None)
    matrix = structure_matrix(rig.geometry, position, rotation)
    np.testing.assert_allclose(matrix @ controller.tension, controller.control, atol=1e-9)
