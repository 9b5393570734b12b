# SPDX-License-Identifier: Apache-2.0
"""When the sensor's bias may change: slack cables, rest, a plausible change; and its file."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cabols_control.errors import ConfigError
from cabols_control.limb_control.controller import LimbController
from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.modes import OperatingMode as Mode
from cabols_control.wrench_control.controller import WrenchController
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.card.daq import CardSample
from cabols_hw.force_torque.sensor_bias import SensorBias, load_bias, save_bias
from cabols_hw.ros.bias_keeper import BiasKeeper
from cabols_hw.safety.config import load_safety
from cabols_hw.safety.guard import BridgeGuard
from rig_harness import RigInOneProcess

WRONG_N = 1.0


@pytest.fixture
def bench(rig, card, plant_config):
    return RigInOneProcess(rig, card, plant_config, seed=7)


def restart(bench, rig, card, bias=None):
    """The bridge and the controllers start anew; the gears hold what they hold."""
    bench.bridge = Bridge(rig, card)
    if bias is not None:
        bench.bridge.adopt_bias(bias)
    bench.guard = BridgeGuard(rig, load_safety(), card.watchdog)
    bench.controller, bench.wrenches = LimbController(rig), WrenchController(rig)
    bench.desired = np.zeros(6)
    bench.mode = Mode.STOPPED
    bench.run(0.5)


def wrong(bench):
    """Largest error of a force that counts as known [N]."""
    return float(np.abs(bench.bridge.wrench[:3] - bench.plant.wrench[:3]).max())


def hold(bench, wrench):
    """Leave a load on the gears."""
    bench.load(wrench)
    bench.mode = Mode.FAULT
    bench.run(0.3)


def test_start_with_slack_cables_is_proven_by_the_zeros(bench):
    bench.run(0.3)
    tare = bench.bridge.sensor_tare
    assert bench.bridge.tared
    assert tare.provisional, "open switches alone show no slackness"
    assert tare.proven is None
    bench.pretighten()
    assert not tare.provisional
    assert tare.proven is tare.bias
    assert wrong(bench) < WRONG_N


@pytest.mark.parametrize("held_n", [10.0, 25.0, 40.0, 100.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_restart_under_load_with_a_bias_on_the_disk(bench, rig, card, held_n, axis):
    hold(bench, held_n * np.eye(6)[axis])
    kept = bench.bridge.sensor_tare.proven
    restart(bench, rig, card, kept)
    assert bench.bridge.tared
    assert wrong(bench) < WRONG_N
    bench.mode = Mode.PRETIGHTENING
    bench.run(15.0, lambda: bool(bench.bridge.zeroed.all()))
    assert bench.bridge.tared
    assert wrong(bench) < WRONG_N


def test_load_below_the_switches_is_found_by_the_zeros(bench, rig, card):
    """Every switch is open, and the cables pull: 3 N on one side, 1 N on the other."""
    bench.run(0.3)
    bench.pretighten()
    plant, elongation = bench.plant, np.full(8, 3.0 / 2200.0)
    elongation[:4] = 1.0 / 2200.0
    plant._rest[:] = plant._length + plant._state["pulley_position"] - elongation
    restart(bench, rig, card)
    assert not bench.bridge.switch_closed.any()
    bench.mode = Mode.PRETIGHTENING
    bench.run(15.0, lambda: bool(bench.bridge.zeroed.all()))
    assert not bench.bridge.tared
    assert "pulled up to" in bench.bridge.sensor_tare.refusal


def test_tare_under_load_changes_nothing(bench):
    hold(bench, np.array([28.0, 0, 0, 0, 0, 0]))
    bench.mode = Mode.STOPPED
    before = bench.bridge.sensor_tare.bias
    bench.bridge.tare()
    bench.run(0.5)
    assert bench.bridge.sensor_tare.bias is before
    assert "not shown slack" in bench.bridge.sensor_tare.refusal
    assert wrong(bench) < WRONG_N


def test_tare_after_paying_out_is_accepted(bench, rig, card):
    """No zeros are known: the switches open, and 4 mm more are paid out."""
    hold(bench, np.array([28.0, 0, 0, 0, 0, 0]))
    restart(bench, rig, card)
    assert not bench.bridge.tared
    for limb in range(8):
        for _ in range(60):
            bench.plant._state["motor_position"][limb] -= 0.0005
            bench.cycle()
    bench.bridge.tare()
    bench.run(0.5)
    # Two of the cables pulled less than their switches show, from the start on.
    assert not bench.bridge.switch_closed.any()
    tare = bench.bridge.sensor_tare
    assert bench.bridge.tared
    assert wrong(bench) < WRONG_N
    assert tare.refusal == ""


def test_moving_sensor_is_not_tared(rig, card):
    bridge = Bridge(rig, card)
    for k in range(10 * card.tare_samples):
        volts = np.array([0.5 * np.sin(0.05 * k), 0, 0, 0, 0, 0])
        sample = CardSample(k, np.zeros(8, dtype=np.int64), volts, np.ones(8, dtype=np.bool_))
        bridge.take(sample, Mode.STOPPED)
    assert not bridge.tared
    assert "rest" in bridge.sensor_tare.refusal


def test_implausible_change_is_refused(rig, card):
    bridge = Bridge(rig, card)

    def show(volts, count):
        sample = CardSample(0, np.zeros(8, dtype=np.int64), volts, np.ones(8, dtype=np.bool_))
        for _ in range(count):
            bridge.take(sample, Mode.STOPPED)

    show(np.zeros(6), card.tare_samples)
    assert bridge.tared
    bridge.tare()
    show(np.array([2.0, 0, 0, 0, 0, 0]), card.tare_samples)
    assert "plausible" in bridge.sensor_tare.refusal
    np.testing.assert_allclose(bridge.wrench[0], 2.0 * card.ft_matrix[0, 0])


BIAS = SensorBias("FT1234", 1_700_000_000_000_000_000, np.arange(6) / 7.0, np.arange(6) / 3.0)


def test_bias_file_gives_back_what_was_written(tmp_path):
    path = tmp_path / "new" / "bias.json"
    assert load_bias(path, "FT1234") is None
    save_bias(path, BIAS)
    found = load_bias(path, "FT1234")
    assert (found.serial, found.time_ns) == (BIAS.serial, BIAS.time_ns)
    np.testing.assert_array_equal(found.volts, BIAS.volts)
    np.testing.assert_array_equal(found.tare_weight, BIAS.tare_weight)
    with pytest.raises(ConfigError, match="FT1234"):
        load_bias(path, "FT9")


@pytest.mark.parametrize(
    ("days", "word"),
    [
        (0.1, ""),
        (29.0, ""),
        (-0.5, ""),
        (400.0, "400 days old"),
        (-40.0, "future"),
        (np.nan, "days"),
    ],
)
def test_a_bias_of_long_ago_is_a_guess(days, word):
    """A strain gauge's zero drifts; a clock that is wrong by weeks tells no age."""
    said = BIAS.doubt(1e-9 * BIAS.time_ns + 86400.0 * days)
    assert bool(said) == bool(word)
    assert word in said
    assert not said or "pay the cables out" in said


def test_an_old_bias_bounds_the_wrench_and_no_load_is_granted_before_a_new_one(rig, card):
    again = Bridge(rig, card)
    again.adopt_bias(BIAS)
    again.sensor_tare.measuring = False
    keeper = BiasKeeper.__new__(BiasKeeper)
    keeper._bridge, keeper._path, keeper._kept = again, None, None
    keeper._told, keeper._doubt = again.sensor_tare.bias, BIAS.doubt(1e-9 * BIAS.time_ns + 4e7)
    assert again.tared
    assert keeper.look(False).name == FaultName.NOT_TARED
    again.sensor_tare.proven = keeper._kept = again.sensor_tare.bias
    assert keeper.look(False) is None


@pytest.mark.parametrize("text", ["", "{}", "[1]", "null", '{"form": 1}', "\xff", "[" * 100_000])
def test_damaged_bias_file_is_refused_by_name(tmp_path, text):
    path = tmp_path / "bias.json"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(ConfigError, match=r"bias\.json"):
        load_bias(path, "FT1234")


@pytest.mark.parametrize("volts", [[0.0] * 5, [float("nan")] * 6, ["a"] * 6, 3])
def test_bias_file_with_other_volts_is_refused(tmp_path, volts):
    path = tmp_path / "bias.json"
    save_bias(path, BIAS)
    path.write_text(json.dumps({**json.loads(path.read_text()), "volts": volts}))
    with pytest.raises(ConfigError, match=r"bias\.json"):
        load_bias(path, "FT1234")
