# SPDX-License-Identifier: Apache-2.0
"""Configuration files: what a person reads is what is meant; everything else is a short error."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import pytest
import yaml
from pydantic.dataclasses import dataclass

from cabols_control.configuration import STRICT, load_config, read_yaml, within
from cabols_control.errors import ConfigError
from cabols_control.files.strict_yaml import MAX_SHOWN


@dataclass(frozen=True, config=STRICT)
class Part:
    mass: float
    name: str = ""


@dataclass(frozen=True, config=STRICT)
class Whole:
    parts: list[Part]
    enabled: bool = False
    count: int = 1
    limit: Annotated[float, within(0.5, 2.0)] = 1.0
    places: list[list[float]] | None = None


def load(tmp_path, text, **more):
    path = tmp_path / "whole.yaml"
    path.write_text(text)
    return load_config(Whole, path, **more)


GOOD = """\
parts:
  - {mass: 1.5, name: first}
  - {mass: 2}
enabled: true
count: 3
places: [[1, 2.0, 3e-1], [1e3, -.5, +6.]]
"""


def test_what_is_right_is_read_as_it_is_written(tmp_path):
    whole = load(tmp_path, GOOD)
    assert whole == Whole(
        [Part(1.5, "first"), Part(2.0)], True, 3, 1.0, [[1.0, 2.0, 0.3], [1000.0, -0.5, 6.0]]
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("enabled: true", "enabled: yes", r"enabled \(line 4\): expected true or false, got 'yes'"),
        ("enabled: true", "enabled: 1", r"enabled \(line 4\): expected true or false, got 1"),
        ("enabled: true", 'enabled: "true"', r"expected true or false, got 'true'"),
        ("mass: 1.5", "mass: '1.5'", r"parts\.0\.mass \(line 2\): expected a number, got '1\.5'"),
        ("mass: 2", "mass: 0145", r"parts\.1\.mass \(line 3\): expected a number, got '0145'"),
        ("mass: 2", "mass: 0x10", "expected a number, got '0x10'"),
        ("mass: 2", "mass: 1:30", "expected a number, got '1:30'"),
        ("mass: 2", "mass: 1_000", "expected a number, got '1_000'"),
        ("mass: 2", "mass: 2,5", "parts.1"),
        ("mass: 2", "mass: true", "expected a number, got True"),
        ("count: 3", "count: 3.0", r"count \(line 5\): expected a whole number, got 3\.0"),
        ("name: first", "name: 12", "expected text, got 12"),
        (
            "count: 3",
            "count: 3\ncount: 4",
            r"line 6: expected each key once, got 'count' in line 5",
        ),
        ("mass: 2", "mass: 2, mass: 3", r"line 3: expected each key once, got 'mass' in line 3"),
        ("count: 3", "cuont: 3", r"cuont \(line 5\): expected no such key, got 3"),
        ("{mass: 2}", "{weight: 2}", r"parts\.1\.mass.*expected this key, got none"),
        ("{mass: 2}", "2", r"parts\.1 \(line 3\): expected a mapping of keys, got 2"),
        ("places: [[1, 2.0, 3e-1]", "places: [1", r"places\.0.*expected a list, got 1"),
        ("count: 3", "limit: 2.5", r"limit \(line 5\): expected 0\.5 to 2, got 2\.5"),
        ("count: 3", "limit: .nan", r"limit \(line 5\): expected 0\.5 to 2, got nan"),
        ("count: 3", "? [a, b]\n: 3", "expected a name as key"),
        ("count: 3", "count: !!python/name:os.system", "expected YAML"),
    ],
)
def test_mistakes_name_file_line_and_key(tmp_path, old, new, message):
    assert old in GOOD
    with pytest.raises(ConfigError, match=message) as caught:
        load(tmp_path, GOOD.replace(old, new))
    assert str(caught.value).startswith(str(tmp_path / "whole.yaml"))
    assert len(str(caught.value)) < len(str(tmp_path)) + 400


def test_yaml_1_1_would_have_read_them_otherwise():
    # The reference: what PyYAML makes of the same words.
    assert yaml.safe_load("[yes, 0145, 1:30]") == [True, 101, 90]
    assert yaml.safe_load("{a: 1, a: 2}") == {"a": 2}


def bomb(levels):
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    for i in range(levels):
        one, two = chr(98 + i), chr(97 + i)
        lines.append(f"{one}: &{one} [{', '.join(['*' + two] * 9)}]")
    return "\n".join(lines)


@pytest.mark.parametrize("levels", [3, 6, 8, 20])
def test_alias_bombs_are_short_errors(tmp_path, levels):
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, bomb(levels))
    assert len(str(caught.value)) < len(str(tmp_path)) + 5 * (MAX_SHOWN + 80)


def test_an_alias_of_its_own_whole(tmp_path):
    with pytest.raises(ConfigError, match="alias of what it is part of"):
        load(tmp_path, "parts: &a [*a]")


@pytest.mark.parametrize("text", ["[" * 5000, "{a: " * 5000, "- " * 5000 + "1"])
def test_deep_nesting_is_a_short_error(tmp_path, text):
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text)
    assert len(str(caught.value)) < len(str(tmp_path)) + 200


def test_a_file_as_large_as_a_book(tmp_path):
    with pytest.raises(ConfigError, match="letters"):
        load(tmp_path, "parts: [" + "1, " * 400_000 + "1]")


def test_many_mistakes_are_counted(tmp_path):
    text = "parts: [" + ", ".join(["{mass: x}"] * 40) + "]"
    with pytest.raises(ConfigError, match="and 35 more"):
        load(tmp_path, text)


def test_a_number_in_two_files_must_agree(tmp_path):
    whole = load(tmp_path, GOOD, shared={"limit": 1.5, "count": 3}, source="frames.yaml")
    assert (whole.limit, whole.count) == (1.5, 3)
    message = r"count \(line 5\): expected 4 as in frames.yaml, got 3; delete it here"
    with pytest.raises(ConfigError, match=message):
        load(tmp_path, GOOD, shared={"count": 4}, source="frames.yaml")


def test_numbers_survive_a_round_trip(tmp_path):
    values = {"values": [*np.random.default_rng(1).normal(size=200).tolist(), 1e-300, 1e22, 3.0]}
    path = tmp_path / "values.yaml"
    path.write_text(yaml.safe_dump(values))
    assert read_yaml(path) == values
