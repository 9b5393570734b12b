# SPDX-License-Identifier: Apache-2.0
"""Rig configuration: limits that cannot be exceeded, files that must agree."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from cabols_control.configuration import load_config
from cabols_control.errors import ConfigError
from cabols_control.rig import ControlConfig, load_rig
from cabols_control.rig_folder import rig_file
from cabols_hw.card.config import CardConfig
from cabols_sim.plant.config import load_plant


def changed(tmp_path, name, **changes):
    content = yaml.safe_load(rig_file(name).read_text())
    for key, value in changes.items():
        if value is None:
            del content[key]
        else:
            content[key] = value
    path = tmp_path / name
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"current_limit": 3.9}, "current_limit: expected 0.001 to 3.82, got 3.9"),
        ({"current_limit": float("nan")}, "current_limit"),
        ({"tension_max": 0.5}, "tension_max"),
        ({"tension_min": -1.0}, "tension_min"),
        ({"force_rated": [1.0, 2.0]}, "force_rated: expected 3 values, got 2"),
        ({"curent_limit": 2.0}, "curent_limit"),
        ({"zero": None}, "zero"),
        ({"unload_rate": [1.0]}, "unload_rate"),
        ({"command_timeout": "soon"}, "command_timeout"),
    ],
)
def test_control_mistakes(tmp_path, changes, message):
    path = changed(tmp_path, "control.yaml", **changes)
    with pytest.raises(ConfigError, match=message):
        load_config(ControlConfig, path)


def test_limbs_must_match_the_geometry(tmp_path):
    path = changed(tmp_path, "limbs.yaml", gain=[1.0] * 7, time_constant=[0.3] * 7)
    with pytest.raises(ConfigError, match="expected 8 limbs"):
        load_rig(limbs=path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ft_calibration": [[1.0] * 6] * 6}, "invertible"),
        ({"ft_calibration": [[1.0] * 6] * 5}, r"expected shape \(6, 6\)"),
        ({"watchdog": 0.0005}, "watchdog"),
        ({"watchdog": 1.0}, "watchdog"),
        ({"counts_per_metre": 0.0}, "counts_per_metre"),
        ({"output_limit": 12.0}, "output_limit"),
    ],
)
def test_card_mistakes(tmp_path, changes, message):
    path = changed(tmp_path, "card.yaml", **changes)
    with pytest.raises(ConfigError, match=message):
        load_config(CardConfig, path)


def test_plant_mistake(tmp_path):
    content = yaml.safe_load(rig_file("plant.yaml").read_text())
    content["limbs"]["backlash"] = -1.0
    path = tmp_path / "plant.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigError, match="backlash"):
        load_plant(path=path)


def test_empty_path_is_the_bench():
    np.testing.assert_array_equal(load_rig("", "", "").control.rated, [165, 165, 495, 15, 15, 15])
