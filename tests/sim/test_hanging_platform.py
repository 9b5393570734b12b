# SPDX-License-Identifier: Apache-2.0
"""A platform on its cables alone as the amplifiers go off: what the files' gears say comes true."""

from __future__ import annotations

import pytest

from hanging_rig import GEARS, KINDS, hanging, let_go

HOLD = ("self-locking", "friction of the bench")


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "cable breaks"])
@pytest.mark.parametrize("name", GEARS)
def test_sinks_no_faster_than_its_gears_allow(rig, card, plant_config, name, kind):
    """Through the plant's limbs and cables, against the bound from limbs.yaml's numbers."""
    gear = GEARS[name]
    bench = hanging(rig, card, plant_config, gear)
    assert bench.plant.tension.min() > 5.0
    fall = let_go(bench, kind, gear)
    if name in HOLD:
        assert fall.bound == 0.0
        assert fall.sank < fall.slack
        assert fall.speed < 2.0 * fall.slack
    else:
        # It does sink, so that the bound could fail; the cables' stretch comes on top.
        assert fall.sank > 0.005
        assert 0.2 * fall.bound < fall.speed < fall.bound
    assert fall.tension < 60.0


def test_friction_that_the_file_exaggerates_breaks_the_bound(rig, card, plant_config):
    """What a wrong limbs.yaml does: the bound is as good as its numbers."""
    gear = GEARS["gives way"]
    fall = let_go(
        hanging(rig, card, plant_config, gear),
        "supply lost",
        {"coulomb_current": 0.1, "load_current": 1e-3},
    )
    assert fall.speed > fall.bound == 0.0


@pytest.mark.parametrize("limb", [1, 4])
def test_no_gear_bounds_the_fall_of_a_platform_that_lost_a_cable(rig, card, plant_config, limb):
    """Others catch it, but without an upper one it falls first: gears that lock do not slow it."""
    gear = GEARS["self-locking"]
    bench = hanging(rig, card, plant_config, gear)
    bearing = bench.plant.tension[limb] > 20.0
    fall = let_go(bench, "cable breaks", gear, limb=limb)
    assert (fall.fastest > 0.5) == bearing
    assert (fall.sank > 0.1) == bearing
    assert fall.tension < 150.0
