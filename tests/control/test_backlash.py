# SPDX-License-Identifier: Apache-2.0
"""The limb law allows for the play of a gear: against an own model of play, and in the loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cabols_control.limb_control.records import LIMB
from cabols_control.limb_control.references import follow_backlash
from cabols_control.load_programs.motor_demand import fastest_preview
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import load_rig
from cabols_hw.card.config import load_card
from cabols_sim.plant.closed_loop import simulate
from cabols_sim.plant.config import load_plant

PLAY = 2e-4


def test_a_play_is_followed_as_a_gear_has_it():
    """Teeth: the driven side stands until a flank of the driving one touches it."""
    limb = np.zeros(1, LIMB)[0]
    limb["backlash"] = PLAY
    random = np.random.default_rng(2)
    wound, driven = 0.0, 0.0
    for step in random.normal(0.0, 8e-5, 4000) + 2e-5 * np.sin(np.arange(4000) / 200.0):
        wound += step
        if wound - driven > PLAY / 2:
            driven = wound - PLAY / 2
        elif driven - wound > PLAY / 2:
            driven = wound + PLAY / 2
        more = follow_backlash(limb, wound)
        assert -1e-15 <= more <= PLAY + 1e-15
        # Where a motor winds in nothing is missing: zeros are set there.
        assert more == pytest.approx(PLAY / 2 - (wound - driven), abs=1e-12)


def test_without_play_nothing_changes_and_what_is_not_finite_stays_outside():
    limb = np.zeros(1, LIMB)[0]
    assert follow_backlash(limb, 0.3) == 0.0
    limb["backlash"] = PLAY
    assert follow_backlash(limb, 0.3) == pytest.approx(0.0)
    for bad in (np.nan, np.inf):
        assert follow_backlash(limb, bad) == 0.0
    assert limb["pulley"] == pytest.approx(0.3 - PLAY / 2)


@pytest.mark.parametrize("backlash", [-1e-5, 2e-3, float("nan")])
def test_a_play_that_is_none_is_refused(backlash):
    limbs = load_rig().limbs
    with pytest.raises(ValueError, match="backlash"):
        replace(limbs, backlash=backlash)


def test_a_known_play_leaves_less_error():
    """Three quarters of the plant's 0.2 mm: a slow sine is followed at least twice as well."""
    rig, time = load_rig(), np.arange(0.0, 4.0, 0.001)
    wrench = np.zeros((time.size, 6))
    fade = np.clip(np.minimum(time, 4.0 - time), 0.0, 1.0)
    wrench[:, 3] = 8.0 * fade * np.sin(np.pi * time)
    program = LoadProgram("sine", time, wrench, held=False)
    place = rig.geometry.reference_position, rig.geometry.reference_rotation
    shaped = fastest_preview(program, rig, *place)
    desired = np.vstack([np.zeros((1000, 6)), shaped.reference.wrench])
    rms = []
    for backlash in (0.0, 0.75 * PLAY):
        known = replace(rig, limbs=replace(rig.limbs, backlash=backlash))
        trace = simulate(known, load_card(), load_plant(), desired)
        felt = trace.measured[1000:] - trace.measured[500:1000].mean(axis=0)
        rms.append(np.sqrt(np.mean((felt - shaped.smoothed.wrench)[:, 3] ** 2)))
    assert rms[1] < 0.5 * rms[0]
