# SPDX-License-Identifier: Apache-2.0
"""First power-on: swaps of motors, encoders, switches, cables and gauges are told by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cabols_control.commissioning.first_power_on import (
    CURRENT_A,
    TRAVEL_M,
    PowerOnProgramme,
    WiringFault,
    judge_limb,
)
from cabols_control.commissioning.power_on_record import (
    configuration_hash,
    has_passed,
    passed_limbs,
    save_passed,
)
from cabols_control.kinematics import structure_matrix
from cabols_control.rig_folder import find_rig
from cabols_control.supervision.modes import OperatingMode
from cabols_sim.plant.miswiring import Miswiring
from one_process import OneProcess

SLACK_M = 0.0015


def checked(rig, card, plant_config, limb, wiring=None, seed=3):
    """What the check of a limb finds on a rig with a wiring, and how far it went."""
    limbs = replace(plant_config.limbs, initial_slack=SLACK_M, slack_spread=0.0005)
    loop = OneProcess(rig, card, replace(plant_config, limbs=limbs), seed)
    loop.plant.wiring = wiring
    loop.run(0.3)
    before = loop.bridge.wound_length.copy()
    programme = PowerOnProgramme(limb, rig.geometry.cables)
    loop.mode = OperatingMode.COMMISSIONING
    loop.controller.excitation = programme
    farthest, largest = 0.0, 0.0

    def take():
        nonlocal farthest, largest
        programme.take_wrench(loop.now_s, loop.bridge.wrench)
        farthest = max(farthest, float(np.abs(loop.bridge.wound_length - before).max()))
        largest = max(largest, float(np.abs(loop.controller.current).max()))
        assert np.count_nonzero(loop.controller.current) <= 1
        return programme.done

    tension = loop.run(45.0, take)
    assert programme.done
    assert not programme.fault
    geometry = rig.geometry
    pose = geometry.reference_position, geometry.reference_rotation
    turn = np.kron(np.eye(2), geometry.reference_rotation)
    rated = np.asarray(rig.control.rated)
    structure = structure_matrix(geometry, *pose)
    found = judge_limb(
        limb, programme.moved, programme.closed, turn @ programme.pull, structure, rated
    )
    assert largest <= CURRENT_A + 1e-12
    assert farthest < TRAVEL_M + 0.002
    assert tension.max() < 45.0
    return found


@pytest.mark.parametrize("limb", range(8))
def test_right_wiring_passes(rig, card, plant_config, limb):
    assert checked(rig, card, plant_config, limb).fault == WiringFault.NONE


EXPECTED = {
    "motors_exchanged": {WiringFault.MOTORS_EXCHANGED, WiringFault.OTHER_LIMB_MOVES},
    "encoders_exchanged": {WiringFault.ENCODERS_EXCHANGED, WiringFault.OTHER_LIMB_MOVES},
    "switches_exchanged": {WiringFault.SWITCHES_EXCHANGED},
    "channels_exchanged": {WiringFault.CABLES_EXCHANGED},
    "motor_reversed": {WiringFault.REVERSED},
    "encoder_reversed": {WiringFault.ENCODER_REVERSED, WiringFault.REVERSED},
    "both_reversed": {WiringFault.NOT_TIGHT},
    "motor_dead": {WiringFault.NOTHING_MOVES},
    "encoder_dead": {WiringFault.ENCODER_DEAD, WiringFault.NOTHING_MOVES},
    "gauges_exchanged": {WiringFault.GAUGES, WiringFault.CABLES_EXCHANGED},
    "gauges_reversed": {WiringFault.GAUGES, WiringFault.CABLES_EXCHANGED},
}


@pytest.mark.parametrize("kind", EXPECTED)
@pytest.mark.parametrize("pair", [(0, 1), (2, 7), (5, 3)])
def test_wrong_wiring_is_told(rig, card, plant_config, kind, pair):
    limb, other = pair
    found = checked(rig, card, plant_config, limb, Miswiring.of(kind, limb, other))
    assert found.fault in EXPECTED[kind], found
    if "exchanged" in kind and "gauges" not in kind:
        assert found.partner == other
        assert "limb" in found.told(limb)


def test_two_gauges_exchanged_are_found_by_some_limb(rig, card, plant_config):
    """Two gauges that one cable's pull does not tell apart are told by another's."""
    wiring = Miswiring(gauges=np.eye(6)[[1, 0, 2, 3, 4, 5]])
    found = [checked(rig, card, plant_config, limb, wiring).fault for limb in range(8)]
    assert any(fault != WiringFault.NONE for fault in found)


def test_record_holds_for_its_configuration_alone(tmp_path):
    folder = find_rig()
    path = tmp_path / "state" / "passed.json"
    assert not has_passed(folder, 8, path)
    save_passed(path, configuration_hash(folder), range(7))
    assert not has_passed(folder, 8, path)
    save_passed(path, configuration_hash(folder), range(8))
    assert has_passed(folder, 8, path)
    assert passed_limbs(path, "another") == frozenset()
    for damage in ("", "{", "[]", '{"form": 1}', '{"form": 1, "configuration": 3, "limbs": "x"}'):
        path.write_text(damage)
        assert not has_passed(folder, 8, path)
