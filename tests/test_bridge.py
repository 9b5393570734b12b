"""The bridge and its watchdogs on the simulated card, without ROS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cabols_control.modes import OperatingMode
from cabols_hw.bridge import Bridge
from cabols_hw.card_config import ENCODER_MODULUS
from cabols_hw.daq import CardSample
from cabols_hw.watchdog import CommandWatchdog
from cabols_sim.card import SimulatedQ8
from cabols_sim.plant import Plant

STOPPED, PRETIGHTENING = OperatingMode.STOPPED, OperatingMode.PRETIGHTENING
N = 8


def sample(encoders=0, analog=0.0, high=True):
    return CardSample(
        0,
        np.broadcast_to(np.asarray(encoders, dtype=np.int64), (N,)).copy(),
        np.broadcast_to(np.asarray(analog, dtype=float), (6,)).copy(),
        np.broadcast_to(np.asarray(high), (N,)).copy(),
    )


@pytest.fixture
def bridge(rig, card):
    return Bridge(rig, card)


def test_wound_length_survives_the_counters_wrap(bridge, card):
    start = ENCODER_MODULUS // 2 - 10
    bridge.take(sample(start), STOPPED)
    wrapped = (start + 25 + ENCODER_MODULUS // 2) % ENCODER_MODULUS - ENCODER_MODULUS // 2
    bridge.take(sample(wrapped), STOPPED)
    np.testing.assert_allclose(bridge.wound_length, 25 / card.counts_per_metre)
    bridge.take(sample(start), STOPPED)
    np.testing.assert_allclose(bridge.wound_length, 0.0)


def test_zero_is_set_where_the_switch_closes(bridge, rig, card):
    bridge.take(sample(0), PRETIGHTENING)
    assert np.isnan(bridge.tension).all()
    counts = int(0.005 * card.counts_per_metre)
    bridge.take(sample(counts, high=False), PRETIGHTENING)
    assert bridge.zeroed.all()
    np.testing.assert_allclose(bridge.tension, rig.limbs.switch_tension)
    bridge.take(sample(counts + 1000, high=False), OperatingMode.LOADING)
    more = rig.limbs.stiffness * 1000 / card.counts_per_metre
    np.testing.assert_allclose(bridge.tension, rig.limbs.switch_tension + more)


def test_switch_that_was_closed_before_sets_no_zero(bridge):
    bridge.take(sample(0, high=False), PRETIGHTENING)
    bridge.take(sample(0, high=False), PRETIGHTENING)
    assert not bridge.zeroed.any()


def test_switch_outside_pretightening_sets_no_zero(bridge):
    bridge.take(sample(0), STOPPED)
    bridge.take(sample(0, high=False), STOPPED)
    assert not bridge.zeroed.any()


def test_platform_that_moves_away_stretches_the_cable(bridge, rig, card):
    bridge.take(sample(0), PRETIGHTENING)
    bridge.take(sample(100, high=False), PRETIGHTENING)
    geometry = rig.geometry
    moved = geometry.reference_position - [0.0, 0.0, 0.001]
    bridge.set_pose(moved, geometry.reference_rotation)
    bridge.take(sample(100, high=False), OperatingMode.LOADING)
    # Down: the upper cables get longer, the lower ones shorter.
    assert (bridge.tension[:4] > rig.limbs.switch_tension + 1.0).all()
    assert (bridge.tension[4:] < rig.limbs.switch_tension - 1.0).all()


def test_tare_removes_the_bias(bridge, card, random):
    bias = random.uniform(-1, 1, 6)
    for _ in range(card.tare_samples):
        bridge.take(sample(analog=bias), STOPPED)
    assert bridge.tared
    np.testing.assert_allclose(bridge.wrench, 0.0, atol=1e-9)
    bridge.take(sample(analog=bias + 0.1), STOPPED)
    np.testing.assert_allclose(bridge.wrench, card.ft_matrix @ np.full(6, 0.1))


@pytest.mark.parametrize("volts", [9.99, -10.0, np.nan, np.inf])
def test_saturated_gauge_is_reported(bridge, volts):
    analog = np.zeros(6)
    analog[4] = volts
    bridge.take(sample(analog=analog), STOPPED)
    assert bridge.saturated_gauge
    bridge.take(sample(), STOPPED)
    assert not bridge.saturated_gauge


def test_currents_are_limited_and_nan_is_zero(rig, card):
    bridge = Bridge(rig, replace(card, current_rate_limit=0.0))
    volts = bridge.volts(np.array([np.nan, np.inf, 99.0, -99.0, 1.0, 0.0, 2.9, 3.1]))
    limit = rig.control.current_limit
    expected = np.array([0.0, 0.0, limit, -limit, 1.0, 0.0, 2.9, limit]) / card.amperes_per_volt
    np.testing.assert_allclose(volts, expected)
    np.testing.assert_allclose(bridge.current, expected * card.amperes_per_volt)


def test_command_watchdog():
    watchdog = CommandWatchdog(3, 0.010)
    assert watchdog.check(100.0, at_rest=False), "unarmed before the first command"
    watchdog.feed(100.0, np.array([0, 1]))
    assert watchdog.check(100.009, at_rest=False)
    watchdog.feed(100.009, np.array([0]))
    assert not watchdog.check(100.011, at_rest=False)
    assert "limbs [1]" in watchdog.fault
    watchdog.feed(100.011, np.array([0, 1]))
    assert not watchdog.check(100.012, at_rest=False), "latched"
    assert watchdog.check(100.013, at_rest=True)
    watchdog.feed(100.013, np.array([0, 1]))
    assert watchdog.check(100.014, at_rest=False)


@pytest.fixture
def lockstep_card(rig, card, plant_config):
    daq = SimulatedQ8(Plant(rig, card, plant_config), card, N, lockstep=True)
    daq.start(0.010)
    return daq


def test_card_steps_one_period(lockstep_card):
    times = [lockstep_card.read().time_ns for _ in range(5)]
    assert times == [1_000_000 * k for k in range(1, 6)]


def test_cards_own_watchdog_zeroes_outputs_until_cleared(lockstep_card):
    lockstep_card.write(np.ones(N))
    for _ in range(10):
        lockstep_card.read()
    assert not lockstep_card.watchdog_expired
    assert lockstep_card.plant.current.max() > 0.3
    lockstep_card.read()
    assert lockstep_card.watchdog_expired
    np.testing.assert_array_equal(lockstep_card.plant.current, 0.0)
    lockstep_card.write(np.ones(N))
    np.testing.assert_array_equal(lockstep_card.plant.current, 0.0)
    lockstep_card.clear_watchdog()
    lockstep_card.write(np.ones(N))
    assert lockstep_card.plant.current.max() > 0.3


def test_close_leaves_zero(lockstep_card):
    lockstep_card.write(np.ones(N))
    lockstep_card.close()
    np.testing.assert_array_equal(lockstep_card.plant.current, 0.0)


def test_real_time_card_keeps_its_own_instants(rig, card, plant_config):
    daq = SimulatedQ8(Plant(rig, card, plant_config), card, N, lockstep=False)
    daq.start(0.010)
    stamps = np.array([daq.read().time_ns for _ in range(50)])
    # Late or not, an instant is a whole number of periods after the first.
    assert (np.diff(stamps) >= 1_000_000).all()
    np.testing.assert_array_equal((stamps - stamps[0]) % 1_000_000, 0)
