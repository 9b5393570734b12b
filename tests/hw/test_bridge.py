# SPDX-License-Identifier: Apache-2.0
"""The bridge and its watchdogs on the simulated card, without ROS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.rig import MOTOR_CURRENT_MAX_A, load_rig
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.bridge.scaling import CLOSINGS
from cabols_hw.bridge.watchdog import CommandWatchdog
from cabols_hw.card.config import ENCODER_MODULUS, load_card
from cabols_hw.card.daq import CardSample
from cabols_hw.force_torque.ati import AXES
from cabols_sim.plant.card import SimulatedQ8
from cabols_sim.plant.config import load_plant
from cabols_sim.plant.plant import Plant
from cabols_sim.plant.target import RigidTarget
from one_process import OneProcess

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
    return Bridge(rig, card, CLOSINGS)


def test_wound_length_survives_the_counters_wrap(bridge, card):
    start = ENCODER_MODULUS // 2 - 10
    bridge.take(sample(start), STOPPED)
    wrapped = (start + 25 + ENCODER_MODULUS // 2) % ENCODER_MODULUS - ENCODER_MODULUS // 2
    bridge.take(sample(wrapped), STOPPED)
    np.testing.assert_allclose(bridge.wound_length, 25 / card.counts_per_metre)
    bridge.take(sample(start), STOPPED)
    np.testing.assert_allclose(bridge.wound_length, 0.0)


def close(bridge, counts, zeroing=0):
    """Close all switches at these counts, as often as it takes to set a zero."""
    for closing in range(CLOSINGS):
        assert not bridge.zeroed.any(), closing
        bridge.take(sample(0), PRETIGHTENING, zeroing)
        bridge.take(sample(counts, high=False), PRETIGHTENING, zeroing)
    assert bridge.zeroed.all()


def test_zero_is_set_where_the_switch_closes(bridge, rig, card):
    bridge.take(sample(0), PRETIGHTENING)
    assert np.isnan(bridge.tension).all()
    counts = int(0.005 * card.counts_per_metre)
    close(bridge, counts)
    assert bridge.zeroed.all()
    np.testing.assert_allclose(bridge.tension, rig.limbs.switch_tension)
    bridge.take(sample(counts + 1000, high=False), OperatingMode.LOADING)
    more = rig.limbs.stiffness * 1000 / card.counts_per_metre
    np.testing.assert_allclose(bridge.tension, rig.limbs.switch_tension + more)


def zero(bridge, card, zeroing):
    """Set all zeros in a pre-tightening of this number."""
    bridge.take(sample(0), PRETIGHTENING, zeroing)
    assert not bridge.zeroed.any()
    close(bridge, int(0.005 * card.counts_per_metre), zeroing)
    assert bridge.zeroed.all()
    assert bridge.zeroing[0] == zeroing


def test_a_sample_says_of_which_pretightening_its_zeros_are(bridge, card):
    bridge.take(sample(0), STOPPED, 6)
    assert (bridge.zeroing[0], bridge.followed_mode[0]) == (0, STOPPED), "no zero, of none"
    zero(bridge, card, 6)
    bridge.take(sample(0), OperatingMode.LOADING, 6)
    assert (bridge.zeroing[0], bridge.followed_mode[0]) == (6, OperatingMode.LOADING)
    # A number alone renews nothing: in that pre-tightening this bridge was never seen.
    bridge.take(sample(0), STOPPED, 7)
    assert bridge.zeroed.all()
    assert bridge.zeroing[0] == 6
    zero(bridge, card, 7)


def test_a_pretightening_that_begins_anew_unseen_forgets_the_zeros_too(bridge, card):
    zero(bridge, card, 1)
    # STOPPED in between was too short for the bridge to see it: the number tells.
    zero(bridge, card, 3)


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
    close(bridge, 100)
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


@pytest.mark.parametrize(("axis", "name"), list(enumerate(AXES)))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_load_beyond_the_sensors_range_names_the_axis(bridge, card, axis, name, sign):
    load = np.zeros(6)
    load[axis] = 0.99 * sign * card.sensor_limits[axis]
    for factor, expected in ((1.0, ""), (1.02, name)):
        # The range of an ATI Delta is beyond the converter's end on most axes of the bench.
        bridge.take(sample(analog=np.zeros(6)), STOPPED)
        bridge.tared = True
        bridge._bias[:] = -factor * np.linalg.solve(card.ft_matrix, load)
        bridge._tare_weight[:] = 0.0
        bridge.take(sample(), STOPPED)
        assert bridge.saturation.startswith(expected)
        assert bool(bridge.saturation) == bool(expected)
        assert not bridge.saturated_gauge


def test_saturated_gauge_is_named(bridge):
    analog = np.zeros(6)
    analog[4] = np.nan
    bridge.take(sample(analog=analog), STOPPED)
    assert "gauge 4" in bridge.saturation
    bridge.take(sample(), STOPPED)
    assert bridge.saturation == ""


def test_tools_weight_counts_for_the_sensors_range(rig, card):
    """The sensor carries the tool, whatever the tare says: 495 N of it are too much."""
    bridge = Bridge(rig, replace(card, tool_mass=51.0))
    for _ in range(card.tare_samples):
        bridge.take(sample(), STOPPED)
    np.testing.assert_allclose(bridge.wrench, 0.0, atol=1e-9)
    assert bridge.saturation.startswith("Fz is -500")


class TurningTarget:
    """Holds the platform where the test says."""

    def __init__(self, geometry):
        self.position = np.array(geometry.reference_position)
        self.rotation = np.array(geometry.reference_rotation)

    def step(self, wrench, dt_s):
        return False


POSE = {
    "sensor_position": [0.02, -0.01, -0.15],
    "sensor_rotation": Rotation.from_euler("xyz", [10, -20, 65], degrees=True).as_matrix().tolist(),
}


@pytest.mark.parametrize("pose", [{}, POSE])
def test_wrench_of_a_turning_platform_is_the_cables_alone(rig, card, plant_config, pose):
    """A tool of 20 N, 0.12 m off: turned by 30 degrees after the tare it would show as 10 N."""
    centre = [0.01, 0.02, 0.12]
    sensors = replace(
        plant_config.sensors, gauge_noise=0.0, adc_step=0.0, tool_centre_of_mass=centre
    )
    config = replace(plant_config, sensors=sensors)
    wired = replace(card, tool_centre_of_mass=centre, **pose)
    target = TurningTarget(rig.geometry)
    plant = Plant(rig, wired, config, seed=4, target=target)
    bridge = Bridge(rig, wired)
    for _ in range(card.tare_samples):
        bridge.take(CardSample(0, *plant.sense()), STOPPED)
    np.testing.assert_allclose(bridge.wrench, 0.0, atol=1e-9)
    for angles in ([30, 0, 0], [0, -30, 0], [15, 20, 50]):
        target.rotation = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        bridge.set_pose(target.position, target.rotation)
        plant.wrench[:] = [30.0, -20.0, 50.0, 1.0, 2.0, -3.0]
        bridge.take(CardSample(0, *plant.sense()), STOPPED)
        turn = target.rotation.T
        expected = np.concatenate([turn @ plant.wrench[:3], turn @ plant.wrench[3:]])
        # 2.03943 kg are 20 N to 1e-5 of it.
        np.testing.assert_allclose(bridge.wrench, expected, atol=3e-4)
        assert np.abs(bridge.load[:3]).max() > 25.0


def test_tare_of_a_moving_platform(rig, card, plant_config):
    """Whatever the orientations during the tare, the bias is the gauges' own."""
    sensors = replace(plant_config.sensors, gauge_noise=0.0, adc_step=0.0)
    target = TurningTarget(rig.geometry)
    plant = Plant(rig, card, replace(plant_config, sensors=sensors), seed=4, target=target)
    bridge = Bridge(rig, card)
    for k in range(card.tare_samples):
        target.rotation = Rotation.from_euler("x", 0.2 * k, degrees=True).as_matrix()
        bridge.set_pose(target.position, target.rotation)
        bridge.take(CardSample(0, *plant.sense()), STOPPED)
    assert bridge.tared
    np.testing.assert_allclose(bridge.wrench, 0.0, atol=3e-4)


def test_currents_are_limited_and_nan_is_zero(rig, card):
    bridge = Bridge(rig, replace(card, current_rate_limit=0.0))
    volts = bridge.volts(np.array([np.nan, np.inf, 99.0, -99.0, 1.0, 0.0, 2.9, 3.1]))
    limit = rig.control.current_limit
    expected = np.array([0.0, 0.0, limit, -limit, 1.0, 0.0, 2.9, limit]) / card.amperes_per_volt
    np.testing.assert_allclose(volts, expected)
    np.testing.assert_allclose(bridge.current, expected * card.amperes_per_volt)


@pytest.mark.parametrize("gain", [0.4, -0.4, 4.0])
def test_no_current_beyond_the_rigs_limit(rig, card, gain):
    """3 A of the bench; the most that a configuration may ask for is the motors' 3.82 A."""
    for limit in (rig.control.current_limit, MOTOR_CURRENT_MAX_A):
        allowed = replace(rig, control=replace(rig.control, current_limit=limit))
        bridge = Bridge(allowed, replace(card, current_rate_limit=0.0, amperes_per_volt=gain))
        for wanted in (1e9, -1e9, 3.8201, -3.8201):
            bridge.volts(np.full(N, wanted))
            np.testing.assert_allclose(bridge.current, np.clip(wanted, -limit, limit))
            assert (np.abs(bridge.current) <= MOTOR_CURRENT_MAX_A + 1e-12).all()


def test_current_grows_at_the_rate_limit_and_falls_at_once(rig, card):
    bridge = Bridge(rig, replace(card, current_rate_limit=600.0))

    def after(wanted, milliseconds=1):
        after.time_ns += milliseconds * 1_000_000
        bridge.take(replace(sample(), time_ns=after.time_ns), STOPPED)
        return bridge.volts(np.full(N, wanted))[0] * card.amperes_per_volt

    after.time_ns = 0
    after(0.0)
    assert [after(3.0) for _ in range(6)] == pytest.approx([0.6, 1.2, 1.8, 2.4, 3.0, 3.0])
    assert after(0.5) == pytest.approx(0.5), "a smaller current at once"
    assert after(0.0) == 0.0
    assert after(-3.0) == pytest.approx(-0.6), "the other way as slowly"
    assert after(-3.0) == pytest.approx(-1.2)
    assert after(3.0) == pytest.approx(0.6), "as far as zero at once, then slowly"
    assert after(3.0, milliseconds=3) == pytest.approx(2.4), "by the time that has passed"
    assert after(np.nan) == 0.0


def test_rate_limit_is_per_sample_not_per_call(rig, card):
    """Two limb controllers answer each sample, in two calls."""
    bridge = Bridge(rig, replace(card, current_rate_limit=600.0))
    for k in range(3):
        bridge.take(replace(sample(), time_ns=k * 1_000_000), STOPPED)
    for _ in range(5):
        bridge.volts(np.full(N, 3.0))
    np.testing.assert_allclose(bridge.current, 0.6)


def test_no_rate_limit(rig, card):
    bridge = Bridge(rig, replace(card, current_rate_limit=0.0))
    bridge.take(sample(), STOPPED)
    bridge.volts(np.full(N, 3.0))
    np.testing.assert_allclose(bridge.current, 3.0)


def test_command_watchdog():
    watchdog = CommandWatchdog(3, 0.010)
    assert watchdog.check(100.0, at_rest=False), "unarmed before the first command"
    watchdog.feed(100.0, np.array([0, 1]))
    assert watchdog.check(100.009, at_rest=False)
    watchdog.feed(100.009, np.array([0]))
    assert not watchdog.check(100.011, at_rest=False)
    assert "for limb 2 for" in watchdog.fault
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


class SwingingTarget(RigidTarget):
    """Moves and turns the platform to and fro, and says how fast."""

    def __init__(self, geometry):
        super().__init__(geometry)
        self._start, self._turn, self._time = self.position.copy(), self.rotation.copy(), 0.0
        self.twist = np.zeros(6)

    def step(self, wrench, dt_s):
        del wrench
        self._time += dt_s
        phase = 2.0 * np.pi * 2.0 * self._time
        before, turned = self.position.copy(), self.rotation.copy()
        self.position[:] = self._start + 0.01 * np.sin(phase) * np.array([1.0, 0.3, -0.5])
        vector = 0.02 * np.sin(phase + 0.4) * np.array([0.2, 1.0, 0.4])
        self.rotation[:] = Rotation.from_rotvec(vector).as_matrix() @ self._turn
        self.twist[:3] = (self.position - before) / dt_s
        self.twist[3:] = Rotation.from_matrix(self.rotation @ turned.T).as_rotvec() / dt_s
        return True


def test_what_hangs_on_the_sensor_may_be_shaken():
    """2 kg at 1.6 m/s^2 are 3 N that no cable pulls: the wrench is the cables' alone."""
    rig = load_rig()
    plant_config = load_plant()
    centre = [0.03, -0.02, 0.05]
    card = replace(load_card(), tool_centre_of_mass=centre)
    target = SwingingTarget(rig.geometry)
    bench = OneProcess(rig, card, plant_config, 3, target)
    bench.plant._sensors["centre"] = centre
    off, without = [], []
    for k in range(1500):
        bench.cycle()
        if k > 500:
            # Cables may pull as they like; the bias, which no tare has found, is constant.
            pull = (bench.plant.wrench.reshape(2, 3) @ target.rotation).ravel()
            off.append(bench.bridge.wrench - pull)
            without.append(off[-1] - bench.bridge._weight + bench.bridge._carried)
    (force, torque), (most, turned) = (
        (np.std(rows, axis=0)[:3].max(), np.std(rows, axis=0)[3:].max()) for rows in (off, without)
    )
    assert most > 1.5
    # The acceleration is some 14 ms old: of the last poses, and these of a while ago.
    assert force < 0.22 * most
    assert torque < 0.25 * turned
