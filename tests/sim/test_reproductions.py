# SPDX-License-Identifier: Apache-2.0
"""The source's results computed anew: numbers against what is printed and what other codes say."""

import json
from functools import cache

import control
import numpy as np
import pytest

from cabols_control.gains import limb_gains
from cabols_control.limb import LimbModel, identify_limb, identify_limb_with_friction, step_response
from cabols_control.load_programs.programs import load_program
from cabols_control.run_report.judgement.step_response import analyse_steps, rise_time
from cabols_sim.plant.closed_loop import simulate
from cabols_sim.reproductions import (
    REPRODUCTIONS,
    reproduce_gains,
    reproduce_identification,
    reproduce_linearity,
    reproduce_stiffness,
    reproduce_tension_step,
    run_all,
)
from cabols_sim.reproductions.common import bench, control_limb
from cabols_sim.reproductions.gain_tables import PRINTED_K_I, PRINTED_K_P1

TABLE_3_1_GAIN = [0.853, 2.617, 1.125, 2.079, 1.663, 1.726, 2.621, 1.197]
TABLE_3_1_TIME_CONSTANT = [0.3564, 0.3146, 0.3497, 0.5640, 0.4660, 0.4494, 0.2499, 0.4180]

gains = cache(reproduce_gains)
identification = cache(reproduce_identification)
stiffness = cache(reproduce_stiffness)
tension_step = cache(reproduce_tension_step)
linearity = cache(reproduce_linearity)


@cache
def whole_programme(linear: bool):
    setup = bench()
    plant = setup.plant.linear() if linear else setup.plant
    program = load_program("multi_axis")
    desired = np.array([program.at(t) for t in np.arange(0.0, program.duration, 1e-3)])
    return simulate(setup.rig, setup.card, plant, desired)


def test_gains_agree_with_table_4_2():
    for name, printed in (("k_i", PRINTED_K_I), ("k_p1", PRINTED_K_P1)):
        np.testing.assert_allclose(gains().data[name], printed["table 4.2"], atol=0.6e-4)


def test_gains_agree_with_table_3_2_but_for_its_misprints():
    k_i, k_p1 = gains().data["k_i"], gains().data["k_p1"]
    others = np.array([limb not in (1, 3) for limb in range(8)])
    np.testing.assert_allclose(k_i[others], np.array(PRINTED_K_I["table 3.2"])[others], atol=0.6e-4)
    assert k_i[1] == pytest.approx(1.2622, abs=0.6e-4)
    assert k_i[1] != pytest.approx(PRINTED_K_I["table 3.2"][1], abs=0.2)
    # Limb 4 differs in the last digit only, as if its digits had been cut, not rounded.
    assert k_i[3] == pytest.approx(PRINTED_K_I["table 3.2"][3], abs=1.1e-4)
    np.testing.assert_allclose(k_p1, PRINTED_K_P1["table 3.2"], atol=1.1e-4)


def test_tension_gain_is_that_of_the_stated_stiffness():
    numbers = gains().numbers
    assert numbers["k_p2_mm_per_s_n"] == pytest.approx(8.4848, abs=1e-4)
    assert numbers["k_e_implied_by_printed_k_p2_n_per_mm"] == pytest.approx(2.07, abs=0.005)
    assert numbers["k_io_per_s"] == pytest.approx(360 / 49)
    assert numbers["k_po"] == pytest.approx(9 / 49)
    assert len(numbers["errata"]) >= 3


def test_every_misprint_is_starred_and_nothing_else():
    starred = {
        (row[0], column)
        for row in gains().rows
        for column, cell in enumerate(row)
        if cell.endswith("*") and column != 8
    }
    assert ("2", 2) in starred
    assert ("4", 2) in starred
    assert {limb for limb, _ in starred} == {"2", "4"}
    assert all(row[8].endswith("*") for row in gains().rows)


def test_linear_plant_gives_table_3_1_back():
    data = identification().data
    np.testing.assert_allclose(data["gain_linear"], TABLE_3_1_GAIN, rtol=1e-3)
    np.testing.assert_allclose(data["time_constant_linear"], TABLE_3_1_TIME_CONSTANT, rtol=1e-3)


def test_dry_friction_looks_like_a_smaller_gain():
    data, numbers = identification().data, identification().numbers
    # 0.03 A of 0.5 A: a share of the drive that friction takes at any speed.
    np.testing.assert_allclose(data["gain_full"] / data["true_gain"], 0.94, atol=1e-3)
    np.testing.assert_allclose(data["time_constant_full"], data["true_time_constant"], rtol=2e-3)
    assert min(numbers["fit_full_percent"]) > 96.0


def test_opposite_steps_do_not_remove_the_bias_but_coasting_does():
    data = identification().data
    assert (data["gain_pair"] < 0.95 * data["true_gain"]).all()
    np.testing.assert_allclose(data["gain_friction"], data["true_gain"], rtol=2e-3)
    np.testing.assert_allclose(
        data["time_constant_friction"], data["true_time_constant"], rtol=5e-3
    )
    np.testing.assert_allclose(data["friction"], bench().plant.limbs.coulomb_current, rtol=0.02)


def test_friction_fit_finds_none_where_there_is_none():
    time = np.arange(3000) * 1e-3
    current = np.where(time < 1.5, 0.5, 0.0)
    wound = step_response(LimbModel(1.2, 0.3), time, current)
    found = identify_limb_with_friction(time, current, wound, 3e-6)
    assert found.model.gain == pytest.approx(1.2, rel=1e-6)
    assert found.friction == pytest.approx(0.0, abs=1e-6)
    assert identify_limb(time, current, wound).gain == pytest.approx(found.model.gain, rel=1e-6)


@pytest.mark.parametrize(("name", "k_e"), [("with", 2.20), ("without", 10.72)])
def test_stiffness_is_that_of_figure_3_6(name, k_e):
    numbers = stiffness().numbers
    assert numbers[f"k_e_{name}_spring_n_per_mm"] == pytest.approx(k_e, rel=5e-3)
    assert numbers[f"k_e_winding_in_{name}_spring_n_per_mm"] == pytest.approx(k_e, rel=2e-3)
    # The gear's backlash, turned into tension by the limb's stiffness.
    backlash = 1e3 * bench().plant.limbs.backlash
    assert abs(numbers[f"hysteresis_{name}_spring_n"]) == pytest.approx(k_e * backlash, rel=0.05)


def test_tension_follows_the_model_with_the_spring_and_not_without():
    n = tension_step().numbers
    assert n["rise_time_model_s"] == pytest.approx(0.422, abs=1e-3)
    assert n["deviation_bench_gear_with_spring_percent"] < 4.0
    assert n["deviation_of_estimate_bench_gear_with_spring_percent"] < 4.0
    assert n["rise_time_bench_gear_with_spring_s"] == pytest.approx(0.422, abs=0.01)
    assert n["deviation_bench_gear_without_spring_percent"] > 10.0
    assert n["deviation_rougher_gear_with_spring_percent"] < 8.0
    assert n["deviation_rougher_gear_without_spring_percent"] > 20.0
    assert n["estimation_error_rougher_gear_without_spring_percent"] > 8.0
    with_spring = np.array(n["deviation_all_limbs_with_spring_percent"])
    without = np.array(n["deviation_all_limbs_without_spring_percent"])
    assert (without > 3.0 * with_spring).all()


def test_backlash_is_a_lasting_error_worth_the_stiffness():
    n = tension_step().numbers
    for gear, backlash_mm in (("bench_gear", 0.2), ("rougher_gear", 0.5)):
        for spring, k_e in (("with_spring", 2.20), ("without_spring", 10.72)):
            left_n = 0.01 * n[f"end_error_{gear}_{spring}_percent"] * 50.0
            assert left_n == pytest.approx(k_e * backlash_mm, rel=0.05, abs=0.05)


def test_lone_limb_on_the_linear_plant_is_the_triple_pole():
    plant = bench().plant.linear().limbs
    command = np.where(np.arange(2000) < 100, 10.0, 60.0)
    law = limb_gains(LimbModel(plant.gain[3], plant.time_constant[3]), 2200.0, [-10.0] * 3)
    trace = control_limb(plant, 3, law, 2200.0, command, ideal_encoder=True)
    time = np.arange(1900) * 1e-3
    _, expected = control.step_response(control.tf([1000.0], np.poly([-10.0] * 3)), T=time)
    # 1 kHz against poles at 10 1/s: the difference for the velocity moves them by a few per mille.
    np.testing.assert_allclose((trace.tension[100:] - 10.0) / 50.0, expected, atol=6e-3)
    np.testing.assert_allclose(trace.estimate, trace.tension, atol=1e-6)


def test_linear_plant_is_the_transfer_function():
    data = linearity().data
    time = data["time"]
    system = control.tf([36000.0], np.poly([-10.0, -40.0, -90.0]))
    _, expected = control.step_response(system, T=time)
    np.testing.assert_allclose(data["transfer_function"], expected, atol=1e-6)
    # 1 kHz against poles up to 90 1/s: the current held and the velocity differenced move the
    # closed poles by some per cent, and the response by 0.8 % of the step.
    assert np.abs(data["linear"] - expected).max() < 0.02
    # All of that is sampling: the same loop in z has none of it.
    assert np.abs(data["linear"] - data["sampled"]).max() < 1e-4
    assert rise_time(time, expected, 0.0, 1.0) == pytest.approx(0.233, abs=1e-3)


def test_loop_in_z_is_that_of_python_control():
    setup = bench()
    limb, law = setup.rig.limbs.models[5], setup.rig.gains.limbs[5]
    k_e, h = setup.rig.limbs.stiffness, 1e-3
    motor = control.tf([limb.gain], [limb.time_constant, 1.0, 0.0])
    plant = control.sample_system(motor, h, method="zoh")
    total = control.tf([h, 0.0], [1.0, -1.0], h)
    velocity = law.integral + law.velocity * control.tf([1.0, -1.0], [h, 0.0], h)
    speed_loop = control.feedback(plant, velocity)
    forward = law.integral * law.tension * k_e * control.series(total, speed_loop)
    inner = control.feedback(forward, 1)
    outer = setup.rig.gains.proportional + setup.rig.gains.integral * total
    closed = control.feedback(control.series(outer, inner), 1)
    samples = 600
    _, expected = control.step_response(control.ss(closed), T=np.arange(samples) * h)
    # Another limb's motor and gains: pole placement makes their sampled loops nearly the same.
    sampled = linearity().data["sampled"][:samples]
    np.testing.assert_allclose(sampled, np.ravel(expected), atol=5e-4)


def test_size_of_the_step_does_not_matter():
    assert linearity().numbers["spread_between_amplitudes_linear_percent"] < 0.01


def test_full_plant_is_near_the_transfer_function():
    numbers = linearity().numbers
    np.testing.assert_allclose(numbers["rise_time_linear_s"], 0.233, atol=0.01)
    np.testing.assert_allclose(numbers["rise_time_full_s"], 0.233, atol=0.03)
    assert max(numbers["deviation_full_percent"]) < 8.0


@pytest.mark.parametrize(("linear", "tolerance"), [(True, 0.01), (False, 0.03)])
def test_programme_of_section_3_5(linear, tolerance):
    data = whole_programme(linear)
    found = analyse_steps(data.time, data.desired, data.measured, bench().rig.control.rated)
    assert len(found.steps) == 28
    np.testing.assert_allclose(found.rise_times, 0.233, atol=tolerance)
    assert found.cross_coupling.max() < 0.02
    assert np.abs(data.current).max() < 3.0
    assert data.tension[data.time > 0.5].min() > 0.5
    assert data.tension.max() < 150.0
    assert (data.status == 0).all()


def test_run_all_writes_pictures_and_numbers(tmp_path):
    found = run_all(tmp_path / "new")
    assert list(found) == ["gains", "identification", "stiffness", "tension_step", "linearity"]
    assert len(found) == len(REPRODUCTIONS)
    content = json.loads((tmp_path / "new" / "reproductions.json").read_text(encoding="utf-8"))
    for key, result in found.items():
        assert (tmp_path / "new" / f"{key}.png").read_bytes().startswith(b"\x89PNG")
        assert content[key]["numbers"].keys() == result.numbers.keys()
        assert all(len(row) == len(result.header) for row in result.rows)
        assert len(result.text) > 100
