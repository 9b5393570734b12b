# SPDX-License-Identifier: Apache-2.0
"""The limb controller: modes, staleness, pre-tightening, what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.errors import ShapeError
from cabols_control.limb_control.controller import LimbController, LimbSample, TensionSetpoint
from cabols_control.ros.messages import topics
from cabols_control.supervision.modes import OperatingMode

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


def test_a_limb_on_a_moving_platform_leads_by_half_a_period(controller, rig):
    """At steady speed the law acts as if the cable were stretched by half a millisecond more."""
    speed, later, mode = 0.08, LimbController(rig), OperatingMode.LOADING
    ahead = 0.0005 * speed
    for k in range(20):
        moving = loaded(0.001 * k)._replace(cable_speed=np.full(N, speed))
        stretched = loaded(0.001 * k)._replace(
            elongation=moving.elongation + ahead, tension=moving.tension + 2200.0 * ahead
        )
        led = controller.step(moving, mode, setpoint(0.001 * k, 12.0)).copy()
        # What feeds the motor that speed is in the first current of a bumpless start.
        assert led == pytest.approx(later.step(stretched, mode, setpoint(0.001 * k, 12.0)))
    assert (led > 0.0).all()


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
    assert "stale" in controller.fault.reason
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
    assert reason in controller.fault.reason


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
    assert "not finite" in controller.fault.reason


def test_nan_wound_length_stops_pretightening(controller):
    controller.step(sample(1.0), OperatingMode.PRETIGHTENING, None)
    lost = sample(1.001, wound=np.nan)
    assert (controller.step(lost, OperatingMode.PRETIGHTENING, None) == 0.0).all()
    assert "not finite" in controller.fault.reason


def test_nan_wound_length_at_rest_is_survived(controller):
    controller.step(sample(1.0, wound=np.nan), OperatingMode.STOPPED, None)
    assert (controller.step(loaded(1.001), OperatingMode.STOPPED, None) == 0.0).all()


def test_repeated_or_older_state_changes_nothing(controller):
    controller.step(loaded(1.000), OperatingMode.LOADING, setpoint(1.0, 30.0))
    before = controller.step(loaded(1.001), OperatingMode.LOADING, setpoint(1.0, 30.0)).copy()
    for stamp in (1.001, 0.999, np.nan):
        after = controller.step(loaded(stamp), OperatingMode.LOADING, setpoint(1.0, 30.0))
        np.testing.assert_array_equal(after, before)


def test_clock_that_is_set_back_stops_until_stopped(controller):
    """As of a bridge that was restarted: an old current must not stay for as long as that."""
    load = OperatingMode.LOADING
    controller.step(loaded(1000.0), load, setpoint(1000.0, 30.0))
    assert controller.step(loaded(1000.001), load, setpoint(1000.0, 30.0)).any()
    assert not controller.step(loaded(5.0), load, setpoint(5.0, 30.0)).any()
    assert "went back by 995 s" in controller.fault.reason
    assert not controller.step(loaded(5.001), load, setpoint(5.0, 30.0)).any()
    controller.step(loaded(5.002), OperatingMode.STOPPED, None)
    assert not controller.fault
    controller.step(loaded(5.003), load, setpoint(5.003, 30.0))
    assert controller.step(loaded(5.004), load, setpoint(5.004, 30.0)).any()


def test_command_from_the_future_is_stale(controller):
    controller.step(loaded(1.0), OperatingMode.LOADING, setpoint(9.0, 30.0))
    assert "stale: -8000.0 ms old" in controller.fault.reason


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


def messages(rig, limbs=N):
    state, answer = (
        topics.limb_state_layout(rig.geometry),
        topics.motor_current_layout(rig.geometry, limbs),
    )
    return state, state.record(), answer.record()


def as_message(layout, record, taken, sequence):
    """A limb state as it comes from DDS: read-only, not aligned."""
    record.stamp(round(1e9 * taken.stamp_s))
    record["sequence"][0] = sequence
    record["limb"][:] = range(N)
    for name in ("wound_length", "elongation", "tension", "switch_closed", "zeroed"):
        record[name][:] = getattr(taken, name)
    return np.frombuffer(record.raw(), layout.compiled_dtype, 1)


def test_messages_and_arrays_are_answered_alike(rig, random):
    """Same currents, to the bit, from message to message as from arrays, saturated ones too."""
    by_message, by_arrays = LimbController(rig), LimbController(rig)
    layout, record, answer = messages(rig)
    saturated = 0
    stamp_s, tension = 0.0, random.uniform(5.0, 80.0, N)
    for k in range(400):
        stamp_s += random.choice([0.001, 0.0012, 0.004, 0.02], p=[0.8, 0.1, 0.09, 0.01])
        tension = np.clip(tension + random.normal(0.0, 0.3, N), 1.0, 100.0)
        closed = random.random(N) < 0.9
        state = sample(stamp_s, 0.01 + tension / 9e4, tension / 2200.0, tension, closed, True)
        wanted = TensionSetpoint(
            stamp_s - 0.001, random.uniform(-10.0, 160.0, N), bool(random.random() < 0.9)
        )
        message = as_message(layout, record, state, k)
        by_message.answer(stamp_s, OperatingMode.LOADING, wanted, message, answer.compiled)
        expected = by_arrays.step(state, OperatingMode.LOADING, wanted)
        np.testing.assert_array_equal(by_message.current, expected)
        np.testing.assert_array_equal(by_message.saturated, by_arrays.saturated)
        np.testing.assert_array_equal(answer["current"], expected)
        np.testing.assert_array_equal(answer["saturated"], by_arrays.saturated)
        assert answer["sequence"][0] == k
        sent_s = answer["header.stamp.sec"][0] + 1e-9 * answer["header.stamp.nanosec"][0]
        assert sent_s == pytest.approx(stamp_s, abs=1e-9)
        saturated += by_arrays.saturated.any()
    assert saturated > 20


@pytest.mark.parametrize(
    ("change", "mode", "wanted", "reason"),
    [
        ({"zeroed": False}, OperatingMode.LOADING, setpoint(0.003), "not pre-tightened: limb 4"),
        ({"elongation": np.nan}, OperatingMode.LOADING, setpoint(0.003), "not finite"),
        ({"tension": np.inf}, OperatingMode.LOADING, setpoint(0.003), "not finite"),
        ({"stamp_s": 0.002}, OperatingMode.LOADING, setpoint(0.002), ""),
        ({"stamp_s": 0.02}, OperatingMode.LOADING, setpoint(0.02), ""),
        ({"limb": 7}, OperatingMode.LOADING, setpoint(0.003), "expected the indices 0 to 7"),
        ({}, OperatingMode.LOADING, setpoint(0.003, np.nan), "not finite"),
        ({}, OperatingMode.LOADING, setpoint(-1.0), "stale"),
        ({}, OperatingMode.LOADING, None, "no tension_command"),
        ({"limb": 7}, OperatingMode.UNLOADING, setpoint(0.003), "expected the indices 0 to 7"),
        ({"limb": 7}, OperatingMode.STOPPED, None, ""),
    ],
)
def test_messages_that_are_not_a_loaded_rigs(controller, rig, change, mode, wanted, reason):
    """Each ends with its reason and zero current; a repeated state and a gap change nothing."""
    for k in range(3):
        controller.step(loaded(0.001 * k), OperatingMode.LOADING, setpoint(0.001 * k, 30.0))
    before = controller.current.copy()
    layout, record, answer = messages(rig)
    state = loaded(change.get("stamp_s", 0.003))
    for name in set(change) & {"zeroed", "elongation", "tension"}:
        getattr(state, name)[3] = change[name]
    message = as_message(layout, record, state, 1)
    if "limb" in change:
        record["limb"][3] = change["limb"]
        message = np.frombuffer(record.raw(), layout.compiled_dtype, 1)
    controller.answer(state.stamp_s, mode, wanted, message, answer.compiled)
    assert bool(controller.fault) == bool(reason)
    assert not reason or reason in controller.fault.reason
    kept = mode == OperatingMode.LOADING and not reason
    np.testing.assert_array_equal(controller.current, before if kept else np.zeros(N))
    np.testing.assert_array_equal(answer["current"], controller.current)
    assert answer["sequence"][0] == 1


def test_a_part_of_the_limbs_is_answered_by_message(rig):
    by_message, by_arrays = LimbController(rig, [1, 3]), LimbController(rig, [1, 3])
    layout, record, answer = messages(rig, 2)
    for k in range(4):
        wanted = TensionSetpoint(0.001 * k, np.full(2, 30.0), True)
        state = loaded(0.001 * k)
        message = as_message(layout, record, state, k)
        by_message.answer(0.001 * k, OperatingMode.LOADING, wanted, message, answer.compiled)
        expected = by_arrays.step(state, OperatingMode.LOADING, wanted)
        np.testing.assert_array_equal(answer["current"], expected)
    assert (expected > 0.0).all()


def test_records_of_other_lengths_are_refused(rig):
    """The compiled step writes where it is told: nothing else would notice."""
    layout, record, answer = messages(rig, 2)
    message = as_message(layout, record, loaded(0.001), 1)
    arguments = (0.001, OperatingMode.LOADING, setpoint(0.001), message)
    with pytest.raises(ShapeError, match="current: expected one record with"):
        LimbController(rig).answer(*arguments, answer.compiled)
    with pytest.raises(ShapeError, match="setpoint: expected one tension for each of 2 limbs"):
        LimbController(rig, [1, 3]).answer(*arguments, answer.compiled)
    with pytest.raises(ShapeError, match="limb: expected one record with"):
        LimbController(rig).answer(*arguments[:3], np.zeros(1, [("stamp", "f8")]), answer.compiled)
