# SPDX-License-Identifier: Apache-2.0
"""Safety files that a tired person, or a stranger, writes."""

from __future__ import annotations

import re

import pytest

from cabols_control.configuration import load_config
from cabols_control.errors import ConfigError
from cabols_control.rig_folder import rig_file
from cabols_hw.safety.config import SafetyConfig
from cases import outcome

TEXT = rig_file("safety.yaml").read_text("utf-8")
LONGEST_MESSAGE = 2000
"""Letters."""


def bomb(levels):
    """YAML whose aliases stand for nine times as many entries on each level."""
    lines = ["a: &a [x,x,x,x,x,x,x,x,x]"]
    for i in range(levels):
        name, below = chr(98 + i), chr(97 + i)
        lines.append(f"{name}: &{name} [{','.join([f'*{below}'] * 9)}]")
    return "\n".join(lines) + "\n"


def load(tmp_path, text):
    path = tmp_path / "safety.yaml"
    path.write_text(text, encoding="utf-8")
    return outcome(lambda: load_config(SafetyConfig, path))


def test_limit_without_reason_is_refused(tmp_path):
    text = re.sub(r"(?m)^tension_max:\s*\S+", "tension_max: 1000000.0", TEXT)
    assert text != TEXT
    assert isinstance(load(tmp_path, text), ConfigError)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("tension_max", "1e5"),
        ("tension_max", "10.0"),
        ("speed_loaded", "0.3"),
        ("cable_speed", "100.0"),
        ("pose_age", "60.0"),
        ("motion_time", "1e3"),
        ("rotation_range", "7.0"),
        ("search_length", "50.0"),
    ],
)
def test_limit_that_protects_nothing_is_refused(tmp_path, name, value):
    text = re.sub(rf"(?m)^{name}:\s*\S+", f"{name}: {value}", TEXT)
    assert text != TEXT
    error = load(tmp_path, text)
    assert isinstance(error, ConfigError)
    assert name in str(error)


def test_key_that_is_there_twice_is_refused(tmp_path):
    assert isinstance(load(tmp_path, TEXT + "\ntension_max: 900.0\n"), ConfigError)


@pytest.mark.parametrize("levels", [3, 6])
def test_alias_bomb_is_a_short_error(tmp_path, levels):
    error = load(tmp_path, bomb(levels))
    assert isinstance(error, ConfigError)
    assert len(str(error)) < LONGEST_MESSAGE
