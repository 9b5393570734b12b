# SPDX-License-Identifier: Apache-2.0
"""The plant's physics: equilibrium, energy, friction, backlash, spring; converters and switches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cabols_control.kinematics import structure_matrix
from cabols_control.limb import LimbModel, step_response
from cabols_hw.card.config import ENCODER_MODULUS
from cabols_sim.plant.limb_physics import LIMB_STATE, cable_tension, limb_step
from cabols_sim.plant.plant import Plant

DT = 0.00025


def limbs(plant_config, **changes):
    return replace(plant_config.limbs, **changes)


def push(table, current, steps, state=None, rest=0.0, length=0.0):
    """Run one limb; returns (steps, 3) states and (steps,) tensions."""
    state = np.array([state or (0.0, 0.0, 0.0)], LIMB_STATE)
    tension, states, tensions = np.zeros(1), [], []
    for k in range(steps):
        i = np.array([current(k) if callable(current) else current])
        limb_step(table, state, i, np.array([rest]), np.array([length]), DT, tension)
        states.append(list(state[0]))
        tensions.append(tension[0])
    return np.array(states), np.array(tensions)


def test_free_motor_is_the_identified_model(plant_config):
    table = plant_config.linear().limbs.parameters[:1]
    states, _ = push(table, 0.5, 4000, rest=100.0)
    time = np.arange(4001) * DT
    expected = step_response(LimbModel(0.853, 0.3564), time, np.full(4001, 0.5))[1:]
    # Trapezoidal position over exact speed: error below dt^2 / 12 T^2 of the motion.
    np.testing.assert_allclose(states[:, 0], expected, rtol=1e-6, atol=1e-9)


def test_dry_friction_holds_the_motor(plant_config):
    table = limbs(plant_config, coulomb_current=0.1, load_current=0.0).parameters[:1]
    states, _ = push(table, 0.0999, 2000, rest=100.0)
    np.testing.assert_array_equal(states[:, :2], 0.0)
    states, _ = push(table, 0.11, 2000, rest=100.0)
    assert states[-1, 0] > 0.0


def test_friction_never_drives(plant_config):
    """A coasting motor comes to rest and stays there."""
    table = limbs(plant_config, coulomb_current=0.05).parameters[:1]
    states, _ = push(table, 0.0, 20000, (0.0, 0.2, 0.0), rest=100.0)
    assert (np.diff(np.abs(states[:, 1])) <= 0.0).all()
    assert states[-1, 1] == 0.0


def test_backlash_is_a_play(plant_config):
    width = 0.002
    table = limbs(plant_config, backlash=width, coulomb_current=0.0).parameters[:1]
    states, _ = push(table, lambda k: 0.5 if k < 2000 else -0.5, 6000, rest=100.0)
    gap = states[:, 0] - states[:, 2]
    assert np.abs(gap).max() == pytest.approx(width / 2)
    turn = int(np.argmax(states[:, 0]))
    crossing = states[turn, 0] - width
    still = (np.arange(6000) > turn) & (states[:, 0] > crossing)
    assert np.ptp(states[still, 2]) < 1e-12, "the pulley stands still while the gap is crossed"


def test_spring_and_cable_in_series(plant_config):
    row = plant_config.limbs.parameters[0]
    length = 1.42
    cable = row["cable_compliance_fixed"] + row["cable_compliance_per_metre"] * length
    for tension in (0.2, 0.49, 0.51, 5.0, 150.0):
        beyond = max(tension - row["spring_initial_tension"], 0.0)
        stretch = tension * cable + beyond * row["spring_compliance"]
        assert cable_tension(stretch, length, row) == pytest.approx(tension)
    assert cable_tension(0.0, length, row) == 0.0
    assert cable_tension(-1.0, length, row) == 0.0
    # Section 3.4.1: 2.20 N/mm with the spring, 10.72 N/mm without.
    slope = (cable_tension(0.03, length, row) - cable_tension(0.02, length, row)) / 0.01
    assert slope == pytest.approx(2200.0, rel=0.01)
    bare = plant_config.without_springs().limbs.parameters[0]
    assert cable_tension(0.01, length, bare) / 0.01 == pytest.approx(10720.0, rel=0.01)


def test_spring_that_ends_leaves_the_cable_alone(plant_config):
    row = limbs(plant_config, spring_end_tension=150.0).parameters[0]
    endless, length = plant_config.limbs.parameters[0], 1.42
    cable = row["cable_compliance_per_metre"] * length
    end = 150.0 * cable + 149.5 * row["spring_compliance"]
    assert cable_tension(end, length, row) == pytest.approx(150.0)
    assert cable_tension(0.9 * end, length, row) == cable_tension(0.9 * end, length, endless)
    assert cable_tension(end + 0.01, length, row) == pytest.approx(150.0 + 0.01 / cable)


@pytest.mark.parametrize("locks", [False, True])
def test_gear_that_locks_is_not_turned_by_the_pull(plant_config, locks):
    table = limbs(
        plant_config, coulomb_current=0.0, load_current=0.01, backlash=0.0, self_locking=locks
    ).parameters[:1]
    states, _ = push(table, 0.0, 4000, (0.04, 0.0, 0.04), rest=1.42, length=1.42)
    assert (states[-1, 0] == 0.04) == locks
    # Stall: the pull takes all of the current; a gear that locks keeps what momentum added.
    _, tensions = push(table, 0.6, 40000, rest=1.42, length=1.42)
    stall = tensions.max() if locks else 60.0
    assert tensions[-1] == pytest.approx(stall, rel=0.02)
    assert tensions[-1] > 59.0


def test_cable_beyond_its_strength_parts(rig, card, plant_config):
    weak = replace(plant_config, limbs=limbs(plant_config, break_tension=50.0))
    plant = Plant(rig, card, weak, seed=1)
    plant.drive(np.full(8, 1.0))
    highest = np.zeros(8)
    for _ in range(1500):
        plant.advance(1e-3)
        highest = np.maximum(highest, plant.tension)
    assert highest.max() <= 50.0
    assert not plant.tension.any(), "all have parted"


def test_longer_cable_is_softer(plant_config):
    row = plant_config.limbs.parameters[0]
    assert cable_tension(0.01, 2.0, row) < cable_tension(0.01, 1.0, row)


def test_load_through_the_gear_takes_current(plant_config):
    held = limbs(plant_config, coulomb_current=0.0, load_current=0.001, backlash=0.0).parameters[:1]
    # 0.1 A balance 100 N: the tension settles there.
    _, tension = push(held, 0.1, 400_000, rest=0.0, length=1.42)
    assert tension[-1] == pytest.approx(100.0, rel=1e-3)


def test_wrench_is_the_structure_matrix_times_tension(rig, card, plant_config):
    plant = Plant(rig, card, plant_config, seed=3)
    for _ in range(400):
        plant.drive(np.full(8, 1.0))
        plant.advance(0.001)
    matrix = structure_matrix(
        rig.geometry, rig.geometry.reference_position, rig.geometry.reference_rotation
    )
    assert plant.tension.min() > 1.0
    np.testing.assert_allclose(plant.wrench, matrix @ plant.tension, atol=1e-9)


def test_gauges_carry_the_wrench_through_the_calibration(rig, card, plant_config):
    quiet = replace(plant_config, sensors=replace(plant_config.sensors, gauge_noise=0.0))
    plant = Plant(rig, card, quiet, seed=3)
    before = plant.sense()[1]
    plant.drive(np.full(8, 0.3))
    while plant.tension.max() < 20.0:
        plant.advance(0.001)
    measured = card.ft_matrix @ (plant.sense()[1] - before)
    # Two ADC steps through the calibration's rows.
    step = np.abs(card.ft_matrix).sum(axis=1) * quiet.sensors.adc_step
    assert (np.abs(measured - plant.wrench) <= step).all()


def test_encoder_wraps_at_24_bits(rig, card, plant_config):
    plant = Plant(rig, card, plant_config)
    plant._state["motor_position"][0] = (ENCODER_MODULUS // 2 + 5.5) / card.counts_per_metre
    assert plant.sense()[0][0] == -ENCODER_MODULUS // 2 + 5


def test_switch_closes_and_opens_with_hysteresis(rig, card, plant_config):
    plant = Plant(rig, card, plant_config)
    seen = []
    for tension in (4.6, 4.7, 4.5, 4.41, 4.39, 4.6):
        plant.tension[:] = tension
        seen.append(not plant.sense()[2][0])
    assert seen == [False, True, True, True, False, False]


def test_amplifier_and_converter_limits(rig, card, plant_config):
    plant = Plant(rig, card, plant_config)
    plant.drive(np.full(8, 50.0))
    assert plant.current.max() == pytest.approx(3.82)
    plant.drive(np.full(8, 0.0020))
    np.testing.assert_array_equal(plant.current, 0.0)
    plant.drive(np.full(8, 0.0030))
    np.testing.assert_allclose(plant.current, plant_config.sensors.dac_step * 0.4)


def test_same_seed_same_rig(rig, card, plant_config):
    one, two, other = (Plant(rig, card, plant_config, seed) for seed in (5, 5, 6))
    first, second, third = (plant.sense()[1] for plant in (one, two, other))
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, third)
