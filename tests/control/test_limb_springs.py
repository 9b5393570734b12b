# SPDX-License-Identifier: Apache-2.0
"""k_e of each limb and by the cable's length: what a rig's file says, and what it must not say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from cabols_control.commissioning.results import LimbResult, commissioned_rig, write_results
from cabols_control.errors import ConfigError
from cabols_control.kinematics import cable_lengths
from cabols_control.limb_control.records import limb_control_work
from cabols_control.rig import load_rig
from cabols_control.rig_folder import rig_file

EACH = [2200.0, 1900.0, 2500.0, 2300.0, 2100.0, 2050.0, 2400.0, 1800.0]
AXIAL_N = 15267.0


def written(folder, **keys):
    content = yaml.safe_load(rig_file("limbs.yaml").read_text("utf-8")) | keys
    path = folder / "limbs.yaml"
    path.write_text(yaml.safe_dump(content), "utf-8")
    return path


def test_one_number_and_eight_equal_ones_are_the_same_rig(tmp_path):
    one, each = load_rig(), load_rig(limbs=written(tmp_path, stiffness=[2200.0] * 8))
    assert one.gains == each.gains
    np.testing.assert_array_equal(one.springs.nominal, each.springs.nominal)


def test_gains_make_all_limbs_alike(tmp_path):
    """(3.27): the loop's gain k_P2 k_e is the same for all, whatever each spring is."""
    rig = load_rig(limbs=written(tmp_path, stiffness=EACH))
    one = load_rig()
    by_limb = [limb.tension * k_e for limb, k_e in zip(rig.gains.limbs, EACH, strict=True)]
    np.testing.assert_allclose(by_limb, one.gains.limbs[0].tension * 2200.0)
    assert [limb.integral for limb in rig.gains.limbs] == [
        limb.integral for limb in one.gains.limbs
    ]


def test_a_driven_limb_has_its_own_stiffness(tmp_path):
    rig = load_rig(limbs=written(tmp_path, stiffness=EACH))
    records = limb_control_work(rig, [5, 2])["limbs"][0]
    np.testing.assert_array_equal(records["stiffness"], [EACH[5], EACH[2]])


@settings(max_examples=30)
@given(st.floats(300.0, 5000.0), st.floats(1.01, 100.0), st.floats(0.5, 3.0), st.floats(0.2, 4.0))
def test_stiffness_by_length_is_springs_in_series(k_e, share, reference, length):
    """Second opinion: pulled by 1 N, the lengths by which spring and cable give way add up."""
    limbs = replace(load_rig().limbs, stiffness=k_e, axial_stiffness=share * k_e * reference)
    springs = limbs.springs(np.full(8, reference))
    np.testing.assert_allclose(springs.stiffness(np.full(8, reference)), k_e, rtol=1e-12)
    axial = share * k_e * reference
    spring_gives = 1.0 / k_e - reference / axial
    cable_gives = length / axial
    found = springs.stiffness(np.full(8, length))
    np.testing.assert_allclose(1.0 / found, spring_gives + cable_gives, rtol=1e-9)


@pytest.mark.parametrize(
    ("keys", "match"),
    [
        ({"stiffness": EACH[:7]}, "stiffness: expected one number, or 8 as in gain, got 7"),
        ({"stiffness": [*EACH[:7], 0.0]}, "stiffness of limb 8"),
        ({"stiffness": [*EACH[:7], float("nan")]}, "stiffness of limb 8"),
        ({"stiffness": [*EACH[:7], "2200"]}, "stiffness"),
        ({"stiffness": "soft"}, "stiffness"),
        ({"stiffness": [EACH]}, "stiffness"),
        ({"stiffness": []}, "stiffness"),
        ({"stiffness": float("inf")}, "stiffness"),
        ({"axial_stiffness": [AXIAL_N] * 9}, "axial_stiffness: expected one number, or 8"),
        ({"axial_stiffness": -1.0}, "axial_stiffness"),
        ({"axial_stiffness": 1500.0}, "axial_stiffness of limb 1: expected at least"),
    ],
)
def test_what_no_limb_can_be_is_refused(tmp_path, keys, match):
    with pytest.raises(ConfigError, match=match):
        _ = load_rig(limbs=written(tmp_path, **keys)).springs


def test_commissioning_gives_each_limb_its_own(tmp_path):
    rig = load_rig(limbs=written(tmp_path, stiffness=EACH, axial_stiffness=AXIAL_N, backlash=1e-4))
    results = {2: LimbResult(2, 1.5, 0.33, 0.99, 2300.0, 0.99), 5: LimbResult(5, 1.9, 0.44, 0.99)}
    write_results(tmp_path / "out", rig, results)
    again = load_rig(limbs=tmp_path / "out" / "limbs.yaml")
    assert again.limbs == commissioned_rig(rig, results).limbs
    assert again.limbs.stiffness == [*EACH[:2], 2300.0, *EACH[3:]]
    assert again.limbs.axial_stiffness == AXIAL_N
    assert again.limbs.backlash == 1e-4


def test_lengths_of_the_reference_pose_have_the_files_number(tmp_path):
    rig = load_rig(limbs=written(tmp_path, stiffness=EACH, axial_stiffness=AXIAL_N))
    shape = rig.geometry
    length = cable_lengths(shape, shape.reference_position, shape.reference_rotation)
    np.testing.assert_allclose(rig.springs.stiffness(length), EACH)
    assert (rig.springs.stiffness(length + 0.3) < EACH).all()
