# SPDX-License-Identifier: Apache-2.0
"""The safety envelope: every fault, injected in the simulated rig under load, is found and safe."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cabols_control.errors import ConfigError
from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.modes import MOVING, OperatingMode
from cabols_hw.safety.config import SafetyConfig, load_safety
from cabols_hw.safety.faults import FAULTS, Reaction
from cabols_hw.safety.first_power_on import PowerOnBound
from cabols_hw.safety.guard import BridgeGuard
from cabols_sim.faults import KINDS, FaultError, PlantFaults
from rig_harness import RigInOneProcess

LOAD = np.array([60.0, 0.0, 80.0, 0.0, 0.0, 2.0])
"""100 N and a torque."""
HIGH, LOW = "high", "low"


@pytest.fixture(scope="module")
def under_load(rig, card, plant_config):
    bench = RigInOneProcess(rig, card, plant_config, seed=3)
    bench.load(LOAD)
    assert bench.guard.fault is None
    np.testing.assert_allclose(bench.plant.wrench, LOAD, atol=3.0)
    return bench


@pytest.fixture
def loaded(under_load):
    return under_load.fork()


def limb_of(bench, which):
    order = np.argsort(bench.plant.tension)
    return int(order[-1] if which == HIGH else order[0])


@pytest.mark.parametrize(
    ("kind", "which", "value", "name", "within_s"),
    [
        ("cable_break", HIGH, 0.0, "cable", 0.02),
        ("switch_open", HIGH, 0.0, "switch", 0.02),
        ("encoder_jump", HIGH, 0.0, "encoder", 0.003),
        ("encoder_jump", LOW, -0.003, "encoder", 0.003),
        ("amplifier_offset", HIGH, 1.0, "motion", 0.08),
        ("gauge_flat", None, 2.0, "sensor_flat", 0.25),
        ("gauge_nan", None, 4.0, "sensor_invalid", 0.003),
        ("gauge_saturated", None, 1.0, "sensor_saturated", 0.003),
        ("gauge_drift", None, 5.0, "estimate", 1.0),
        ("platform_runs", None, 0.1, "pose_speed", 0.06),
        ("platform_runs", None, -0.1, "pose_speed", 0.06),
        ("pose_offset", None, 0.5, "pose", 0.003),
        ("pose_silent", None, 0.0, "pose_age", 0.12),
    ],
)
def test_injected_fault_is_found_and_safe(loaded, kind, which, value, name, within_s):
    limb = limb_of(loaded, which) if which else -1
    began_s = loaded.now_s
    loaded.plant.inject(kind, limb, value)
    while loaded.guard.fault is None and loaded.now_s < began_s + within_s:
        loaded.cycle()
    fault = loaded.guard.fault
    assert fault is not None, f"{kind} not found within {within_s} s"
    assert fault.name == name
    assert which is None or fault.limb in (limb, -1)
    found_s = loaded.now_s
    at_detection = loaded.plant.tension.max()
    if kind == "platform_runs":
        # The robot is stopped by its own bridge in FAULT.
        loaded.plant.inject("none")
    loaded.run(0.5)
    _, tension, current = loaded.since(found_s + 0.002)
    assert tension.max() < 150.0
    assert tension.max() < at_detection + 12.0
    assert not current[-1][[i for i in range(8) if i != limb]].any()
    assert loaded.guard.output(loaded.mode).max() == 0.0
    if fault.reaction == Reaction.UNLOAD:
        others = [i for i in range(8) if i != fault.limb]
        assert tension[-1][others].max() < 20.0, "unloaded"
    else:
        assert not loaded.guard.unloading.active


@pytest.mark.parametrize("limb", [0, 5])
def test_switch_stuck_closed_is_found_at_the_next_pretightening(loaded, limb):
    loaded.plant.inject("switch_closed", limb)
    loaded.desired[:] = 0.0
    loaded.run(0.5)
    assert loaded.guard.fault is None, "nothing depends on it under load"
    loaded.mode = OperatingMode.PRETIGHTENING
    began_s = loaded.now_s
    while loaded.guard.fault is None and loaded.now_s < began_s + 10.0:
        loaded.cycle()
    assert loaded.guard.fault.name == "switch"
    assert loaded.guard.fault.limb == limb
    assert "closed after paying out 100 mm" in loaded.guard.fault.reason


@pytest.mark.parametrize("limb", [1, 6])
def test_switch_stuck_open_does_not_overload_in_pretightening(loaded, limb):
    loaded.desired[:] = 0.0
    loaded.run(0.5)
    loaded.plant.inject("switch_open", limb)
    loaded.mode = OperatingMode.PRETIGHTENING
    began_s = loaded.now_s
    while loaded.guard.fault is None and loaded.now_s < began_s + 10.0:
        loaded.cycle()
    assert loaded.guard.fault.name == "switch"
    assert loaded.guard.fault.limb == limb
    loaded.run(0.3)
    _, tension, _ = loaded.since(began_s)
    assert tension.max() < 60.0


def test_pretightening_after_a_cut_is_no_fault(loaded):
    loaded.plant.inject("encoder_jump", 2)
    loaded.run(0.1)
    assert loaded.guard.fault.name == "encoder"
    assert np.linalg.norm(loaded.plant.wrench[:3]) > 60.0, "the gears hold the load"
    loaded.plant.inject("none")
    loaded.mode = OperatingMode.STOPPED
    loaded.run(0.05)
    loaded.mode = OperatingMode.PRETIGHTENING
    loaded.run(4.0)
    assert loaded.guard.fault is None
    assert loaded.bridge.zeroed.all()
    assert loaded.plant.tension.max() < 12.0


def test_pose_may_be_another_one_after_a_stop(loaded):
    """As of a robot that was set up anew; under load the same is a fault, and stays one."""
    loaded.plant.inject("pose_offset", -1, 0.05)
    loaded.run(0.3)
    assert loaded.guard.fault.reason == "the platform's pose jumped by 50 mm"
    loaded.mode = OperatingMode.STOPPED
    loaded.run(0.05)
    assert loaded.guard.fault is None
    loaded.mode = OperatingMode.PRETIGHTENING
    loaded.run(4.0)
    assert loaded.guard.fault is None
    assert loaded.bridge.zeroed.all()


def overload_at_rest(bench):
    """Cut, reset, and let the robot move until the gears hold more than the sensor can tell."""
    bench.plant.inject("encoder_jump", 2)
    bench.run(0.1)
    assert bench.guard.fault.name == "encoder"
    bench.plant.inject("none")
    bench.mode = OperatingMode.STOPPED
    bench.run(0.05)
    bench.plant.inject("platform_runs", -1, 0.05)
    while not bench.bridge.saturation and bench.plant.tension.max() < 140.0:
        bench.cycle()
    bench.plant.inject("none")
    bench.run(0.05)
    assert bench.guard.fault.name == "sensor_saturated"


def test_free_moving_takes_an_overload_off(loaded):
    overload_at_rest(loaded)
    highest = loaded.plant.tension.max()
    began_s = loaded.now_s
    loaded.mode = OperatingMode.FREE_MOVING
    loaded.run(2.5)
    assert loaded.guard.fault is None
    assert loaded.since(began_s)[1].max() < highest + 2.0
    assert loaded.plant.tension.max() < 15.0
    assert not loaded.bridge.saturation
    loaded.run(1.0)
    assert loaded.guard.fault is None


def test_an_overload_that_stays_is_a_fault_again(loaded):
    overload_at_rest(loaded)
    loaded.plant.inject("gauge_saturated", -1, 1.0)
    loaded.mode = OperatingMode.FREE_MOVING
    loaded.run(2.9)
    assert loaded.guard.fault is None
    loaded.run(0.2)
    assert loaded.guard.fault.name == "sensor_saturated"


def test_a_new_overload_in_free_moving_is_a_fault_at_once(loaded):
    loaded.mode = OperatingMode.STOPPED
    loaded.run(0.05)
    loaded.mode = OperatingMode.FREE_MOVING
    loaded.run(0.05)
    assert loaded.guard.fault is None
    loaded.plant.inject("gauge_saturated", -1, 1.0)
    loaded.run(0.01)
    assert loaded.guard.fault.name == "sensor_saturated"


def test_motor_jam_is_found_when_the_load_changes(loaded):
    loaded.plant.inject("motor_jam", limb_of(loaded, HIGH))
    loaded.desired = LOAD * 0.3
    began_s = loaded.now_s
    while loaded.guard.fault is None and loaded.now_s < began_s + 0.5:
        loaded.cycle()
    assert loaded.guard.fault.name == "motion"


def test_tension_limit_acts_before_the_spring_ends(loaded):
    loaded.desired = np.array([150.0, -150.0, 300.0, 0.0, 0.0, 0.0])
    while loaded.guard.fault is None and loaded.now_s < 10.0:
        loaded.cycle()
    assert loaded.guard.fault.name == "tension"
    loaded.run(0.4)
    _, tension, _ = loaded.since(0.0)
    assert tension.max() < 150.0
    assert loaded.plant.tension.max() < 20.0


def test_wrench_beyond_the_sensors_range(loaded):
    loaded.desired = np.array([190.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    while loaded.guard.fault is None and loaded.now_s < 10.0:
        loaded.cycle()
    assert loaded.guard.fault.name == "wrench"
    assert "force x" in loaded.guard.fault.reason


def test_silent_controllers_are_cut(loaded):
    loaded.controllers_alive = False
    began_s = loaded.now_s
    while loaded.guard.fault is None and loaded.now_s < began_s + 0.1:
        loaded.cycle()
    assert loaded.guard.fault.name == "command_age"
    assert loaded.now_s - began_s <= 0.013
    loaded.run(0.01)
    assert not loaded.plant.current.any()


def test_gap_between_samples_is_a_fault(loaded):
    # The watchdogs, which would be faster, look away.
    loaded.card._watchdog_ns = 10**12
    loaded.guard._watchdog._timeout = 10.0
    for _ in range(30):
        loaded.card.read()
    loaded.cycle()
    assert loaded.guard.fault.name == "state_age"


def test_cards_own_watchdog_is_a_fault(loaded):
    loaded.guard._watchdog._timeout = 10.0
    for _ in range(12):
        loaded.card.read()
    loaded.cycle()
    assert loaded.guard.fault.name == "card"
    assert not loaded.plant.current.any()


def test_unchecked_wiring_bounds_currents_modes_and_ways(loaded):
    bound = PowerOnBound(8)
    wound, asked = np.zeros(8), np.zeros(8)
    asked[3] = -2.0
    for mode in OperatingMode:
        assert bound.judge(mode, wound) is None
        moves = mode == OperatingMode.COMMISSIONING
        np.testing.assert_array_equal(bound.bounded(mode, asked), -0.1 * moves * (asked < 0.0))
    # One limb in a mode: another one, or several, get nothing.
    assert bound.judge(OperatingMode.COMMISSIONING, wound) is None
    bound.bounded(OperatingMode.COMMISSIONING, asked)
    asked[5] = 1.0
    output = bound.bounded(OperatingMode.COMMISSIONING, asked)
    assert np.flatnonzero(output).tolist() == [3]
    for way in (0.0071, -0.0071, float("nan")):
        wound[6] = way
        assert bound.judge(OperatingMode.COMMISSIONING, wound).name == "first_power_on"
    wound[6] = 0.0069
    assert bound.judge(OperatingMode.COMMISSIONING, wound) is None
    # In the rig under load: nothing but rest is left, and the fault is the bridge's.
    loaded.guard.power_on = PowerOnBound(8)
    loaded.cycle()
    assert not loaded.guard.output(OperatingMode.LOADING).any()


@pytest.mark.parametrize("mode", MOVING)
def test_a_platform_that_nothing_holds_gets_no_current(rig, card, plant_config, mode):
    """It would fall with the amplifiers off: nothing lifts it in the first place."""
    bench = RigInOneProcess(rig, card, plant_config, seed=3)
    bench.guard = BridgeGuard(rig, replace(load_safety(), platform_held=False), card.watchdog)
    bench.run(0.02)
    assert bench.guard.fault is None
    assert not bench.guard.enabled
    bench.mode = mode
    began_s = bench.now_s
    bench.cycle()
    assert bench.guard.fault.name == "not_held"
    assert "robot or a stand" in bench.guard.fault.reason
    bench.run(0.05)
    assert not bench.guard.enabled
    assert not bench.since(began_s)[2].any()
    bench.mode = OperatingMode.STOPPED
    bench.run(0.01)
    assert bench.guard.fault is None


def test_current_at_its_limit_for_long(loaded):
    bridge, guard = loaded.bridge, loaded.guard
    limb = limb_of(loaded, LOW)
    # The motor is blocked, so that only the rule about time at the limit can act first.
    guard.safety._limb_limits["motion_current"] = 100.0
    loaded.plant.inject("motor_jam", limb)
    loaded.controllers_alive = False
    current = np.zeros(8)
    current[limb] = 5.0
    began_s = loaded.now_s
    while guard.fault is None and loaded.now_s < began_s + 0.3:
        loaded.cycle()
        guard.command(np.arange(8), current, loaded.now_s)
        loaded.card.write(bridge.volts(guard.output(loaded.mode)))
    assert guard.fault.name == "current"
    assert guard.fault.limb == limb


@pytest.mark.parametrize("current_a", [1.0, 3.0])
def test_cable_without_a_zero_is_stopped_by_its_speed(rig, card, plant_config, current_a):
    bench = RigInOneProcess(rig, card, plant_config, seed=4)
    bench.run(0.3)
    bench.mode, bench.controllers_alive = OperatingMode.FREE_MOVING, False
    while bench.guard.fault is None and bench.now_s < 1.0:
        bench.cycle()
        bench.guard.command(np.arange(8), np.full(8, current_a), bench.now_s)
        bench.write(bench.guard.output(bench.mode))
    assert bench.guard.fault.name == "cable_speed"
    bench.run(0.2)
    assert bench.plant.tension.max() < 40.0
    assert not bench.plant.enabled


def test_emergency_stop_cuts_unloading_short(loaded):
    loaded.plant.inject("gauge_nan")
    loaded.run(0.02)
    assert loaded.guard.unloading.active
    loaded.guard.emergency_stop()
    loaded.run(0.005)
    assert not loaded.plant.current.any()
    assert not loaded.plant.enabled
    loaded.mode = OperatingMode.STOPPED
    loaded.run(0.005)
    assert not loaded.plant.enabled, "at rest amplifiers are off"
    loaded.plant.inject("none")
    loaded.run(0.005)
    loaded.mode = OperatingMode.FREE_MOVING
    loaded.run(0.005)
    assert loaded.plant.enabled


def test_bridge_that_is_to_end_unloads_by_itself(loaded):
    """As "ending": nobody else unloads, and the controllers command on."""
    loaded.guard.ending = True
    loaded.run(1.0)
    assert loaded.guard.fault.name == "ending"
    assert not loaded.guard.unloading.active
    assert loaded.plant.tension.max() < 10.0
    assert not loaded.plant.current.any()


def test_bridge_at_rest_may_end_without_a_fault(loaded):
    loaded.mode = OperatingMode.STOPPED
    loaded.run(0.5)
    loaded.guard.ending = True
    loaded.run(0.1)
    assert loaded.guard.fault is None


def test_fault_stays_until_stopped(loaded):
    loaded.plant.inject("pose_silent", duration_s=0.15)
    loaded.run(0.5)
    assert loaded.guard.fault.name == "pose_age"
    loaded.mode = OperatingMode.STOPPED
    loaded.run(0.01)
    assert loaded.guard.fault is None


@pytest.mark.parametrize("seed", range(4))
def test_no_false_alarm_over_a_whole_programme(rig, card, plant_config, seed):
    bench = RigInOneProcess(rig, card, plant_config, seed=seed)
    bench.load(LOAD)
    random = np.random.default_rng(seed)
    for _ in range(6):
        bench.desired = random.uniform(-1.0, 1.0, 6) * [70.0, 70.0, 70.0, 6.0, 6.0, 6.0]
        bench.run(0.4)
        assert bench.guard.fault is None


def test_every_fault_of_the_bridge_is_injected_somewhere():
    text = Path(__file__).read_text(encoding="utf-8")
    # A platform that hangs on its cables has a bench of its own.
    text += (Path(__file__).parents[1] / "sim/test_hanging_rig.py").read_text(encoding="utf-8")
    assert all(f'"{name}"' in text for name in FAULTS)


def test_unknown_faults_and_limbs_are_refused():
    faults = PlantFaults(8)
    with pytest.raises(FaultError, match="expected none, cable_break"):
        faults.inject("gremlins")
    with pytest.raises(FaultError, match="from 0 to 7"):
        faults.inject("cable_break", 8)
    with pytest.raises(FaultError, match="finite"):
        faults.inject("gauge_drift", value=float("nan"))
    assert not faults.any
    assert set(KINDS) >= {"beam", "egm_loss"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wrench_max": [1.0] * 5}, "expected 6"),
        ({"tension_max": float("nan")}, "tension_max"),
        ({"pose_age": 0.0}, "pose_age"),
    ],
)
def test_configuration_is_checked(changes, message):
    values = {"wrench_max": [1.0] * 6, "position_range": [0.1] * 3, **changes}
    with pytest.raises((ConfigError, ValueError), match=message):
        SafetyConfig(**values)


@pytest.mark.parametrize("silent_supervisor", [False, True])
def test_pressed_stop_holds_in_every_mode_until_its_reset(loaded, silent_supervisor):
    """Also where no supervisor runs: the mode says LOADING on, or begins anew in STOPPED."""
    loaded.guard.press_stop()
    if not silent_supervisor:
        loaded.mode = OperatingMode.FAULT
    loaded.run(0.06)
    assert not loaded.plant.current.any()
    for mode in (OperatingMode.STOPPED, OperatingMode.FREE_MOVING, OperatingMode.LOADING):
        loaded.mode = mode
        loaded.run(0.005)
        assert not loaded.plant.current.any()
        assert not loaded.plant.enabled
    loaded.guard.release_stop()
    loaded.mode = OperatingMode.STOPPED
    loaded.run(0.005)
    loaded.mode = OperatingMode.FREE_MOVING
    loaded.run(0.005)
    assert loaded.plant.enabled


def test_pressed_stop_brakes_and_lets_no_tension_rise(loaded):
    highest = loaded.plant.tension.max()
    loaded.guard.press_stop()
    for _ in range(60):
        loaded.cycle()
        highest = max(highest, loaded.plant.tension.max())
    assert highest <= 150.0
    assert not loaded.plant.current.any()


@pytest.mark.parametrize("back_s", [0.05, 10.0])
def test_a_clock_that_goes_back_is_a_fault_also_while_nothing_else_shows_it(loaded, back_s):
    """A pose that is silent would else be fresh by it for as long as the step."""
    read, shift_ns = loaded.card.read, round(1e9 * back_s)
    loaded.card.read = lambda: replace(sample := read(), time_ns=sample.time_ns - shift_ns)
    loaded.cycle()
    assert loaded.guard.fault.name == FaultName.STATE_AGE
