# SPDX-License-Identifier: Apache-2.0
"""Rise times, steady errors and cross-coupling of steps."""

import numpy as np
import pytest

from cabols_control.errors import ShapeError
from cabols_control.run_report.judgement.step_response import analyse_steps, rise_time

RATED = np.array([165.0, 165.0, 495.0, 15.0, 15.0, 15.0])
TIME = np.arange(0.0, 6.0, 1e-3)
TAU_S = 0.1


def lag(reference, tau_s=TAU_S):
    """First order lag of each column, exact for a held reference."""
    decay = np.exp(-1e-3 / tau_s)
    value = np.zeros_like(reference)
    for k in range(1, len(reference)):
        value[k] = decay * value[k - 1] + (1.0 - decay) * reference[k - 1]
    return value


def two_steps():
    reference = np.zeros((TIME.size, 6))
    reference[TIME >= 1.0, 0] = 40.0
    reference[TIME >= 3.0, 4] = -3.0
    return reference


def test_rise_time_of_a_first_order_lag():
    value = 1.0 - np.exp(-TIME / TAU_S)
    assert rise_time(TIME, value, 0.0, 1.0) == pytest.approx(TAU_S * np.log(9.0), rel=1e-4)
    assert rise_time(TIME, 5.0 - 2.0 * value, 5.0, 3.0) == pytest.approx(0.2197, abs=1e-4)


def test_crossings_are_interpolated():
    assert rise_time([0.0, 1.0], [0.0, 1.0], 0.0, 1.0) == pytest.approx(0.8)


def test_a_step_that_does_not_get_there_has_no_rise_time():
    assert np.isnan(rise_time(TIME, 0.89 * np.ones_like(TIME), 0.0, 1.0))


def test_each_step_is_found_and_judged():
    found = analyse_steps(TIME, two_steps(), lag(two_steps()), RATED)
    assert [step.component for step in found.steps] == [0, 4]
    assert [step.size for step in found.steps] == [40.0, -3.0]
    assert [step.time for step in found.steps] == pytest.approx([1.0, 3.0])
    np.testing.assert_allclose(found.rise_times, TAU_S * np.log(9.0), rtol=1e-3)
    for step in found.steps:
        assert step.steady_error == pytest.approx(0.0, abs=1e-4)
        assert step.overshoot < 1e-4
    assert found.cross_coupling.max() < 1e-4


def test_steady_error_and_overshoot():
    reference = two_steps()
    value = lag(reference)
    value[:, 0] *= 1.02
    peak = (TIME >= 1.5) & (TIME < 1.6)
    value[peak, 0] += 4.0
    step = analyse_steps(TIME, reference, value, RATED).steps[0]
    assert step.steady_error == pytest.approx(0.8, abs=1e-3)
    # The lag is not quite settled at the bump.
    assert step.overshoot == pytest.approx(0.1, abs=0.01)


def test_cross_coupling_is_what_stands_still_and_moves():
    reference = two_steps()
    value = lag(reference)
    value[(TIME > 1.1) & (TIME < 1.2), 2] += 5.0
    found = analyse_steps(TIME, reference, value, RATED)
    expected = np.zeros(6)
    expected[2] = 5.0 / 495.0
    np.testing.assert_allclose(found.cross_coupling, expected, atol=1e-5)


def test_the_tail_of_a_step_is_no_cross_coupling():
    reference = np.zeros((TIME.size, 6))
    reference[TIME >= 1.0, 0] = 40.0
    reference[TIME >= 1.15, 1] = 40.0
    found = analyse_steps(TIME, reference, lag(reference), RATED)
    assert [step.component for step in found.steps] == [1]
    assert found.cross_coupling[0] == 0.0


def test_small_changes_and_short_holds_are_no_steps():
    reference = np.zeros((TIME.size, 6))
    reference[TIME >= 1.0, 0] = 1.6
    reference[(TIME >= 2.0) & (TIME < 2.5), 1] = 40.0
    found = analyse_steps(TIME, reference, lag(reference), RATED)
    assert [(step.component, step.size) for step in found.steps] == [(1, -40.0)]


def test_a_reference_without_steps_has_none():
    ramp = np.zeros((TIME.size, 6))
    ramp[:, 2] = 10.0 * TIME
    for reference in (np.zeros((TIME.size, 6)), ramp):
        found = analyse_steps(TIME, reference, lag(reference), RATED)
        assert found.steps == ()
        assert found.rise_times.size == 0
        np.testing.assert_array_equal(found.cross_coupling, 0.0)


def with_nan(array):
    spoilt = np.array(array, dtype=float)
    spoilt.flat[spoilt.size // 2] = np.nan
    return spoilt


@pytest.mark.parametrize("which", ["time", "desired", "measured", "rated"])
def test_nan_is_refused(which):
    arguments = {"time": TIME, "desired": two_steps(), "measured": two_steps(), "rated": RATED}
    arguments[which] = with_nan(arguments[which])
    with pytest.raises(ShapeError, match=f"{which}: expected finite numbers, got nan"):
        analyse_steps(**arguments)


@pytest.mark.parametrize(
    ("which", "value", "message"),
    [
        ("desired", np.zeros((6, TIME.size)), r"desired: expected shape .*; transpose\?"),
        ("measured", np.zeros((TIME.size - 1, 6)), "measured: expected shape"),
        ("rated", np.ones(3), "rated: expected shape"),
        ("time", np.zeros((2, 2)), "time: expected shape"),
    ],
)
def test_wrong_shapes_are_refused(which, value, message):
    arguments = {"time": TIME, "desired": two_steps(), "measured": two_steps(), "rated": RATED}
    arguments[which] = value
    with pytest.raises(ShapeError, match=message):
        analyse_steps(**arguments)


def test_one_sample_is_refused():
    with pytest.raises(ShapeError, match="at least 2 samples"):
        analyse_steps([0.0], np.zeros((1, 6)), np.zeros((1, 6)), RATED)


def test_rise_time_refuses_nan():
    with pytest.raises(ShapeError, match="value: expected finite"):
        rise_time(TIME, with_nan(TIME), 0.0, 1.0)
