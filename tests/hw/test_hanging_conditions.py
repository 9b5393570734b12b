# SPDX-License-Identifier: Apache-2.0
"""Which rigs may let a platform hang on its cables: each condition by its own sentence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cabols_control.errors import ConfigError
from cabols_control.rig import GearConfig, load_rig
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety
from cabols_hw.safety.hanging_conditions import missing_condition
from cabols_hw.safety.not_held import not_held

RIG, SAFETY, CARD = load_rig("hanging"), load_safety("hanging"), load_card("hanging")


def suspended(**changes):
    return replace(SAFETY, suspension=replace(SAFETY.suspension, **changes))


def controlled(**changes):
    return replace(RIG, control=replace(RIG.control, **changes))


def weighing(mass):
    return replace(RIG, hanging=replace(RIG.hanging, mass=mass))


def geared(**gear):
    return replace(RIG, limbs=replace(RIG.limbs, gear=GearConfig(**gear)))


def test_the_installed_rig_meets_all():
    assert missing_condition(RIG, SAFETY, CARD) == ""
    assert not_held(RIG, SAFETY, CARD) is None
    np.testing.assert_allclose(RIG.hanging.centre, [0.01, -0.01, -0.02])


@pytest.mark.parametrize(
    ("rig", "safety", "card", "said"),
    [
        (RIG, replace(SAFETY, suspension=None), CARD, "no block suspension"),
        (replace(RIG, hanging=None), SAFETY, CARD, "no block suspension"),
        (RIG, SAFETY, replace(CARD, switch_active_low=True), "switch_active_low"),
        (controlled(tension_min=1.0), SAFETY, CARD, "tension_min"),
        (RIG, replace(SAFETY, cable_tension=4.0), CARD, "cable_tension"),
        (RIG, suspended(proof_pull=90.0), CARD, "tension_max of safety.yaml"),
        (RIG, suspended(proof_pull=8.0), CARD, "proof_pull"),
        (replace(RIG, limbs=replace(RIG.limbs, gear=None)), SAFETY, CARD, "does not say"),
        (geared(friction_current=0.002, load_current=2e-3), SAFETY, CARD, "sinking_speed allows"),
        (RIG, suspended(sinking_speed=0.001), CARD, "sinking_speed allows"),
        (weighing(1.0), SAFETY, CARD, "does not prove that the platform stands"),
        (RIG, suspended(net_depth=None), CARD, "no net"),
    ],
)
def test_each_condition_says_what_is_missing(rig, safety, card, said):
    assert said in missing_condition(rig, safety, card)
    assert said in not_held(rig, safety, card).reason


def test_self_locking_gears_need_no_sinking_speed():
    assert missing_condition(geared(self_locking=True), suspended(sinking_speed=1e-4), CARD) == ""


def test_a_search_that_would_lift_is_refused():
    """Light enough that 6 N in four cables lift it, though open switches prove that it stands."""
    light = replace(RIG, hanging=replace(RIG.hanging, mass=1.85, centre=np.zeros(3)))
    assert "may lift" in missing_condition(light, SAFETY, CARD)


@pytest.mark.parametrize(
    "change", [{"proof_pull": "much"}, {"proof_pull": -1.0}, {"proof_pull": None}]
)
def test_a_wrong_block_is_named(tmp_path, change):
    import shutil

    import yaml

    from cabols_control.rig_folder import find_rig

    folder = tmp_path / "rig"
    shutil.copytree(find_rig("hanging").path, folder)
    content = yaml.safe_load((folder / "safety.yaml").read_text("utf-8"))
    content["suspension"] |= change
    (folder / "safety.yaml").write_text(yaml.safe_dump(content), "utf-8")
    with pytest.raises(ConfigError, match="hangs on its cables"):
        load_rig(folder)
