# SPDX-License-Identifier: Apache-2.0
"""Launch arguments: a right, a wrong and a misspelt value of each."""

from __future__ import annotations

from pathlib import Path

import pytest

from cabols_control.bringup.argument_text import others, read_argument, read_arguments
from cabols_control.bringup.graph import all_arguments
from cabols_control.errors import ConfigError

ARGUMENTS = all_arguments()
NUMBERS = [a for a in ARGUMENTS if type(a.default) in (int, float)]
FLAGS = [a for a in ARGUMENTS if isinstance(a.default, bool)]


def name(argument):
    return argument.name


@pytest.mark.parametrize("argument", ARGUMENTS, ids=name)
def test_default_is_read_from_its_own_text(argument):
    value = read_argument(argument, str(argument.default))
    assert value == argument.default
    assert type(value) is type(argument.default)


@pytest.mark.parametrize("argument", ARGUMENTS, ids=name)
def test_misspelt_name_is_refused_with_the_right_one(argument):
    misspelt = argument.name[:-2] + argument.name[-1] + argument.name[-2] + "x"
    with pytest.raises(ConfigError, match=rf"{misspelt}: there is no such argument"):
        read_arguments(ARGUMENTS, {misspelt: str(argument.default)})


@pytest.mark.parametrize("argument", FLAGS, ids=name)
@pytest.mark.parametrize("text", ["flase", "yes", "1", "", "on"])
def test_flag_is_true_or_false(argument, text):
    with pytest.raises(ConfigError, match=f"{argument.name}: expected true or false, got"):
        read_argument(argument, text)
    assert read_argument(argument, "True") is read_argument(argument, "true") is True


@pytest.mark.parametrize("argument", NUMBERS, ids=name)
@pytest.mark.parametrize("text", ["fast", "nan", "inf", "", "1,5", "0x10", "1e400", "[1]"])
def test_number_is_a_finite_number(argument, text):
    with pytest.raises(ConfigError, match=f"{argument.name}: expected"):
        read_argument(argument, text)


@pytest.mark.parametrize("argument", [a for a in NUMBERS if a.bounds], ids=name)
def test_bounds_are_kept(argument):
    low, high = argument.bounds
    for outside in (low - 1, high + 1):
        text = str(int(outside)) if isinstance(argument.default, int) else str(outside)
        with pytest.raises(ConfigError, match=f"{argument.name}: expected {low:g} to"):
            read_argument(argument, text)
    assert read_argument(argument, str(low)) == low


def test_whole_number_is_a_number_where_one_is_wanted():
    scale = next(a for a in ARGUMENTS if a.name == "scale")
    assert read_argument(scale, "2") == 2.0
    assert isinstance(read_argument(scale, "2"), float)


def test_home_is_expanded_and_what_is_named_is_there(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "g.yaml").write_text("{}")
    assert read_arguments(ARGUMENTS, {"geometry_file": "~/g.yaml"})["geometry_file"] == str(
        tmp_path / "g.yaml"
    )
    assert read_arguments(ARGUMENTS, {"output": "~/bags/a"})["output"] == str(
        tmp_path / "bags" / "a"
    )
    with pytest.raises(ConfigError, match="safety_file: expected a file, found none at"):
        read_arguments(ARGUMENTS, {"safety_file": "~/none.yaml"})


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"program": "stairs"}, "program:=stairs.*expected one of"),
        ({"program": "none.csv"}, "program:=none.csv.*cannot be read"),
        ({"tension_method": "least"}, "tension_method:=least.*expected one of"),
        ({"rig": "nowhere"}, "rig:=nowhere"),
        ({"progrm": "steps"}, "progrm.*did you mean program"),
        ({"zzz": "1"}, "zzz: there is no such argument; --show-args"),
    ],
)
def test_what_does_not_exist_is_told(given, said):
    with pytest.raises(ConfigError, match=said):
        read_arguments(ARGUMENTS, given)


def test_all_mistakes_are_told_at_once():
    with pytest.raises(ConfigError) as caught:
        read_arguments(ARGUMENTS, {"robot": "flase", "speed": "fast", "watchdog": "1"})
    for text in ("robot: expected true", "speed: expected a number from 0.01", "watchdog:"):
        assert text in str(caught.value)


def test_names_of_a_launch_file_that_includes_ours_are_its_own():
    names = ["speed", "lab_room", "progrm"]
    typed = ["speed:=0.3", "progrm:=steps"]
    ours = ["ros2", "launch", "cabols_sim", "bench.launch.py", *typed]
    assert others(names, typed, ours) == ["lab_room"]
    assert others(names, typed, ["python3", "-m", "x"]) == ["lab_room"]
    theirs = ["ros2", "launch", str(Path("lab") / "all.launch.py"), *typed]
    assert others(names, typed, theirs) == names
