# SPDX-License-Identifier: Apache-2.0
"""What every card does, checked on the hardware's back end (over a fake of the vendor's API) and on
the simulated card alike."""

from __future__ import annotations

import types
from dataclasses import replace

import numpy as np
import pytest

import cabols_sim.plant.card
import fake_quanser
from cabols_hw.card.config import ENCODER_MODULUS
from cabols_hw.card.quanser import QuanserQ8
from cabols_sim.plant.card import SimulatedQ8
from cabols_sim.plant.plant import Plant

N = 8
MS = 1_000_000
ADC_STEP, DAC_STEP = 20.0 / 2**14, 20.0 / 2**12
WATCHDOG_S = 0.010


class Hardware:
    """QuanserQ8 on a fake board."""

    def __init__(self, card):
        self.board = fake_quanser.Board()
        self.daq = QuanserQ8(fake_quanser.make_api(self.board), "0", card, self.board.clock_ns)
        self.daq.start(WATCHDOG_S)

    def see_counts(self, counts):
        self.board.counts[:] = counts

    def see_volts(self, volts):
        self.board.gauges[:6] = volts

    def see_lines(self, high):
        self.board.lines[:N] = high

    def outputs(self):
        self.board.elapse(0)
        return self.board.volts

    def amplifiers(self):
        return bool(self.board.enabled)

    def pause(self, duration_ns):
        self.board.elapse(duration_ns)


class Simulated:
    """SimulatedQ8, in lockstep or on a wall clock that the test moves."""

    def __init__(self, rig, card, config, lockstep):
        sensors = replace(config.sensors, gauge_noise=0.0, tool_weight=0.0)
        self.card = card
        self.plant = Plant(rig, card, replace(config, sensors=sensors))
        self.daq = SimulatedQ8(self.plant, card, N, lockstep=lockstep)
        self.now_ns = 5_000_000_000
        self.daq.start(WATCHDOG_S)

    def see_counts(self, counts):
        self.plant._state["motor_position"] = (
            np.asarray(counts) + 0.5
        ) / self.card.counts_per_metre
        # Slack, at rest, no current: nothing moves the motors.
        self.plant._rest[:] = self.plant._state["motor_position"] + 100.0

    def see_volts(self, volts):
        self.plant._bias[:] = volts

    def see_lines(self, high):
        # 5 mm of stretch are about 11 N: the switch is closed and pulls its line low.
        self.plant._rest[:] = self.plant._length + np.where(high, 1.0, -0.005)

    def outputs(self):
        return self.plant.current / self.card.amperes_per_volt

    def amplifiers(self):
        return self.plant.enabled

    def pause(self, duration_ns):
        self.now_ns += duration_ns


class SimulatedInRealTime(Simulated):
    """On a wall clock that stands still unless someone sleeps or pauses."""

    def __init__(self, rig, card, config, monkeypatch):
        self.now_ns = 5_000_000_000

        def sleep(duration_s):
            self.now_ns += round(1e9 * duration_s)

        clock = types.SimpleNamespace(
            monotonic_ns=lambda: self.now_ns, time_ns=lambda: self.now_ns, sleep=sleep
        )
        monkeypatch.setattr(cabols_sim.plant.card, "time", clock)
        super().__init__(rig, card, config, lockstep=False)


@pytest.fixture(params=["hardware", "lockstep", "real_time"])
def bench(request, rig, card, plant_config, monkeypatch):
    if request.param == "hardware":
        return Hardware(card)
    if request.param == "lockstep":
        return Simulated(rig, card, plant_config, lockstep=True)
    return SimulatedInRealTime(rig, card, plant_config, monkeypatch)


@pytest.fixture(params=["hardware", "real_time"])
def clocked(request, rig, card, plant_config, monkeypatch):
    """Cards on a clock that does not wait."""
    if request.param == "hardware":
        return Hardware(card)
    return SimulatedInRealTime(rig, card, plant_config, monkeypatch)


def test_shapes_and_types(bench):
    sample = bench.daq.read()
    assert (sample.encoders.shape, sample.encoders.dtype) == ((N,), np.int64)
    assert (sample.analog.shape, sample.analog.dtype) == ((6,), np.float64)
    assert (sample.digital.shape, sample.digital.dtype) == ((N,), np.bool_)


def test_samples_are_a_period_apart_and_their_own(bench):
    samples = [bench.daq.read() for _ in range(5)]
    np.testing.assert_array_equal(np.diff([sample.time_ns for sample in samples]), MS)
    assert samples[0].analog is not samples[1].analog
    assert not np.shares_memory(samples[0].encoders, samples[1].encoders)
    assert bench.daq.late == 0


@pytest.mark.parametrize(
    ("counts", "raw"),
    [
        (0, 0),
        (-1, -1),
        (ENCODER_MODULUS // 2 - 1, ENCODER_MODULUS // 2 - 1),
        (ENCODER_MODULUS // 2, -ENCODER_MODULUS // 2),
        (-ENCODER_MODULUS // 2 - 3, ENCODER_MODULUS // 2 - 3),
        (ENCODER_MODULUS + 7, 7),
    ],
)
def test_counters_wrap_at_24_bits(bench, counts, raw):
    bench.see_counts(np.full(N, counts))
    np.testing.assert_array_equal(bench.daq.read().encoders, raw)


def test_lines(bench):
    high = np.arange(N) % 2 == 0
    bench.see_lines(high)
    np.testing.assert_array_equal(bench.daq.read().digital, high)


def test_inputs_have_14_bits(bench):
    volts = np.array([0.0, 0.4, 0.6, -0.6, 1.0, 100.4]) * ADC_STEP
    bench.see_volts(volts)
    expected = np.array([0, 0, 1, -1, 1, 100]) * ADC_STEP
    np.testing.assert_allclose(bench.daq.read().analog, expected, atol=1e-12)


@pytest.mark.parametrize("volts", [10.0, 10.5, 1e6])
def test_inputs_clip(bench, volts):
    bench.see_volts(np.full(6, volts))
    np.testing.assert_allclose(bench.daq.read().analog, 10.0 - ADC_STEP, atol=1e-12)
    bench.see_volts(np.full(6, -volts))
    np.testing.assert_allclose(bench.daq.read().analog, -10.0, atol=1e-12)


def test_outputs_have_12_bits(bench):
    bench.daq.read()
    bench.daq.write(np.array([0.0, 0.4, 0.6, -0.6, 1.0, 100.4, -100.4, 1900.0]) * DAC_STEP)
    expected = np.array([0, 0, 1, -1, 1, 100, -100, 1900]) * DAC_STEP
    np.testing.assert_allclose(bench.outputs(), expected, atol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_outputs_clip(bench, sign):
    bench.daq.read()
    bench.daq.write(np.full(N, sign * 50.0))
    assert (np.abs(bench.outputs()) <= 10.0).all()
    assert (sign * bench.outputs() > 9.5).all()


def test_output_limit_of_the_wiring(rig, card, plant_config):
    narrow = replace(card, output_limit=5.0)
    for bench in (Hardware(narrow), Simulated(rig, narrow, plant_config, lockstep=True)):
        bench.daq.read()
        bench.daq.write(np.full(N, 50.0))
        np.testing.assert_allclose(bench.outputs(), 5.0, atol=DAC_STEP)


def test_what_is_not_finite_is_zero(bench):
    bench.daq.read()
    bench.daq.write(np.array([1.0, np.nan, 1.0, np.inf, -np.inf, 1.0, 1.0, 1.0]))
    outputs = bench.outputs()
    np.testing.assert_array_equal(outputs[[1, 3, 4]], 0.0)
    assert (outputs[[0, 2]] > 0.9).all()


def test_written_volts_are_not_changed(bench):
    bench.daq.read()
    volts = np.array([np.nan, 50.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    kept = volts.copy()
    bench.daq.write(volts)
    np.testing.assert_array_equal(volts, kept)


def test_nothing_expires_before_the_first_write(bench):
    for _ in range(50):
        bench.daq.read()
    assert not bench.daq.watchdog_expired


def test_writing_keeps_the_watchdog(bench):
    for _ in range(50):
        bench.daq.read()
        bench.daq.write(np.full(N, 1.0))
    assert not bench.daq.watchdog_expired
    assert (bench.outputs() > 0.9).all()


def test_expiry_zeroes_the_outputs_and_blocks_writing(bench):
    bench.daq.read()
    bench.daq.write(np.full(N, 1.0))
    for _ in range(9):
        bench.daq.read()
    assert not bench.daq.watchdog_expired
    assert (bench.outputs() > 0.9).all()
    for _ in range(3):
        bench.daq.read()
    assert bench.daq.watchdog_expired
    np.testing.assert_array_equal(bench.outputs(), 0.0)
    bench.daq.write(np.full(N, 1.0))
    np.testing.assert_array_equal(bench.outputs(), 0.0)
    assert bench.daq.watchdog_expired, "latched"


def test_clearing_allows_writing_again_from_zero(bench):
    bench.daq.read()
    bench.daq.write(np.full(N, 1.0))
    for _ in range(12):
        bench.daq.read()
    bench.daq.clear_watchdog()
    assert not bench.daq.watchdog_expired
    np.testing.assert_array_equal(bench.outputs(), 0.0)
    for _ in range(20):
        bench.daq.read()
    assert not bench.daq.watchdog_expired, "nothing written since"
    bench.daq.write(np.full(N, 0.5))
    assert (bench.outputs() > 0.45).all()
    for _ in range(12):
        bench.daq.read()
    assert bench.daq.watchdog_expired, "it expires again"


def test_a_write_that_comes_after_the_expiry_is_too_late(clocked):
    """The simulated card let such a write through and zeroed nothing."""
    clocked.daq.read()
    clocked.daq.write(np.full(N, 1.0))
    clocked.pause(15 * MS)
    clocked.daq.write(np.full(N, 1.0))
    assert clocked.daq.watchdog_expired
    np.testing.assert_array_equal(clocked.outputs(), 0.0)


def test_reading_a_little_late_is_counted(clocked):
    clocked.daq.read()
    clocked.pause(MS + 6 * MS // 10)
    clocked.daq.read()
    assert clocked.daq.late == 1
    clocked.daq.read()
    assert clocked.daq.late == 1


def test_a_simulated_sample_is_of_its_own_instant(rig, card, plant_config, monkeypatch):
    """As on the hardware its clock takes it, not its reader, who may come after the next write."""
    bench = SimulatedInRealTime(rig, card, plant_config, monkeypatch)
    bench.daq.read()
    bench.see_counts(np.full(N, 100))
    bench.pause(MS + MS // 5)
    bench.daq.write(np.zeros(N))
    bench.see_counts(np.full(N, 200))
    np.testing.assert_array_equal(bench.daq.read().encoders, 100)
    np.testing.assert_array_equal(bench.daq.read().encoders, 200)


def test_who_reads_far_too_late_finds_the_newest_samples(rig, card, plant_config, monkeypatch):
    bench = SimulatedInRealTime(rig, card, plant_config, monkeypatch)
    first = bench.daq.read()
    bench.pause(500 * MS + MS // 4)
    bench.daq.write(np.zeros(N))
    second = bench.daq.read()
    assert second.time_ns - first.time_ns == 500 * MS
    assert bench.daq.read().time_ns - second.time_ns == MS


def test_reader_that_fell_behind_skips_to_the_newest(clocked):
    first = clocked.daq.read()
    clocked.pause(20 * MS + MS // 4)
    second = clocked.daq.read()
    assert second.time_ns - first.time_ns == 20 * MS
    assert 19 <= clocked.daq.late <= 20
    late = clocked.daq.late
    third = clocked.daq.read()
    assert third.time_ns - second.time_ns == MS
    assert clocked.daq.late == late


def test_amplifiers_go_off_and_stay_off_until_they_are_enabled(bench):
    bench.daq.read()
    bench.daq.write(np.full(N, 1.0))
    assert bench.amplifiers()
    bench.daq.enable(False)
    assert not bench.amplifiers()
    for _ in range(12):
        bench.daq.read()
    bench.daq.clear_watchdog()
    bench.daq.write(np.full(N, 1.0))
    assert not bench.amplifiers()
    bench.daq.enable(True)
    bench.daq.read()
    bench.daq.write(np.full(N, 1.0))
    assert bench.amplifiers()


def test_close_zeroes_the_outputs_for_good(bench):
    bench.daq.read()
    bench.daq.write(np.full(N, 1.0))
    bench.daq.close()
    np.testing.assert_array_equal(bench.outputs(), 0.0)
    bench.daq.write(np.full(N, 1.0))
    np.testing.assert_array_equal(bench.outputs(), 0.0)
    bench.daq.close()


def test_clearing_after_close_changes_nothing(bench):
    bench.daq.read()
    bench.daq.write(np.full(N, 1.0))
    for _ in range(12):
        bench.daq.read()
    bench.daq.close()
    bench.daq.clear_watchdog()
    bench.daq.write(np.full(N, 1.0))
    np.testing.assert_array_equal(bench.outputs(), 0.0)
