# SPDX-License-Identifier: Apache-2.0
"""Limb identification: exact data, noise, irregular time, bad data."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cabols_control.errors import ShapeError
from cabols_control.limb import (
    LimbModel,
    identify_limb,
    identify_stiffness,
    step_response,
)

TIME = np.arange(2000) * 0.001
STEP = np.where(TIME >= 0.1, 0.5, 0.0)


def test_response_is_python_controls():
    s = control.tf("s")
    motor = 0.853 / (s * (1 + 0.3564 * s))
    discrete = control.sample_system(motor, 0.001, "zoh")
    expected = control.forced_response(discrete, TIME, STEP).outputs
    found = step_response(LimbModel(0.853, 0.3564), TIME, STEP)
    np.testing.assert_allclose(found, expected, atol=1e-9)


@settings(max_examples=30)
@given(gain=st.floats(0.05, 10.0), time_constant=st.floats(0.01, 1.5), offset=st.floats(-1, 1))
def test_exact_data_gives_the_model_back(gain, time_constant, offset):
    wound = step_response(LimbModel(gain, time_constant), TIME, STEP) + offset
    found = identify_limb(TIME, STEP, wound)
    assert found.gain == pytest.approx(gain, rel=1e-5)
    assert found.time_constant == pytest.approx(time_constant, rel=1e-5)
    assert found.fit > 0.9999


def test_irregular_time(random):
    time = np.sort(random.uniform(0.0, 2.0, 1500))
    step = np.where(time >= 0.1, 0.5, 0.0)
    wound = step_response(LimbModel(1.7, 0.45), time, step)
    found = identify_limb(time, step, wound)
    assert found.gain == pytest.approx(1.7, rel=1e-5)
    assert found.time_constant == pytest.approx(0.45, rel=1e-5)


def test_noise_costs_fit_but_not_much_accuracy(random):
    clean = step_response(LimbModel(0.853, 0.3564), TIME, STEP)
    found = identify_limb(TIME, STEP, clean + random.normal(0.0, 0.02 * np.ptp(clean), TIME.size))
    assert found.gain == pytest.approx(0.853, rel=0.01)
    assert 0.9 < found.fit < 0.97


@pytest.mark.parametrize(
    ("time", "current", "wound", "message"),
    [
        (TIME[:5], STEP[:5], STEP[:5], "at least 20 samples"),
        (TIME, STEP[:-1], STEP, r"current: expected shape \(2000\)"),
        (TIME, STEP, np.append(STEP[:-1], np.nan), "wound_length: expected finite"),
        (TIME[::-1], STEP, STEP, "strictly increasing"),
        (TIME, 0.0 * STEP, STEP, "current: expected a step"),
        (TIME, STEP, 0.0 * STEP, "wound_length: expected motion"),
        (TIME, STEP, TIME.reshape(-1, 1), "wound_length: expected shape"),
    ],
)
def test_bad_data(time, current, wound, message):
    with pytest.raises(ShapeError, match=message):
        identify_limb(time, current, wound)


def test_stiffness_with_hysteresis():
    up = np.linspace(0.0, 0.06, 500)
    elongation = np.concatenate([up, up[::-1]])
    tension = 2200.0 * elongation + 3.0 + np.repeat([1.0, -1.0], 500)
    found = identify_stiffness(tension, elongation)
    assert found.stiffness == pytest.approx(2200.0, rel=5e-3)
    assert found.hysteresis == pytest.approx(2.0, rel=0.05)


def test_stiffness_without_samples_in_range():
    with pytest.raises(ShapeError, match="between 5 and 150 N, got 0"):
        identify_stiffness(np.ones(100), np.linspace(0, 1, 100))
