# SPDX-License-Identifier: Apache-2.0
"""Gains: the loops that they close have the poles that were asked for, by python-control."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cabols_control.errors import OutOfRangeError, ShapeError
from cabols_control.gains import limb_gains, wrench_gains
from cabols_control.limb import LimbModel

MODEL = LimbModel(gain=0.853, time_constant=0.3564)
K_E = 2200.0
positive_pole = st.floats(2.0, 150.0)


def closed_limb(model, stiffness, gains):
    """(3.13) built from its parts: the motor (3.11), the integral of (3.10), tau = k_e dl.

    By states, as nothing must be cancelled there: minreal takes nearly multiple poles away.
    """
    motor = [-1.0 / model.time_constant, 0.0, model.gain / model.time_constant]
    # i = -k_P1 d(dl)/dt + k_I integral of (k_P2 (tau_d - k_e dl) - d(dl)/dt)
    speed = [motor[0] - motor[2] * gains.velocity, 0.0, motor[2] * gains.integral]
    error = [-1.0, -gains.tension * stiffness, 0.0]
    return control.ss(
        [speed, [1.0, 0.0, 0.0], error],
        [[0.0], [0.0], [gains.tension]],
        [[0.0, stiffness, 0.0]],
        0.0,
    )


@settings(max_examples=40)
@given(
    poles=st.tuples(positive_pole, positive_pole, positive_pole),
    gain=st.floats(0.1, 5.0),
    time_constant=st.floats(0.05, 2.0),
    stiffness=st.floats(500.0, 20000.0),
)
def test_limb_has_the_requested_poles(poles, gain, time_constant, stiffness):
    model = LimbModel(gain, time_constant)
    gains = limb_gains(model, stiffness, -np.array(poles))
    loop = closed_limb(model, stiffness, gains)
    found = np.poly(loop.poles())
    # Coefficients, not roots: roots of a triple pole move by the cube root of rounding.
    np.testing.assert_allclose(found, np.poly(-np.array(poles)), rtol=1e-6)
    assert loop.dcgain() == pytest.approx(1.0)


@settings(max_examples=40)
@given(poles=st.tuples(*[positive_pole] * 4), zero=st.floats(20.0, 200.0), sign=st.booleans())
def test_wrench_loop_has_the_poles_and_the_zero(poles, zero, sign):
    coefficients = np.poly(-np.array(poles))
    if coefficients[3] * zero - coefficients[4] <= 0.05 * coefficients[4]:
        return
    gains = wrench_gains([MODEL], K_E, -np.array(poles), -zero if sign else zero)
    inner = closed_limb(MODEL, K_E, gains.limbs[0])
    # By frequency response: a zero on a pole would cancel in the list of poles.
    s = 1j * np.array([0.1, 1.0, 7.0, 30.0, 200.0])
    outer = inner(s) * (gains.proportional + gains.integral / s)
    expected = coefficients[4] / zero * (s + zero) / np.polyval(coefficients, s)
    np.testing.assert_allclose(outer / (1.0 + outer), expected, rtol=1e-6)
    assert -gains.integral / gains.proportional == pytest.approx(-zero)


def test_published_case():
    gains = wrench_gains([MODEL], K_E, [-10, -90, -40, -40], -40)
    assert gains.integral == pytest.approx(360 / 49)
    assert gains.proportional == pytest.approx(9 / 49)
    # (3.27): the inner loop's poles are exactly -40, -70, -70.
    inner = closed_limb(MODEL, K_E, gains.limbs[0])
    np.testing.assert_allclose(np.poly(inner.poles()), np.poly([-40, -70, -70]), rtol=1e-9)


def test_complex_pair_is_allowed():
    gains = limb_gains(MODEL, K_E, [-10 + 5j, -10 - 5j, -20])
    loop = closed_limb(MODEL, K_E, gains)
    np.testing.assert_allclose(np.poly(loop.poles()), np.poly([-10 + 5j, -10 - 5j, -20]).real)


@pytest.mark.parametrize(
    ("poles", "message"),
    [
        ([-1, -2], "expected 3 finite"),
        ([-1, -2, np.nan], "expected 3 finite"),
        ([-1, -2, 3], "negative real parts"),
        ([-1, -2 + 1j, -3], "conjugate"),
    ],
)
def test_bad_poles(poles, message):
    with pytest.raises(ShapeError, match=message):
        limb_gains(MODEL, K_E, poles)


@pytest.mark.parametrize("stiffness", [0.0, -1.0, np.nan, np.inf])
def test_bad_stiffness(stiffness):
    with pytest.raises(OutOfRangeError, match="stiffness"):
        limb_gains(MODEL, stiffness, [-1, -2, -3])


@pytest.mark.parametrize("zero", [0.0, 1.0, np.nan])
def test_bad_zero(zero):
    with pytest.raises(OutOfRangeError, match="zero"):
        wrench_gains([MODEL], K_E, [-10, -90, -40, -40], zero)


def test_no_limb():
    with pytest.raises(ShapeError, match="at least one limb"):
        wrench_gains([], K_E, [-10, -90, -40, -40], 40)
