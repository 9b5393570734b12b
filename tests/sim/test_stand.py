# SPDX-License-Identifier: Apache-2.0
"""A platform on a stand: what lifts it, what tips it, where it lands, and a net."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_sim.plant.free_platform import RigidBody
from cabols_sim.plant.stand import DAMPING, Stand, StandingPlatform

MASS, CENTRE = 4.0, np.array([0.02, 0.0, -0.02])
WEIGHT = MASS * 9.80665


@pytest.fixture
def body():
    return RigidBody.checked(MASS, CENTRE, 0.03 * np.eye(3))


def standing(rig, body, **stand):
    return StandingPlatform(rig.geometry, body, DAMPING, Stand(**stand))


def lift(force, body=CENTRE):
    """(6,) a force up through the centre of mass."""
    return np.array([0.0, 0.0, force, body[1] * force, -body[0] * force, 0.0])


def test_more_than_its_weight_lifts_it(rig, body):
    target = standing(rig, body)
    for share in (0.0, 0.5, 0.99):
        assert not target.step(lift(share * WEIGHT), 1e-3)
    start = target.position.copy()
    for _ in range(100):
        assert target.step(lift(1.5 * WEIGHT), 1e-3)
    # Half of the weight is left: g t^2 / 4, less what the air takes.
    assert target.position[2] - start[2] == pytest.approx(0.25 * 9.80665 * 0.01, rel=0.05)
    assert not target.held


def test_sideways_it_holds_and_a_torque_tips_it(rig, body):
    """Over the stand's edge, 0.1 m from its middle; the centre of mass is 0.02 m beside it."""
    target = standing(rig, body, radius=0.1)
    aside = np.array([200.0, 0.0, 0.0, 0.0, 0.0, 50.0])
    assert not target.step(aside, 1e-3)
    about = np.zeros(6)
    about[4] = 0.99 * WEIGHT * (0.1 - CENTRE[0])
    assert not target.step(about, 1e-3)
    about[4] = 1.01 * WEIGHT * (0.1 - CENTRE[0])
    assert target.step(about, 1e-3)


def test_it_lands_where_it_stood(rig, body):
    target = standing(rig, body)
    start = target.position.copy()
    for _ in range(60):
        target.step(lift(1.2 * WEIGHT), 1e-3)
    assert target.position[2] > start[2] + 1e-3
    target.twist[:] = 0.0
    for _ in range(400):
        target.step(lift(0.9 * WEIGHT), 1e-3)
    assert target.held
    np.testing.assert_array_equal(target.position, start)
    np.testing.assert_array_equal(target.twist, np.zeros(6))


def test_beside_the_stand_it_falls_into_the_net(rig, body):
    target = standing(rig, body, net_depth=0.1)
    start = target.position.copy()
    target.release()
    target.position[0] += 0.05
    lowest = 0.0
    for _ in range(3000):
        target.step(np.zeros(6), 1e-3)
        lowest = max(lowest, start[2] - target.position[2])
    assert not target.held
    # It rests where the net bears its weight.
    assert start[2] - target.position[2] == pytest.approx(0.1 + WEIGHT / 2000.0, abs=2e-3)
    assert lowest < 0.2


def test_without_a_net_it_goes_on_falling(rig, body):
    target = standing(rig, body)
    start = target.position.copy()
    target.release()
    target.position[0] += 0.05
    for _ in range(1000):
        target.step(np.zeros(6), 1e-3)
    assert start[2] - target.position[2] > 2.0
