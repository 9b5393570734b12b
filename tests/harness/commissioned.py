# SPDX-License-Identifier: Apache-2.0
"""A rig whose files are wrong, commissioned: by its own ramps, on its own plant and sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cabols_control.commissioning.programmes import CommissioningConfig
from cabols_control.commissioning.results import LimbResult, commissioned_rig, evaluate_ramp
from cabols_control.commissioning.rig_programmes import make_ramp
from cabols_control.rig import Rig
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.card.config import CardConfig
from cabols_sim.plant.closed_loop import Mismatch
from cabols_sim.plant.config import PlantConfig
from one_process import OneProcess

RAMP_S = 60.0


def commission_ramps(
    rig: Rig, card: CardConfig, plant: PlantConfig, wrong: Mismatch, seed: int
) -> Rig:
    """Run a ramp of each limb; return the rig with the k_e and the play that came of them.

    Motors' gains and time constants stay as the files say.

    Args:
        rig: as its files say.
        card: likewise.
        plant: true physics.
        wrong: true geometry, and what the sensor makes of a wrench.
        seed: of noise.
    """
    true_plant = replace(plant)
    true_plant.__dict__["_geometry"] = wrong.geometry
    # Volts that the card takes for the wrong wrench.
    volts = np.linalg.inv(wrong.sensor) @ np.array(card.ft_calibration)
    loop = OneProcess(rig, replace(card, ft_calibration=volts.tolist()), true_plant, seed)
    loop.bridge = Bridge(rig, card)
    loop.run(0.3)
    loop.pretighten()
    pose = rig.geometry.reference_position, rig.geometry.reference_rotation
    results = {limb: _ramp(loop, rig, limb, pose) for limb in range(rig.geometry.cables)}
    return commissioned_rig(rig, results, know_backlash=True)


def _ramp(loop, rig, limb, pose):
    programme = make_ramp(rig, limb, CommissioningConfig(), *pose)
    loop.mode = OperatingMode.COMMISSIONING
    loop.controller.excitation = programme

    def take():
        programme.take_wrench(1e-3 * loop._tick, loop.bridge.wrench)
        return programme.done

    loop.run(RAMP_S, take)
    assert programme.done
    assert not programme.fault, programme.fault
    stamps, wrench = programme.wrench
    words = (programme.record, stamps - programme.record_start_s, wrench)
    found = evaluate_ramp(*words, rig.geometry, limb, *pose, rig.control.rated)
    loop.mode = OperatingMode.PRETIGHTENING
    loop.run(0.5)
    return LimbResult(limb, stiffness=found.line.stiffness, backlash=found.line.play)
