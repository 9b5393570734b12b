# SPDX-License-Identifier: Apache-2.0
"""The generated fault campaign in one process: its plan, its summary, and a few of its trials."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from cabols_control.supervision.faults import FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_sim.fault_campaign.in_process.command import SEEDS, run_generated
from cabols_sim.fault_campaign.in_process.kinds import STATES, WIRED, generated_kinds
from cabols_sim.fault_campaign.in_process.summary import generated_holds, summarise_generated
from cabols_sim.fault_campaign.in_process.trials import Bench, _safe_s, run_trial
from cabols_sim.fault_campaign.kinds import KINDS
from cabols_sim.plant.miswiring import Miswiring

ALONE_N = 15.0
"""What the bridge's own law leaves on a cable while a robot still moves."""


@pytest.fixture(scope="module")
def bench():
    return Bench()


def kind(name):
    return next(one for one in generated_kinds() if one.name == name)


def test_plan_is_large_and_names_every_kind_once():
    kinds = generated_kinds()
    names = [one.name for one in kinds]
    assert len(set(names)) == len(names) >= 120
    assert {one.state for one in kinds} == {*STATES, WIRED}
    assert SEEDS * len(kinds) + 20 * len(KINDS) >= 3000
    assert 20 * len(KINDS) >= 600


@pytest.mark.parametrize("seed", range(6))
def test_bridge_pays_out_alone_while_the_robot_moves(bench, seed):
    """The limb controller dies; the robot goes on until it misses the heartbeat, and brakes."""
    trial = run_trial(bench, kind("robot moves: limb controller dead"), seed)
    assert trial["detected"]
    assert trial["peak_tension_n"] < ALONE_N


@pytest.mark.parametrize("offset", [2.2, 2.6, 3.0, 3.4])
@pytest.mark.parametrize("seed", range(2))
def test_amplifier_near_the_limit_of_two_samples_is_switched_off_and_not_braked(
    bench, offset, seed
):
    """Its current shows in one sample and not in the next: that is no step of the encoder."""
    random = np.random.default_rng([seed, round(10 * offset)])
    rig = bench.prepare("started", seed, random)
    limb = int(random.integers(8))
    rig.plant.inject("amplifier_offset", limb, offset)
    rig.run(0.05, lambda: rig.guard.fault is not None)
    assert rig.guard.fault.name == FaultName.MOTION
    rig.run(0.01)
    assert not rig.plant.enabled
    rig.run(0.4)
    assert rig.plant.tension.max() < 75.0


@pytest.mark.parametrize("size", [-0.012, -0.005, 0.005, 0.012])
@pytest.mark.parametrize("mended", [False, True])
def test_count_that_jumped_does_not_keep_its_limb_from_pretightening(bench, size, mended):
    """It moves where the cable is slack, once: the sample after it is no jump back."""
    rig = bench.zeroed(0)
    rig.mode = OperatingMode.FREE_MOVING
    rig.run(0.3)
    rig.plant.inject("encoder_jump", 6, size)
    rig.run(0.3)
    assert rig.guard.fault.name == FaultName.ENCODER
    rig.mode = OperatingMode.STOPPED
    rig.run(0.02)
    if mended:
        rig.plant.inject("none")
        rig.run(0.02)
    rig.mode = OperatingMode.PRETIGHTENING
    rig.run(0.2, lambda: rig.guard.fault is not None)
    assert rig.guard.fault is None
    here = rig.guard.safety.tension_bound[6]
    assert here > rig.plant.tension[6] - 1.0


@pytest.mark.parametrize("process", ["robot's bridge", "supervisor", "limb controller"])
@pytest.mark.parametrize("state", ["robot moves", "path under load"])
def test_process_that_dies_while_the_robot_moves_lets_no_cable_gain_much(bench, state, process):
    """The robot stops by its own watch, later than it would by a fault that it is told of."""
    trial = run_trial(bench, kind(f"{state}: {process} dead"), 1)
    assert trial["healthy"]
    assert trial["detected"] or process == "supervisor"
    assert trial["growth_n"] < ALONE_N
    assert trial["peak_tension_n"] < (ALONE_N if state == "robot moves" else 75.0)


@pytest.mark.parametrize("state", ["loading", "path under load"])
def test_whichever_cable_breaks_no_other_and_no_axis_of_the_sensor_passes_its_limit(bench, state):
    """Two draws of the cable; one that is slack may break unseen, the bounds hold for all."""
    limits = bench._card.sensor_limits
    for seed in range(2):
        trial = run_trial(bench, kind(f"{state}: any cable breaks"), seed)
        assert trial["healthy"]
        assert trial["peak_tension_n"] < bench._safety.tension_max
        assert (np.array(trial["peak_axes"]) < limits).all()
        assert trial["found_by"] in ("cable", "")


def test_same_seed_is_the_same_trial(bench):
    one, other = (run_trial(bench, kind("loading: encoder jumps"), 3) for _ in range(2))
    assert one == other


def test_truth_is_the_plants_and_not_the_bridges(bench):
    """A spring has an end there: what winds in against it pulls by the cable's stiffness."""
    rig = bench.zeroed(0)
    assert rig.plant._parameters["spring_end_tension"][0] == 150.0
    assert rig.mode == OperatingMode.PRETIGHTENING


def made(**changes):
    usual = {
        "kind": "loading: x",
        "seed": 0,
        "healthy": True,
        "latent": False,
        "amplifier": False,
        "full": False,
        "by_robot": False,
        "blind": False,
        "uncounted": False,
        "pair": False,
        "beyond_drive_n": None,
        "within_s": 0.05,
        "detected": True,
        "detection_time_s": 0.01,
        "found_by": "motion",
        "safe_time_s": 0.0,
        "growth_n": 1.0,
        "beyond_robot_n": -1.0,
        "peak_tension_n": 80.0,
        "peak_axes": [100.0, 0.0, 0.0, 2.0, 0.0, 0.0],
        "change_force_n": 1.0,
        "change_torque_nm": 0.1,
    }
    return {**usual, **changes}


def test_claims_hold_and_each_is_broken_by_its_own_trial():
    assert generated_holds(summarise_generated([made()]))
    broken = (
        {"detected": False, "detection_time_s": None, "safe_time_s": None},
        {"detection_time_s": 0.06},
        {"safe_time_s": 0.06},
        {"peak_tension_n": 150.1},
        {"peak_axes": [0.0, 0.0, 0.0, 0.0, 0.0, 15.1]},
        {"healthy": False},
        {"amplifier": True, "beyond_drive_n": 0.1},
        {"amplifier": True, "peak_tension_n": 150.1},
        {"amplifier": True, "safe_time_s": 0.61},
        {"by_robot": True, "safe_time_s": 0.36},
        {"blind": True, "safe_time_s": 0.61},
        {"blind": True, "safe_time_s": 0.3, "growth_n": 10.1},
        {"blind": True, "uncounted": True, "safe_time_s": 0.3, "growth_n": 35.1},
        {"by_robot": True, "safe_time_s": 0.2, "beyond_robot_n": 5.1},
    )
    for changes in broken:
        assert not generated_holds(summarise_generated([made(), made(seed=1, **changes)])), changes
    assert not generated_holds(summarise_generated([]))


def test_motor_that_coasts_after_its_amplifiers_fault_is_counted_apart():
    coasts = made(amplifier=True, safe_time_s=0.3, beyond_drive_n=-5.0)
    summary = summarise_generated([coasts, made(seed=1), made(seed=2)])
    assert summary["coasting"] == 1
    assert summary["coasting_max_s"] == 0.3
    assert summary["slow_to_safe"] == 0


def test_robot_that_brakes_is_counted_apart_only_where_a_motor_cannot_turn():
    brakes = made(by_robot=True, safe_time_s=0.2, growth_n=12.0)
    pulls = made(seed=1, safe_time_s=0.2)
    quick = [made(seed=seed) for seed in range(2, 6)]
    summary = summarise_generated([brakes, pulls, *quick])
    assert summary["robot_brakes"] == 1
    assert summary["robot_max_n"] == 12.0
    assert summary["slow_to_safe"] == 1
    assert generated_holds(summarise_generated([brakes, *quick]))
    assert not generated_holds(summarise_generated([brakes, pulls, *quick]))


def test_only_an_amplifier_that_delivers_all_may_pull_beyond_the_spring():
    full = made(amplifier=True, full=True, beyond_drive_n=-1.0, peak_tension_n=170.0)
    assert generated_holds(summarise_generated([full]))
    assert not generated_holds(summarise_generated([{**full, "full": False}]))


def test_a_median_beyond_5_ms_breaks_the_claims():
    slow = [made(seed=seed, safe_time_s=0.006) for seed in range(3)]
    assert not generated_holds(summarise_generated(slow))


def test_safe_is_where_no_limb_grows_not_only_the_highest():
    times = 0.001 * np.arange(1, 201)
    tension = np.tile([80.0, 10.0], (200, 1))
    tension[:, 1] += np.minimum(100.0 * times, 12.0)
    assert _safe_s(times, tension, 0.01) == pytest.approx(0.1, abs=0.002)
    tension[:, 1] = 10.0 + np.minimum(100.0 * times, 4.0)
    assert _safe_s(times, tension, 0.01) == 0.0


@pytest.mark.parametrize("seed", [1, 8])
def test_limbs_give_way_on_a_path_also_after_samples_that_the_card_missed(bench, seed):
    """The card's own watchdog has expired then, and must be cleared before anything can pay out."""
    trial = run_trial(bench, kind("path under load: samples missing"), seed)
    assert trial["detected"]
    assert trial["safe_time_s"] <= 0.05


SECOND = ("amplifier delivers all", "encoder jumps", "motor of the highest jams")


@pytest.mark.parametrize("name", SECOND)
@pytest.mark.parametrize("seed", range(3))
def test_second_fault_with_a_harder_reaction_must_be_found(bench, name, seed):
    one = kind(f"second fault: {name}")
    trial = run_trial(bench, one, seed)
    assert not one.latent
    assert trial["detected"]
    assert trial["peak_tension_n"] <= 150.0


@pytest.mark.parametrize("name", ["motors exchanged", "both reversed", "gauges reversed"])
def test_wrong_wiring_is_found_also_where_the_check_was_left_out(bench, name):
    trial = run_trial(bench, kind(f"wired wrongly: {name}"), 5)
    assert trial["detected"]
    assert trial["peak_tension_n"] < 100.0


def test_latent_kinds_need_no_report_but_keep_the_bounds():
    quiet = {"latent": True, "detected": False, "detection_time_s": None, "safe_time_s": None}
    assert generated_holds(summarise_generated([made(**quiet)]))
    assert not generated_holds(summarise_generated([made(**quiet, peak_tension_n=151.0)]))


def test_campaign_goes_on_where_it_was(tmp_path, capsys):
    for trials in (2, 0):
        run_generated(tmp_path, seeds=2, only="free: pose jumps")
        assert f"{trials} generated trials" in capsys.readouterr().out
    assert len((tmp_path / "generated.jsonl").read_text().splitlines()) == 2


@pytest.mark.parametrize("limbs", [(1, 3), (5, 7), (0, 4), (2, 6)])
def test_exchanged_switches_are_found_before_a_limb_has_a_wrong_zero(bench, limbs):
    """In this plant limbs 1 and 3, and 5 and 7, get tight within a millisecond of each other."""
    rig = bench.started(1)
    rig.plant.wiring = Miswiring.of("switches_exchanged", *limbs)
    rig.mode = OperatingMode.PRETIGHTENING
    rig.run(4.0, lambda: rig.guard.fault is not None or bool(rig.bridge.zeroed.all()))
    assert rig.guard.fault is not None
    assert rig.guard.fault.name == FaultName.SWITCH
    assert not rig.bridge.zeroed.all()
    assert rig.plant.tension.max() < 50.0


def test_exchanged_channels_show_once_the_two_limbs_pull_unlike(bench):
    """While they pull alike nothing tells them apart; a difference of 25 N does, for each pair."""
    structure, safety = bench.zeroed(0).bridge.structure, bench._safety
    for one, other in combinations(range(structure.shape[1]), 2):
        apart = structure[:, one] - structure[:, other]
        by_force = safety.estimate_force / np.linalg.norm(apart[:3])
        by_torque = safety.estimate_torque / np.linalg.norm(apart[3:])
        assert min(by_force, by_torque) < 25.0
    rig = bench.started(0)
    rig.plant.wiring = Miswiring.of("channels_exchanged", 0, 2)
    rig.mode = OperatingMode.PRETIGHTENING
    rig.run(6.0, lambda: bool(rig.bridge.zeroed.all()))
    rig.run(0.3)
    missed = rig.bridge.structure @ rig.bridge.tension
    missed -= rig.wrenches.to_base_axes(rig.bridge.wrench)
    assert np.linalg.norm(missed[:3]) < 0.5
    rig.mode = OperatingMode.LOADING
    rig.desired[:3] = [10.0, -55.0, 20.0]
    rig.run(1.0, lambda: rig.guard.fault is not None)
    assert rig.guard.fault is not None
    assert abs(rig.plant.tension[0] - rig.plant.tension[2]) < 45.0
