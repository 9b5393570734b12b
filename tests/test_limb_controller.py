"""The limb controller: modes, staleness, pre-tightening, what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.limb_controller import LimbController, LimbSample, TensionSetpoint
from cabols_control.modes import OperatingMode

N = 8


def sample(stamp_s, wound=0.0, elongation=np.nan, tension=np.nan, switch=False, zeroed=False):
    def array(value):
        return np.broadcast_to(np.asarray(value), (N,)).copy()

    return LimbSample(
        stamp_s, array(wound), array(elongation), array(tension), array(switch), array(zeroed)
    )


def loaded(stamp_s, tension=10.0):
    return sample(stamp_s, 0.01, tension / 2200.0, tension, True, True)


def setpoint(stamp_s, tension=10.0, active=True):
    return TensionSetpoint(stamp_s, np.full(N, tension), active)


@pytest.fixture
def controller(rig):
    return LimbController(rig)


@pytest.mark.parametrize("mode", [OperatingMode.STOPPED, OperatingMode.FAULT])
def test_rest_is_zero_current(controller, mode):
    controller.step(loaded(0.000), OperatingMode.LOADING, setpoint(0.0, 50.0))
    moving = controller.step(loaded(0.001), OperatingMode.LOADING, setpoint(0.001, 50.0))
    assert (moving > 0).all()
    assert (controller.step(loaded(0.002), mode, setpoint(0.002, 50.0)) == 0.0).all()


def test_pretightening_winds_in_until_zeroed(controller):
    for k in range(50):
        current = controller.step(sample(0.001 * k), OperatingMode.PRETIGHTENING, None)
    assert (current > 0).all()
    # Where the zero becomes known, tension control takes over without a bump.
    before = current.copy()
    hold = loaded(0.05, 1.3 * 4.7)
    np.testing.assert_allclose(
        controller.step(hold, OperatingMode.PRETIGHTENING, None), before, rtol=1e-9
    )


def test_closed_switch_without_zero_winds_out_first(controller):
    for k in range(50):
        current = controller.step(sample(0.001 * k, switch=True), OperatingMode.PRETIGHTENING, None)
    assert (current < 0).all()


def test_stale_command_stops_until_stopped(controller, rig):
    timeout = rig.control.command_timeout
    controller.step(loaded(1.0), OperatingMode.LOADING, setpoint(1.0, 50.0))
    controller.step(loaded(1.001), OperatingMode.LOADING, setpoint(1.0, 50.0))
    assert not controller.fault
    late = 1.0 + timeout + 0.001
    assert (controller.step(loaded(late), OperatingMode.LOADING, setpoint(1.0)) == 0.0).all()
    assert "stale" in controller.fault
    # A fresh command does not start it again; STOPPED clears it.
    late += 0.001
    assert (controller.step(loaded(late), OperatingMode.LOADING, setpoint(late)) == 0.0).all()
    controller.step(loaded(late + 0.001), OperatingMode.STOPPED, None)
    assert not controller.fault


@pytest.mark.parametrize(
    ("state", "command", "reason"),
    [
        (loaded(1.0), None, "no tension_command"),
        (loaded(1.0), setpoint(np.nan), "stale"),
        (sample(1.0, zeroed=False), setpoint(1.0), "not pre-tightened"),
    ],
)
def test_what_stops_a_load(controller, state, command, reason):
    current = controller.step(state, OperatingMode.LOADING, command)
    assert (current == 0.0).all()
    assert reason in controller.fault


@pytest.mark.parametrize(
    ("state", "command"),
    [
        (sample(1.001, 0.01, 0.01, np.nan, True, True), setpoint(1.001)),
        (sample(1.001, 0.01, np.nan, 10.0, True, True), setpoint(1.001)),
        (loaded(1.001), setpoint(1.001, np.nan)),
        (loaded(1.001), setpoint(1.001, np.inf)),
    ],
)
def test_not_finite_stops_a_load(controller, state, command):
    controller.step(loaded(1.0), OperatingMode.LOADING, setpoint(1.0))
    assert (controller.step(state, OperatingMode.LOADING, command) == 0.0).all()
    assert "not finite" in controller.fault


def test_nan_wound_length_stops_pretightening(controller):
    controller.step(sample(1.0), OperatingMode.PRETIGHTENING, None)
    lost = sample(1.001, wound=np.nan)
    assert (controller.step(lost, OperatingMode.PRETIGHTENING, None) == 0.0).all()
    assert "not finite" in controller.fault


def test_nan_wound_length_at_rest_is_survived(controller):
    controller.step(sample(1.0, wound=np.nan), OperatingMode.STOPPED, None)
    assert (controller.step(loaded(1.001), OperatingMode.STOPPED, None) == 0.0).all()


def test_repeated_or_older_state_changes_nothing(controller):
    controller.step(loaded(1.000), OperatingMode.LOADING, setpoint(1.0, 30.0))
    before = controller.step(loaded(1.001), OperatingMode.LOADING, setpoint(1.0, 30.0)).copy()
    for stamp in (1.001, 0.5, np.nan):
        after = controller.step(loaded(stamp), OperatingMode.LOADING, setpoint(1.0, 30.0))
        np.testing.assert_array_equal(after, before)


def test_gap_restarts_without_a_bump(controller):
    for k in range(100):
        controller.step(loaded(0.001 * k), OperatingMode.LOADING, setpoint(0.001 * k, 12.0))
    before = controller.current.copy()
    jumped = loaded(0.5, 40.0)
    after = controller.step(jumped, OperatingMode.LOADING, setpoint(0.5, 12.0))
    np.testing.assert_array_equal(after, before)


def test_command_beyond_the_spring_is_clipped(controller, rig):
    limit = rig.control.tension_max
    for k in range(3):
        at_limit = controller.step(
            loaded(0.001 * k, limit), OperatingMode.LOADING, setpoint(0.001 * k, 10.0 * limit)
        )
    np.testing.assert_allclose(at_limit, 0.0, atol=1e-9)


def test_subset_drives_its_limbs_only(rig):
    controller = LimbController(rig, [2, 5])
    part = TensionSetpoint(0.001, np.full(2, 50.0), True)
    controller.step(loaded(0.001), OperatingMode.LOADING, part)
    part = TensionSetpoint(0.002, np.full(2, 50.0), True)
    assert controller.step(loaded(0.002), OperatingMode.LOADING, part).shape == (2,)
    assert (controller.current > 0).all()
