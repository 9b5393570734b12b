# SPDX-License-Identifier: Apache-2.0
"""What the bridge does after all controllers: amplifiers that drive, speeds, encoders that stop."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.supervision.modes import OperatingMode
from cabols_sim.fault_campaign.in_process.kinds import generated_kinds
from cabols_sim.fault_campaign.in_process.summary import SENSOR_RANGE
from cabols_sim.fault_campaign.in_process.trials import Bench, run_trial

OFF_WITHIN_S = 0.003
"""From an amplifier's own full current to amplifiers off."""
FULL_A = 6.5


@pytest.fixture(scope="module")
def bench():
    return Bench()


def kind(name):
    return next(one for one in generated_kinds() if one.name == name)


def loaded(bench, wrench=(60.0, -30.0, 40.0, 0.0, 0.0, 1.0)):
    rig = bench.zeroed(1)
    rig.mode = OperatingMode.LOADING
    rig.desired[:] = wrench
    rig.run(0.8)
    assert rig.guard.fault is None
    return rig


@pytest.mark.parametrize("limb", range(8))
def test_amplifier_that_delivers_all_is_off_within_3_ms(bench, limb):
    """The motor then coasts by v T, so that the cable gains k_e k i t_off at most."""
    rig = loaded(bench)
    limbs, before, struck_s = rig.rig.limbs, rig.plant.tension[limb], rig.now_s
    rig.plant.inject("amplifier_offset", limb, FULL_A)
    peak = before
    while rig.now_s < struck_s + 0.8:
        rig.cycle()
        peak = max(peak, rig.plant.tension[limb])
        if rig.guard.enabled:
            off_s = rig.now_s - struck_s
    assert rig.guard.fault.name == "motion"
    assert off_s <= OFF_WITHIN_S
    most = limbs.stiffness * limbs.gain[limb] * FULL_A * OFF_WITHIN_S
    assert peak - before <= 1.2 * most


@pytest.mark.parametrize("limb", [0, 3, 6])
@pytest.mark.parametrize("mode", [OperatingMode.LOADING, OperatingMode.FREE_MOVING])
def test_no_command_makes_a_motor_too_fast_to_be_stopped(bench, mode, limb):
    rig = bench.zeroed(2)
    rig.mode = mode
    rig.run(0.3)

    def wrong(current):
        changed = current.copy()
        changed[limb] = 3.0
        return changed

    rig.change_current = wrong
    fastest = peak = 0.0
    for _ in range(800):
        rig.cycle()
        fastest = max(fastest, rig.plant._state["motor_speed"][limb])
        peak = max(peak, rig.plant.tension.max())
    assert rig.guard.fault is not None
    assert fastest <= 1.03 * rig.guard.safety.most_speed[limb]
    assert peak <= 150.0


def test_a_step_of_all_that_is_rated_is_left_alone(bench):
    rig = bench.zeroed(0)
    rig.mode = OperatingMode.LOADING
    fastest = np.zeros(8)
    for sign in (1.0, -1.0):
        rig.desired[:] = sign * np.array([80.0, -60.0, 100.0, 1.0, -2.0, 2.0])
        for _ in range(800):
            rig.cycle()
            fastest = np.maximum(fastest, rig.guard.safety.speed)
    assert rig.guard.fault is None
    assert (fastest < rig.guard.safety.most_speed).all()


@pytest.mark.parametrize("seed", [1, 6])
def test_trip_under_load_is_not_taken_for_an_amplifiers_fault(bench, seed):
    """A motor that a load slows goes behind its current; it must still be braked: 889 N else."""
    trial = run_trial(bench, kind("robot moves: currents reversed"), seed)
    assert trial["detected"]
    assert trial["peak_tension_n"] <= 150.0


@pytest.mark.parametrize("seed", range(5))
def test_motor_whose_encoder_has_stopped_is_braked_by_its_current(bench, seed):
    trial = run_trial(bench, kind("started: encoder frozen"), seed)
    assert trial["found_by"] == "motion"
    assert trial["peak_tension_n"] < 12.0


@pytest.mark.parametrize("current", [-0.3, -0.8, -2.5])
def test_limb_that_a_controller_pays_out_is_reported(bench, current):
    rig = bench.started(1)
    rig.mode = OperatingMode.PRETIGHTENING
    rig.run(0.1)
    rig.change_current = lambda wanted: np.where(np.arange(8) == 4, current, wanted)
    rig.run(2.0, lambda: rig.guard.fault is not None)
    assert rig.guard.fault.name == "switch"
    assert rig.guard.fault.limb == 4


@pytest.mark.parametrize(("limb", "rate"), [(0, 0.02), (5, 0.03), (7, 0.02)])
def test_encoder_that_loses_counts_slowly_while_the_robot_moves(bench, limb, rate):
    """The cable gets slack, its estimate does not; switch and sensor together tell."""
    rig = bench.zeroed(limb)
    rig.mode = OperatingMode.FREE_MOVING
    rig.run(0.3)
    rig.robot.move(np.array([0.02, 0.0, 0.03]))
    began_s, sense = rig.now_s, rig.plant.sense

    def drifting():
        counts, gauges, lines = sense()
        counts[limb] += int(1e6 * rate * (rig.now_s - began_s))
        return counts, gauges, lines

    rig.plant.sense = drifting
    rig.run(2.0, lambda: rig.guard.fault is not None)
    assert rig.guard.fault.name == "cable"
    assert rig.guard.fault.limb == limb


@pytest.mark.parametrize("seed", range(4))
def test_pose_that_is_off_by_millimetres_is_not_taken_for_a_slack_cable(bench, seed):
    """A switch may stay open then, but the sensor has the force."""
    rig = bench.zeroed(seed)
    rig.mode = OperatingMode.FREE_MOVING
    rig.run(0.3)
    offset = np.random.default_rng(seed).normal(size=3)
    offset *= 0.002 / np.linalg.norm(offset)
    moved_s = rig.now_s

    def wrong(position, rotation):
        return position + min(1.0, 4.0 * (rig.now_s - moved_s)) * offset, rotation

    rig.change_pose = wrong
    rig.run(2.5)
    assert rig.guard.fault is None


MOVES = (OperatingMode.PRETIGHTENING, OperatingMode.FREE_MOVING)


@pytest.mark.parametrize("mode", MOVES)
def test_rig_whose_switches_are_wired_the_other_way_pays_out_no_farther_than_its_limit(bench, mode):
    """Its slack cables read closed, so that every limb pays out and no switch ever opens."""
    rig = bench.started(1)
    sense, began = rig.plant.sense, rig.bridge.wound_length.copy()

    def inverted():
        counts, gauges, lines = sense()
        return counts, gauges, ~lines

    rig.plant.sense = inverted
    rig.mode = mode
    rig.run(8.0, lambda: rig.guard.fault is not None)
    assert rig.guard.fault is not None
    assert rig.guard.fault.name == "switch"
    assert "switch_active_low" in str(rig.guard.fault)
    assert (began - rig.bridge.wound_length).max() < 0.18
    assert rig.plant.tension.max() < 10.0


def test_limbs_without_zeros_follow_a_robot_farther_than_that(bench):
    rig = bench.started(2)
    rig.mode = OperatingMode.FREE_MOVING
    rig.run(0.6)
    began = rig.bridge.wound_length.copy()
    rig.robot.move(np.array([0.0, 0.0, -0.1]))
    rig.run(2.95)
    assert rig.guard.fault is None
    assert (began - rig.bridge.wound_length).max() > 0.18


@pytest.mark.parametrize("rate", [0.2, 2.0])
def test_pose_that_lies_before_it_is_found_does_not_guide_the_unloading(bench, rate):
    """It turned by 0.4 rad: cables were paid out by it one-sidedly, 16 N m on a sensor of 15."""
    rig = loaded(bench, (50.0, -60.0, 62.0, 0.0, 0.0, 0.0))
    began_s, torque, peak = rig.now_s, 0.0, 0.0

    def turns(position, rotation):
        angle = min(rate * (rig.now_s - began_s), 0.4)
        return position, Rotation.from_rotvec([angle, 0.0, 0.0]).as_matrix() @ rotation

    rig.change_pose = turns
    for _ in range(800):
        rig.cycle()
        torque = max(torque, float(np.linalg.norm(rig.plant.wrench[3:])))
        peak = max(peak, rig.plant.tension.max())
    assert rig.guard.fault is not None
    assert torque < 10.0
    assert peak < 80.0
    assert rig.plant.tension.max() < 10.0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("factor", [4.448, 9.81, -1.0, 0.0])
def test_wrench_that_a_wrong_controller_swings_stays_within_the_sensor(bench, factor, seed):
    """It takes the sensor for one of other units: cables let go as fast as others are wound in."""
    rig = bench.prepare("loading", seed, np.random.default_rng(seed))
    right = rig.wrenches.to_base_axes
    rig.wrenches.to_base_axes = lambda wrench: factor * right(wrench)
    most = np.zeros(6)
    for _ in range(1500):
        rig.cycle()
        most = np.maximum(most, np.abs(rig.plant.wrench))
    assert (most <= SENSOR_RANGE).all()
    assert factor > 1.0 or rig.guard.fault is not None


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("tared", [True, False])
def test_pose_that_drifts_while_pre_tightened_limbs_wait_is_found_by_the_sensor(bench, seed, tared):
    """Limbs follow the pose, and the platform stands: 95 N, and a saturated sensor, before."""
    rig = bench.zeroed(seed)
    if not tared:
        # A bias that was refused, as by zeros of a drifting pose.
        rig.bridge.sensor_tare.bias = None
        rig.bridge._use_bias()
    way = np.random.default_rng(seed).normal(size=3)
    way *= 0.015 / np.linalg.norm(way)
    began_s = rig.now_s
    rig.change_pose = lambda where, turn: (where + way * (rig.now_s - began_s), turn)
    peak = 0.0
    for _ in range(4000):
        rig.cycle()
        peak = max(peak, rig.plant.tension.max())
        if rig.guard.fault is not None:
            break
    assert rig.guard.fault.name == "estimate"
    assert peak < 45.0


STANDS = [
    *((state, 0.8) for state in ("started", "pretightening", "robot moves", "path under load")),
    *((state, 1.5) for state in ("started", "loading", "free", "robot moves", "path under load")),
    ("loading", 3.0),
    ("free", 3.0),
]


@pytest.mark.parametrize("limb", [1, 3, 6])
@pytest.mark.parametrize(("state", "own_a"), STANDS)
def test_amplifier_that_drives_past_an_encoder_that_stands(bench, state, own_a, limb):
    """Neither the count nor any current tells of it, the sensor does: up to 889 N before."""
    rig = bench.prepare(state, 1, np.random.default_rng(3 + limb))
    rig.plant.inject("encoder_frozen", limb)
    rig.plant.inject("amplifier_offset", limb, own_a)
    peak = 0.0
    for _ in range(1500):
        rig.cycle()
        peak = max(peak, rig.plant.tension.max())
    assert rig.guard.fault is not None
    assert not rig.guard.recovering
    assert peak < 150.0


@pytest.mark.parametrize(("state", "seed"), [("loading", 26), ("path under load", 29)])
def test_what_pulls_against_a_braked_motor_does_not_let_go(bench, state, seed):
    """A limb's current is reversed as another load is asked for: 15.1 N m on the robot before."""
    trial = run_trial(bench, kind(f"{state}: current reversed, one limb"), seed)
    assert trial["detected"]
    assert (np.array(trial["peak_axes"]) <= SENSOR_RANGE).all(), trial


@pytest.mark.parametrize("wrong", ["wrong current, all limbs", "wrong tension, all limbs"])
@pytest.mark.parametrize("state", ["loading", "path under load", "free"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_sensor_that_is_stuck_hides_no_wrong_controller(bench, state, wrong, seed):
    """Its noise goes on. Braking was given up as it felt nothing: 417 N, 55 N m on the robot."""
    trial = run_trial(bench, kind(f"{state}: gauges stuck, {wrong}"), seed)
    assert trial["detected"] or trial["latent"]
    assert trial["peak_tension_n"] < 150.0
    assert (np.array(trial["peak_axes"]) <= SENSOR_RANGE).all(), trial


def test_motors_that_do_as_they_are_told_are_braked_on(bench):
    """Without zeros cables pull more than their bounds say: all was switched off, and 85 N."""
    trial = run_trial(bench, kind("started: current reversed, one limb"), 4)
    assert trial["found_by"] == "cable_speed"
    assert trial["safe_time_s"] <= 0.05
    assert trial["peak_tension_n"] < 30.0


@pytest.mark.parametrize("state", ["stopped", "free"])
def test_robot_stands_where_gears_hold_a_cable(bench, state):
    """Nothing follows it in STOPPED: 843 N."""
    rig = bench.prepare(state, 0, np.random.default_rng(5))
    rig.mode = OperatingMode.STOPPED
    rig.robot.move(0.06 * np.array([0.0, 0.6, 0.8]))
    before, peak = rig.plant.tension.max(), 0.0
    for _ in range(2500):
        rig.cycle()
        peak = max(peak, rig.plant.tension.max())
    assert peak < min(before + 75.0, 150.0)
