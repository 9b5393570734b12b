# SPDX-License-Identifier: Apache-2.0
"""Numbers against each other: each of people's mistakes is found, good rigs are left alone."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
import yaml

from cabols_control.configuration import load_config
from cabols_control.errors import ConfigError
from cabols_control.geometry import load_geometry
from cabols_control.rig import load_rig
from cabols_control.rig_checks import RigWarning, check_limits, check_mounted
from cabols_control.rig_folder import find_rig, rig_file
from cabols_hw.card.config import load_card
from cabols_hw.card.wiring import Wiring
from cabols_hw.safety.config import load_safety
from cabols_sim.plant.card import SimulatedQ8
from cabols_sim.plant.plant import Plant

GOOD = yaml.safe_load(rig_file("geometry.yaml").read_text())


def mm(rows):
    return (1000.0 * np.array(rows)).tolist()


def written(tmp_path, **changes):
    path = tmp_path / "geometry.yaml"
    path.write_text(yaml.safe_dump({**GOOD, **changes}))
    return path


POSE_MM = {**GOOD["reference_pose"], "position": mm(GOOD["reference_pose"]["position"])}
POINTS = ("base_points", "platform_points")
TWICE = {
    key: [*GOOD[key][:3], GOOD[key][2], *GOOD[key][4:]]
    for key in ("base_points", "platform_points")
}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"platform_points": mm(GOOD["platform_points"])}, "smaller than the frame.*millimetres"),
        (
            {"base_points": GOOD["platform_points"], "platform_points": GOOD["base_points"]},
            "smaller than the frame.*swapped",
        ),
        (TWICE, "limb 3 and limb 4 between the same points"),
        ({"base_points": mm(GOOD["base_points"])}, "a frame of 1.8e\\+03 m; millimetres"),
        ({"reference_pose": POSE_MM}, "expected the platform in its frame"),
    ],
)
def test_geometry_that_cannot_be_is_refused_with_what_was_read(tmp_path, changes, message):
    with pytest.raises(ConfigError, match=message) as caught:
        load_geometry(written(tmp_path, **changes))
    assert "read: frame" in str(caught.value)
    assert "cables of" in str(caught.value)
    assert len(str(caught.value)) < len(str(tmp_path)) + 700


def test_all_in_millimetres_is_refused(tmp_path):
    everything = {key: mm(GOOD[key]) for key in POINTS}
    with pytest.raises(ConfigError, match="millimetres"):
        load_geometry(written(tmp_path, **everything, reference_pose=POSE_MM))


def test_a_large_frame_is_warned_of(tmp_path):
    large = {
        key: (80.0 * np.array(GOOD[key])).tolist() for key in ("base_points", "platform_points")
    }
    pose = {
        **GOOD["reference_pose"],
        "position": (80.0 * np.array(GOOD["reference_pose"]["position"])).tolist(),
    }
    with pytest.warns(RigWarning, match="a frame of 144 m; is that in metres.*read: frame"):
        load_geometry(written(tmp_path, **large, reference_pose=pose))


def test_good_rigs_are_left_alone():
    with warnings.catch_warnings():
        warnings.simplefilter("error", RigWarning)
        rig, safety, card = load_rig(), load_safety(), load_card()
        load_geometry(rig_file("geometry_designed.yaml"))
    findings = check_limits(
        rig.control.tension_max,
        safety.tension_max,
        np.array(safety.wrench_max),
        rig.control.rated,
        card.sensor_limits,
    )
    assert (findings.refused, findings.odd) == ([], [])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stiffness": 2.2}, r"expected N/m, got 2\.2, by which 150 N stretch.*N/mm"),
        ({"gain": [853.0] * 8}, "mm/s/A"),
    ],
)
def test_limbs_in_other_units_are_refused(tmp_path, changes, message):
    content = yaml.safe_load(rig_file("limbs.yaml").read_text())
    path = tmp_path / "limbs.yaml"
    path.write_text(yaml.safe_dump({**content, **changes}))
    with pytest.raises(ConfigError, match=message):
        load_rig(limbs=path)


def test_odd_stiffness_is_warned_of(tmp_path):
    content = yaml.safe_load(rig_file("limbs.yaml").read_text())
    path = tmp_path / "limbs.yaml"
    path.write_text(yaml.safe_dump({**content, "stiffness": 300.0}))
    with pytest.warns(RigWarning, match="stiffness: 300 N/m"):
        load_rig(limbs=path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"safety_tension_max": 900.0}, "tension_max: expected at most control's 150 N"),
        ({"safety_tension_max": float("nan")}, "tension_max"),
        ({"sensor_range": np.full(6, 100.0)}, "wrench_max: expected at most the sensor's range"),
        ({"rated": np.full(6, 500.0)}, "force_rated"),
    ],
)
def test_limits_that_disagree(changes, message):
    rig, safety, card = load_rig(), load_safety(), load_card()
    values = {
        "tension_max": rig.control.tension_max,
        "safety_tension_max": safety.tension_max,
        "safety_wrench_max": np.array(safety.wrench_max),
        "rated": rig.control.rated,
        "sensor_range": card.sensor_limits,
    }
    with pytest.raises(ConfigError, match=message):
        check_limits(**{**values, **changes}).settle("rig")


def test_reflectors_in_millimetres():
    assert check_mounted("reflectors", np.array([[70.0, 120.0, -20.0]]), 0.15).odd


def test_another_number_of_limbs_ends_before_any_kernel(rig, card, plant_config):
    seven = load_geometry()
    seven = replace(
        seven, base_points=seven.base_points[1:], platform_points=seven.platform_points[1:]
    )
    short = replace(rig.limbs, gain=rig.limbs.gain[1:], time_constant=rig.limbs.time_constant[1:])
    lab = replace(rig, geometry=seven, limbs=short)
    with pytest.raises(ConfigError, match="expected 7 values as the geometry has cables, got 8"):
        Plant(lab, card, plant_config)
    limbs = replace(plant_config.limbs, gain=short.gain, time_constant=short.time_constant)
    plant = Plant(lab, card, replace(plant_config, limbs=limbs))
    with pytest.raises(ConfigError, match="expected 7 channels as the geometry has cables, got 8"):
        SimulatedQ8(plant, card, 7, lockstep=True)


def test_ten_limbs_need_a_second_card():
    ten = list(range(10))
    with pytest.raises((ConfigError, ValueError), match="10 encoders need a second one"):
        Wiring(encoders=ten, switches=ten, motors=ten, enables=[12])
    with pytest.raises(ConfigError, match="10 motors need a second one"):
        Wiring().require_limbs(10)


SECOND = [{"card": 1, "channel": 0}, {"card": 1, "channel": 1}]
TEN = [*range(8), *SECOND]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"enables": [8]}, "got none of card 1"),
        ({"gauges": [0, 1, 2, 3, 4, {"card": 1, "channel": 0}]}, "all on one card"),
        ({"motors": [*range(8), {"card": 2, "channel": 0}, 0]}, "cards 0 to 1"),
        ({"motors": [*range(8), SECOND[0], SECOND[0]]}, "each channel once"),
        ({"enables": [8, SECOND[0]]}, "switches already"),
    ],
)
def test_wiring_of_two_cards(tmp_path, changes, message):
    wiring = {
        "gauges": list(range(6)),
        "encoders": TEN,
        "switches": TEN,
        "motors": TEN,
        "enables": [8, {"card": 1, "channel": 8}],
    }
    path = tmp_path / "wiring.yaml"
    path.write_text(yaml.safe_dump(wiring))
    good = load_config(Wiring, path)
    assert (good.limbs, good.cards) == (10, 2)
    assert good.channels("motors") == [*range(8), 0, 1]
    path.write_text(yaml.safe_dump({**wiring, **changes}))
    with pytest.raises(ConfigError, match=message):
        load_config(Wiring, path)


def test_a_rig_is_found_by_name_path_and_home(tmp_path, monkeypatch):
    (tmp_path / "lab").mkdir()
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    for name in ("lab", "./lab", str(tmp_path / "lab"), "~/lab"):
        assert find_rig(name).path == tmp_path / "lab"
    assert find_rig().path == find_rig("bench").path
    (tmp_path / "file").write_text("")
    for name, message in (("lub", "nothing there"), ("file", "got a file"), ("~nobody/x", "rig")):
        with pytest.raises(ConfigError, match=message):
            find_rig(name)
    with pytest.raises(ConfigError, match=r"expected geometry\.yaml, got nothing"):
        load_rig("lab")
