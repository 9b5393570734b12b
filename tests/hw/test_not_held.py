# SPDX-License-Identifier: Apache-2.0
"""What a bridge says of a platform that hangs on its cables, by its files."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cabols_control.rig import GearConfig
from cabols_hw.safety.config import load_safety
from cabols_hw.safety.not_held import not_held

HANGS = replace(load_safety(), platform_held=False)


def test_no_notice_where_something_holds_the_platform(rig, card):
    assert not_held(rig, load_safety(), card) is None


@pytest.mark.parametrize(
    ("gear", "told"),
    [
        (None, "does not say what the gears do"),
        (GearConfig(self_locking=True), "all gears hold 150 N"),
        (GearConfig(friction_current=0.03, load_current=2e-4), "8 of 8 gears do not hold 150 N"),
    ],
)
def test_tells_what_gears_do_and_refuses_whatever_they_do(rig, card, gear, told):
    """Gears that hold are one condition of several."""
    notice = not_held(replace(rig, limbs=replace(rig.limbs, gear=gear)), HANGS, card)
    assert notice.name == "not_held"
    assert told in notice.reason
    assert "robot or a stand" in notice.reason


def test_tells_that_the_mass_is_missing(rig, card):
    assert "no tool_mass" in not_held(rig, HANGS, replace(card, tool_mass=0.0)).reason
