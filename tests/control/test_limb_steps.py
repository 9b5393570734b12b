# SPDX-License-Identifier: Apache-2.0
"""The limb controller's answers to random sequences, to the bit those of version 0.1."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cabols_control.limb_control.controller import LimbController, LimbSample, TensionSetpoint
from cabols_control.supervision.modes import OperatingMode
from limb_sequences import answers

STORED = Path(__file__).parents[1] / "data/limb_steps_of_0_1.npz"
MODES = {mode.name: mode for mode in OperatingMode}
SUBSET = [2, 5, 7]
MENDED = {("all", 5): 13}
"""Sequences in which a number that was not finite kept version 0.1 from FREE_MOVING for ever, also
after STOPPED: from this step on other answers are right."""


def answers_of(rig, limbs, seed):
    return answers(
        lambda chosen: LimbController(rig, chosen),
        lambda stamp_s, arrays: LimbSample(stamp_s, **arrays),
        TensionSetpoint,
        MODES,
        limbs,
        seed,
    )


@pytest.mark.parametrize(
    ("name", "limbs", "first", "count"), [("all", None, 0, 9), ("subset", SUBSET, 9, 3)]
)
def test_every_current_is_the_one_of_0_1(rig, name, limbs, first, count):
    """All modes, faults, gaps, clocks set back, programmes, numbers that are not finite."""
    with np.load(STORED) as stored:
        taken = []
        for k in range(count):
            found = answers_of(rig, limbs, first + k)
            end = MENDED.get((name, k))
            for field in ("current", "saturated", "fault", "unloaded"):
                expected = stored[f"{name}_{field}"][k][:end]
                np.testing.assert_array_equal(found[field][:end], expected, err_msg=f"{field}, {k}")
            assert np.abs(found["current"]).max() <= rig.control.current_limit
            taken.append(found["taken"])
        last = max((k for this, k in MENDED if this == name), default=-1)
        first_ones, last_ones = taken[: max(last, 0)], taken[last + 1 :]
        for part, at in ((first_ones, slice(None)), (last_ones, slice(None, None, -1))):
            if part:
                expected, ours = stored[f"{name}_taken"][at], np.concatenate(part)[at]
                np.testing.assert_array_equal(ours, expected[: ours.size])


def test_the_stored_sequences_go_everywhere():
    with np.load(STORED) as stored:
        current = stored["all_current"]
        assert (current != 0.0).mean() > 0.4
        assert 0.2 < stored["all_saturated"].mean() < 0.6
        assert 0.1 < stored["all_fault"].mean() < 0.5
        assert stored["all_unloaded"].sum() > 50
        assert np.unique(stored["all_taken"]).size > 200
