"""Safety files that a tired person, or a stranger, writes."""

from __future__ import annotations

import re

import pytest

from cabols_control.configuration import load_config
from cabols_control.errors import ConfigError
from cabols_control.rig_folder import rig_file
from cabols_hw.safety.config import SafetyConfig
from cases import fails_today, outcome

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


@fails_today(13, "a limit of a million newtons is taken")
def test_limit_without_reason_is_refused(tmp_path):
    text = re.sub(r"(?m)^tension_max:\s*\S+", "tension_max: 1000000.0", TEXT)
    assert text != TEXT
    assert isinstance(load(tmp_path, text), ConfigError)


def test_key_that_is_there_twice_is_refused(tmp_path):
    assert isinstance(load(tmp_path, TEXT + "\ntension_max: 900.0\n"), ConfigError)


@pytest.mark.parametrize("levels", [3, 6])
def test_alias_bomb_is_a_short_error(tmp_path, levels):
    error = load(tmp_path, bomb(levels))
    assert isinstance(error, ConfigError)
    assert len(str(error)) < LONGEST_MESSAGE
