# SPDX-License-Identifier: Apache-2.0
"""A pull that only the sensor feels, and all that is none: slips, blows, noise, a platform."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.kinematics import structure_matrix
from cabols_control.rig import load_rig
from cabols_hw.safety.unseen import FORCE_N, HALVES, UnseenPull

RIG = load_rig()
CABLES = RIG.geometry.cables
MATRIX = structure_matrix(
    RIG.geometry, RIG.geometry.reference_position, RIG.geometry.reference_rotation
)
COUNT_M = 2e-5
TIMES = np.arange(0.0, 0.2, 0.001)
BEGINS_S = 0.05
SENSES = np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])
"""Noise of each axis beside that of a force."""


def found(force, wound=None, tension=None, noise=0.03):
    """Samples [ms] after BEGINS_S, and limbs, in which it is found.

    force: (k, 6) that the sensor feels beyond the tensions.
    """
    random = np.random.default_rng(1)
    watch, hits = UnseenPull(CABLES), []
    tensions = np.full(CABLES, 30.0)
    for k in range(TIMES.size):
        pulls = tensions if tension is None else tension[k]
        wrench = MATRIX @ tensions + force[k] + noise * SENSES * random.normal(size=6)
        length = np.zeros(CABLES) if wound is None else wound[k]
        limb = watch.note(wrench, pulls, MATRIX, np.eye(3), length, COUNT_M)
        if limb >= 0:
            hits.append((round(1e3 * (TIMES[k] - BEGINS_S)), limb))
    return hits


def ramp(power, scale):
    return scale * np.maximum(TIMES - BEGINS_S, 0.0) ** power


@pytest.mark.parametrize("limb", range(CABLES))
@pytest.mark.parametrize("newtons_in_20_ms", [3.0, 10.0, 50.0])
def test_a_motor_that_speeds_up_is_found_by_the_force_that_it_makes(limb, newtons_in_20_ms):
    pull = ramp(2, newtons_in_20_ms / 0.02**2)
    after_ms, which = found(np.outer(pull, MATRIX[:, limb]))[0]
    assert which == limb
    # At 1.5 N; a window must be full, and a millisecond or two for the noise.
    needed_ms = 1e3 * 0.02 * np.sqrt(FORCE_N / newtons_in_20_ms)
    assert 2 * HALVES[0] - 4 <= after_ms <= max(needed_ms, 2 * HALVES[0]) + 2.0


def test_a_limb_whose_count_moves_is_none():
    pull = ramp(2, 1e4)
    wound = np.zeros((TIMES.size, CABLES))
    wound[:, 2] = pull / 2200.0
    assert not found(np.outer(pull, MATRIX[:, 2]), wound)


@pytest.mark.parametrize("newtons", [2.0, 5.0, 40.0])
def test_a_cable_that_slips_on_its_pulley_is_none(newtons):
    step = np.where(TIMES > BEGINS_S, newtons, 0.0)
    assert not found(np.outer(step, MATRIX[:, 5]))


def test_a_cable_that_goes_slack_is_none():
    assert not found(-np.outer(ramp(2, 1e4), MATRIX[:, 5]))


def test_a_push_is_none_unless_it_goes_along_a_cable():
    """Of forces and torques in all directions, seen at the cables' mean arm, one in fifty."""
    random = np.random.default_rng(2)
    arm = np.linalg.norm(MATRIX[3:]) / np.linalg.norm(MATRIX[:3])
    alarms = 0
    for _ in range(200):
        way = random.normal(size=6)
        way[3:] *= arm
        alarms += bool(found(np.outer(ramp(1, 500.0), way)))
    assert alarms <= 4


def test_a_bias_of_the_sensor_and_a_model_that_is_off_are_none():
    """All tensions change, the estimates by 5 % too little: the limbs that do it move."""
    change = np.outer(np.sin(20.0 * TIMES), np.linspace(-20.0, 20.0, CABLES))
    tension = 30.0 + 0.95 * change
    wound = change / 2200.0
    felt = change @ MATRIX.T + np.array([5.0, -3.0, 20.0, 0.3, 0.2, -0.5])
    assert not found(felt, wound, tension)


def test_a_sensor_that_tells_nothing_is_none():
    force = np.zeros((TIMES.size, 6))
    force[60:] = np.nan
    assert not found(force)
