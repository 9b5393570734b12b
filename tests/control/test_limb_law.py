# SPDX-License-Identifier: Apache-2.0
"""The limb law: linear behaviour against python-control, limits, resets, bad input."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cabols_control.errors import OutOfRangeError, ShapeError
from cabols_control.gains import limb_gains
from cabols_control.limb import LimbModel
from cabols_control.limb_control.law import LimbLaw

MODEL = LimbModel(0.853, 0.3564)
K_E = 2200.0
GAINS = limb_gains(MODEL, K_E, [-10, -10, -10])
DT = 0.001


def closed_loop(law, target, steps, dt=DT, limit_free=True):
    """Tension of (3.12) under the law; exact motor integration over each step."""
    gain, decay = MODEL.gain, np.exp(-dt / MODEL.time_constant)
    position, speed, tension, current = 0.0, 0.0, [], []
    for _ in range(steps):
        now = K_E * position
        reference = law.tension_gain * (target - now)
        i = float(law.step(reference, np.array([position]), dt)[0])
        difference = speed - gain * i
        position += gain * i * dt + difference * MODEL.time_constant * (1 - decay)
        speed = gain * i + difference * decay
        tension.append(now)
        current.append(i)
    return np.array(tension), np.array(current)


def test_step_response_is_the_designed_one():
    law = LimbLaw([GAINS], 100.0)
    tension, _ = closed_loop(law, 10.0, 1500)
    time = np.arange(1500) * DT
    expected = 10.0 * control.step_response(control.tf([1000], [1, 30, 300, 1000]), time).outputs
    # The sampled law is one backward difference behind the continuous one: 1 ms of 422 ms.
    np.testing.assert_allclose(tension, expected, atol=0.005 * 10.0)


@pytest.mark.parametrize("dt", [0.0005, 0.002])
def test_real_dt_is_used(dt):
    tension, _ = closed_loop(LimbLaw([GAINS], 100.0), 10.0, int(1.5 / dt), dt)
    time = np.arange(tension.size) * dt
    expected = 10.0 * control.step_response(control.tf([1000], [1, 30, 300, 1000]), time).outputs
    np.testing.assert_allclose(tension, expected, atol=0.01 * 10.0)


def test_limit_holds_and_does_not_wind_up():
    law = LimbLaw([GAINS], 0.3)
    tension, current = closed_loop(law, 400.0, 6000)
    assert np.abs(current).max() <= 0.3
    assert (np.abs(current) > 0.29).sum() > 300
    # Without anti-windup the overshoot would be tens of newtons.
    assert tension.max() < 400.0 * 1.02
    assert tension[-1] == pytest.approx(400.0, rel=1e-3)


def test_reset_is_bumpless():
    law = LimbLaw([GAINS], 3.0)
    law.reset(0, position=0.01, current=0.7)
    held = law.step(np.zeros(1), np.array([0.01]), DT)
    assert held[0] == pytest.approx(0.7)


@settings(max_examples=50)
@given(
    references=st.lists(st.floats(-1e3, 1e3), min_size=5, max_size=50),
    positions=st.lists(st.floats(-1.0, 1.0), min_size=50, max_size=50),
    limit=st.floats(0.1, 3.8),
)
def test_current_never_exceeds_the_limit(references, positions, limit):
    law = LimbLaw([GAINS], limit)
    for reference, position in zip(references, positions, strict=False):
        current = law.step(np.array([reference]), np.array([position]), DT)
        assert np.abs(current).max() <= limit
        assert np.isfinite(current).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_bad_numbers_leave_the_state(bad):
    law = LimbLaw([GAINS], 3.0)
    law.step(np.array([0.1]), np.array([0.0]), DT)
    before = law.current.copy()
    with pytest.raises(ShapeError, match="finite"):
        law.step(np.array([bad]), np.array([0.0]), DT)
    with pytest.raises(ShapeError, match="finite"):
        law.step(np.array([0.0]), np.array([bad]), DT)
    np.testing.assert_array_equal(law.current, before)
    twin = LimbLaw([GAINS], 3.0)
    twin.step(np.array([0.1]), np.array([0.0]), DT)
    np.testing.assert_array_equal(
        law.step(np.array([0.2]), np.array([0.001]), DT),
        twin.step(np.array([0.2]), np.array([0.001]), DT),
    )


@pytest.mark.parametrize("dt", [0.0, -0.001, np.nan, 5.0])
def test_bad_dt(dt):
    with pytest.raises(OutOfRangeError, match="dt_s"):
        LimbLaw([GAINS], 3.0).step(np.zeros(1), np.zeros(1), dt)


def test_wrong_length():
    with pytest.raises(ShapeError, match=r"position: expected shape \(1\), got \(8,\)"):
        LimbLaw([GAINS], 3.0).step(np.zeros(1), np.zeros(8), DT)


@pytest.mark.parametrize("target", [50.0, 100.0, 145.0])
@pytest.mark.parametrize("dt", [0.001, 0.004])
def test_a_large_step_is_followed_as_fast_as_the_current_allows(rig, target, dt):
    """A single sample's increment may ask for more than the limit: the motor must not stand."""
    gains = rig.gains.limbs[0]
    tension, current = closed_loop(LimbLaw([gains], 3.0), target, int(1.0 / dt), dt)
    assert current[0] == pytest.approx(min(3.0, gains.integral * gains.tension * target * dt))
    # Full current, then the designed approach to the target, without overshoot.
    assert np.argmax(tension > 0.9 * target) * dt < 0.2
    assert tension.max() < 1.01 * target
    assert tension[-1] == pytest.approx(target, rel=1e-3)
