# SPDX-License-Identifier: Apache-2.0
"""Commissioning in one process: the loop of plant, bridge and limb controller, without DDS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cabols_control.commissioning.programmes import CommissioningConfig, CommissioningError
from cabols_control.commissioning.results import (
    LimbResult,
    cable_tension_by_wrench,
    commissioned_rig,
    evaluate_ramp,
    evaluate_step,
    write_results,
)
from cabols_control.commissioning.rig_programmes import make_ramp, make_step
from cabols_control.configuration import read_yaml
from cabols_control.errors import ShapeError
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.rig import load_rig
from cabols_control.rig_folder import rig_file
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import OperatingMode
from one_process import OneProcess

CONFIG = CommissioningConfig()


def step_of(rig, limb, config=CONFIG):
    return make_step(rig, limb, config)


def ramp_of(rig, limb):
    geometry = rig.geometry
    pose = (geometry.reference_position, geometry.reference_rotation)
    return make_ramp(rig, limb, CONFIG, *pose)


@pytest.fixture
def loop(rig, card, plant_config):
    loop = OneProcess(rig, card, plant_config, 3)
    loop.run(0.3)
    return loop


def run_programme(loop, programme):
    loop.mode = OperatingMode.COMMISSIONING
    loop.controller.excitation = programme
    loop.run(70.0, lambda: programme.done)
    assert programme.done


@pytest.mark.parametrize("limb", [0, 1, 3, 6])
def test_step_finds_gain_time_constant_and_friction(loop, rig, plant_config, limb):
    programme = step_of(rig, limb)
    wound = loop.bridge.wound_length.copy()
    run_programme(loop, programme)
    assert not programme.fault
    record = programme.record
    result = evaluate_step(record)
    limbs = plant_config.limbs
    # Viscous friction is part of what (3.11) calls k and T: see physics.limb_step.
    slower = 1.0 + limbs.gain[limb] * limbs.viscous_current
    assert result.model.gain == pytest.approx(limbs.gain[limb] / slower, rel=0.01)
    assert result.model.time_constant == pytest.approx(limbs.time_constant[limb] / slower, rel=0.02)
    assert result.friction == pytest.approx(limbs.coulomb_current, rel=0.05)
    # Without friction in the model the gain is off, and no fit would tell.
    assert abs(result.plain.gain * slower / limbs.gain[limb] - 1.0) > 0.02
    # Only paid out, within the limit, and back where it was; no cable got tight.
    assert record["wound_length"].max() <= wound[limb] + 1e-4
    assert np.ptp(record["wound_length"]) < 1.2 * CONFIG.travel
    assert loop.bridge.wound_length[limb] == pytest.approx(wound[limb], abs=0.002)
    assert loop.tension.max() < 10.0
    others = np.arange(8) != limb
    np.testing.assert_array_equal(loop.bridge.wound_length[others], wound[others])
    np.testing.assert_array_equal(loop.controller.current, 0.0)


def test_step_of_a_tight_limb_slackens_it_first(loop, rig, plant_config):
    loop.pretighten()
    loop.mode = OperatingMode.STOPPED
    loop.run(0.1)
    programme = step_of(rig, 4)
    run_programme(loop, programme)
    assert not programme.fault
    limbs = plant_config.limbs
    slower = 1.0 + limbs.gain[4] * limbs.viscous_current
    found = evaluate_step(programme.record).model
    assert found.gain == pytest.approx(limbs.gain[4] / slower, rel=0.01)
    # Back to where the switch closes, no further.
    assert loop.bridge.switch_closed[4]
    assert loop.tension.max() < 10.0


@pytest.mark.parametrize("limb", [0, 6])
def test_ramp_finds_the_stiffness(loop, rig, plant_config, limb):
    loop.pretighten()
    programme = ramp_of(rig, limb)
    record_wrench(loop, programme)
    assert not programme.fault
    geometry = rig.geometry
    pose = (geometry.reference_position, geometry.reference_rotation)
    record = programme.record
    times, wrench = programme.wrench
    result = evaluate_ramp(
        record, times - programme.record_start_s, wrench, geometry, limb, *pose, rig.control.rated
    )
    limbs = plant_config.limbs
    length = cable_lengths(geometry, *pose)[limb]
    compliance = 1.0 / limbs.spring_stiffness + limbs.cable_compliance_per_metre * length
    assert result.line.stiffness == pytest.approx(1.0 / compliance, rel=0.01)
    assert result.fit > 0.98
    # What the motor turns at the peak before the cable follows makes it a little less.
    assert 0.85 < result.line.play / limbs.backlash < 1.0
    # The sensor sees the true tension: less than the holding tension's own error, 0.5 N.
    assert np.abs(result.tension.max() - loop.tension[:, limb].max()) < 1.0
    # The sensor's range bounds the ramp here: 15 N m, less than 150 N on one cable would give.
    assert 80.0 < loop.tension[:, limb].max() < 120.0
    others = np.arange(8) != limb
    np.testing.assert_allclose(loop.tension[:, others], rig.holding_tension, atol=1.0)
    assert not loop.bridge.saturated_gauge


def test_a_gear_without_play_is_given_none(rig, card, plant_config):
    limbs = replace(plant_config.limbs, backlash=0.0)
    loop = OneProcess(rig, card, replace(plant_config, limbs=limbs), 3)
    loop.run(0.3)
    loop.pretighten()
    programme = ramp_of(rig, 4)
    record_wrench(loop, programme)
    geometry = rig.geometry
    pose = (geometry.reference_position, geometry.reference_rotation)
    times, wrench = programme.wrench
    words = (programme.record, times - programme.record_start_s, wrench)
    assert evaluate_ramp(*words, geometry, 4, *pose, rig.control.rated).line.play < 3e-6


def record_wrench(loop, programme):
    loop.mode = OperatingMode.COMMISSIONING
    loop.controller.excitation = programme

    def take():
        programme.take_wrench(1e-3 * loop._tick, loop.bridge.wrench)
        return programme.done

    loop.run(40.0, take)
    assert programme.done


def test_ramp_without_zeros_moves_nothing(loop, rig):
    programme = ramp_of(rig, 2)
    run_programme(loop, programme)
    assert "not pre-tightened" in programme.fault
    np.testing.assert_array_equal(loop.controller.current, 0.0)
    assert loop.tension.max() == 0.0


@pytest.mark.parametrize("mode", [OperatingMode.STOPPED, OperatingMode.FAULT])
def test_leaving_the_mode_ends_the_programme(loop, rig, mode):
    programme = step_of(rig, 1)
    loop.mode = OperatingMode.COMMISSIONING
    loop.controller.excitation = programme
    loop.run(5.0, lambda: programme.phase == "step")
    loop.run(0.05)
    assert loop.controller.current[1] == -CONFIG.step_current
    loop.mode = mode
    loop.cycle()
    np.testing.assert_array_equal(loop.controller.current, 0.0)
    assert programme.done
    assert mode.name in programme.fault
    # Coming back does not go on with it.
    loop.mode = OperatingMode.COMMISSIONING
    loop.run(0.1)
    np.testing.assert_array_equal(loop.controller.current, 0.0)


def test_gap_in_the_states_ends_the_programme(loop, rig):
    programme = step_of(rig, 1)
    loop.mode = OperatingMode.COMMISSIONING
    loop.controller.excitation = programme
    loop.run(5.0, lambda: programme.phase == "step")
    for _ in range(15):
        loop.card.read()
    loop.cycle()
    assert "no limb state" in programme.fault
    np.testing.assert_array_equal(loop.controller.current, 0.0)


def test_fault_from_outside_ends_the_programme(loop, rig):
    programme = step_of(rig, 1)
    loop.mode = OperatingMode.COMMISSIONING
    loop.controller.excitation = programme
    loop.run(0.1)
    loop.controller.trip(Fault(FaultName.MODE_AGE, "supervisor is silent"))
    loop.cycle()
    assert "supervisor is silent" in programme.fault
    np.testing.assert_array_equal(loop.controller.current, 0.0)


def test_too_much_tension_ends_the_ramp(loop, rig):
    loop.pretighten()
    programme = ramp_of(rig, 5)
    loop.mode = OperatingMode.COMMISSIONING
    loop.controller.excitation = programme
    loop.run(0.1)
    # The platform jumps away, so the bridge believes.
    loop.bridge.set_pose(
        rig.geometry.reference_position + np.array([0.2, 0.0, 0.0]), rig.geometry.reference_rotation
    )
    loop.cycle()
    loop.cycle()
    assert programme.done
    assert "150 N allowed" in programme.fault
    np.testing.assert_array_equal(loop.controller.current, 0.0)


def test_travel_and_time_are_guarded(loop, rig):
    programme = step_of(rig, 1)
    loop.mode = OperatingMode.COMMISSIONING
    loop.controller.excitation = programme
    loop.run(5.0, lambda: programme.phase == "step")
    # The motor runs away.
    loop.card.plant._state["motor_position"][1] -= 2.0 * CONFIG.travel
    loop.run(0.01)
    assert "travelled" in programme.fault
    np.testing.assert_array_equal(loop.controller.current, 0.0)
    programme = step_of(rig, 0, CommissioningConfig(timeout=1.0))
    run_programme(loop, programme)
    assert "not done within 1 s" in programme.fault


def test_motor_that_does_not_move_is_reported(loop, rig):
    loop.card.plant.drive = lambda volts: None
    programme = step_of(rig, 0)
    programme._slow = 0.0
    run_programme(loop, programme)
    assert "not done within" in programme.fault
    with pytest.raises(ShapeError):
        evaluate_step({name: np.zeros(100) for name in ("time", "current", "wound_length")})


def test_commissioned_rig_loads_again(tmp_path, rig):
    results = {2: LimbResult(2, 1.5, 0.33, 0.99, 2300.0, 0.99), 5: LimbResult(5, 1.9, 0.44, 0.99)}
    write_results(tmp_path, rig, results)
    again = load_rig(limbs=tmp_path / "limbs.yaml")
    assert again.limbs == commissioned_rig(rig, results).limbs

    assert again.limbs.gain[2] == 1.5
    assert again.limbs.gain[0] == rig.limbs.gain[0]
    assert again.limbs.stiffness == 2300.0
    gains = read_yaml(tmp_path / "gains.yaml")
    np.testing.assert_allclose(gains["k_I"], [g.integral for g in again.gains.limbs], rtol=1e-5)
    np.testing.assert_allclose(gains["k_P2"], [g.tension for g in again.gains.limbs], rtol=1e-4)
    assert "not commissioned: limbs 1, 2, 4, 5, 7 and 8." in (tmp_path / "limbs.yaml").read_text()


def test_control_knows_the_least_play_of_those_found_if_asked(tmp_path, rig):
    results = {
        limb: LimbResult(limb, stiffness=2200.0, backlash=play)
        for limb, play in ((2, 1.5e-4), (5, 1.8e-4), (6, np.nan))
    }
    known = commissioned_rig(rig, results, know_backlash=True)
    assert (known.limbs.backlash, known.control.preview_delay) == (1.5e-4, 0.0)
    assert commissioned_rig(rig, results).limbs.backlash == 0.0
    assert commissioned_rig(rig, results).control == rig.control
    text = rig_file("control.yaml").read_text()
    for given in (text, text.replace("preview_delay: 0.002", "# none")):
        write_results(tmp_path, rig, results, know_backlash=True, control_text=given)
        again = load_rig(limbs=tmp_path / "limbs.yaml", control=tmp_path / "control.yaml")
        assert again.limbs.backlash == 1.5e-4
        assert again.control == known.control
    assert set((tmp_path / "control.yaml").read_text().splitlines()) >= {text.splitlines()[0]}
    write_results(tmp_path / "unknown", rig, results, control_text=text)
    assert not (tmp_path / "unknown" / "control.yaml").exists()
    nothing = {3: LimbResult(3, 1.5, 0.33)}
    assert commissioned_rig(rig, nothing, know_backlash=True).limbs.backlash == 0.0


def test_projection_on_a_cable(rig, random):
    geometry = rig.geometry
    matrix = structure_matrix(geometry, geometry.reference_position, geometry.reference_rotation)
    tension = random.uniform(0.0, 100.0, 50)
    wrench = tension[:, None] * matrix[:, 3]
    found = cable_tension_by_wrench(matrix, 3, wrench, rig.control.rated)
    np.testing.assert_allclose(found, tension)


def test_ramp_without_wrench_is_reported(rig):
    geometry = rig.geometry
    pose = (geometry.reference_position, geometry.reference_rotation)
    record = {name: np.arange(1000.0) * 1e-3 for name in ("time", "tension", "elongation")}
    empty = (np.zeros(0), np.zeros((0, 6)))
    with pytest.raises(CommissioningError, match="got 0"):
        evaluate_ramp(record, *empty, geometry, 0, *pose, rig.control.rated)
