# SPDX-License-Identifier: Apache-2.0
"""Launch arguments: a right, a wrong and a misspelt value of each."""

from __future__ import annotations

from pathlib import Path

import pytest

from cabols_control.bringup import argument_text
from cabols_control.bringup.argument_text import others, read_argument, read_arguments
from cabols_control.bringup.graph import all_arguments
from cabols_control.bringup.network_names import domain_id
from cabols_control.errors import ConfigError
from cabols_sim.bench.run import ports_of

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


@pytest.mark.parametrize("installed", [True, False])
def test_frames_need_a_package_that_not_every_installation_has(installed, monkeypatch):
    monkeypatch.setattr(argument_text, "type_is_installed", lambda _: installed)
    if installed:
        assert read_arguments(ARGUMENTS, {"frames": "true"})["frames"] is True
        return
    assert read_arguments(ARGUMENTS, {"frames": "false"})["frames"] is False
    with pytest.raises(ConfigError, match=r"frames: .* install ros-jazzy-tf2-msgs, or leave"):
        read_arguments(ARGUMENTS, {"frames": "true"})


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


TEXTS = {
    "namespace": ("/rig2 /a/b /_rig /rig__2", "/ rig2 /rig2/ //rig2 /2rig /rig-2 /rigé ~/rig2"),
    "frame_prefix": ("rig2/ rig2", "/rig2/ 2/ rigé/ a/b/"),
    "board": ("0 7 00", "-1 0x1 ٣ 1000 one"),
    "robot_address": ("10.0.0.2 robot.lab r2", "999.1.1.1 1.2.3 host_name ::1 http://x 1.1.1.1:80"),
    "console_host": ("0.0.0.0 :: ::1 localhost", "999.0.0.1 :1: [::1] a_b"),
    "tracker_address": ("h:1 10.0.0.5:65535", "h h:0 h:65536 h:٣ :50 [::1]:50 h:1:2"),
    "record_also": (
        "/rosout room:sensor_msgs/msg/Temperature",
        "rosout room:sensor_msgs/Temperature /2a:std_msgs/msg/String a-b:std_msgs/msg/String "
        "room:none_msgs/msg/String room:std_msgs/msg/Strng limb_state:std_msgs/msg/String",
    ),
    "fifo_priority": ("0 3 99 007", "1 2 100 -1 3.0 ٣"),
    "nodes": ("supervisor limb_controller,recorder", "plnt /cabols/plant ,"),
}
"""Right and wrong texts of arguments that have a form; none of them holds a space."""


@pytest.mark.parametrize(
    ("name", "text"), [(name, text) for name, (right, _) in TEXTS.items() for text in right.split()]
)
def test_right_texts(name, text):
    read_arguments(ARGUMENTS, {name: text})


@pytest.mark.parametrize(
    ("name", "text"), [(name, text) for name, (_, wrong) in TEXTS.items() for text in wrong.split()]
)
def test_wrong_texts(name, text):
    with pytest.raises(ConfigError, match=rf"{name}.*expected"):
        read_arguments(ARGUMENTS, {name: text})


@pytest.mark.parametrize("argument", [a for a in ARGUMENTS if a.default and a.default is not True])
@pytest.mark.parametrize("text", ["", "  "])
def test_nothing_is_no_value_where_there_is_a_default(argument, text):
    with pytest.raises(ConfigError, match=f"{argument.name}: expected"):
        read_arguments(ARGUMENTS, {argument.name: text})


@pytest.mark.parametrize("name", ["output", "campaigns", "uploads", "bias_file"])
def test_what_is_to_be_written_can_be(name, tmp_path):
    (tmp_path / "file").write_text("")
    for text in ("a", "a/b/c", "my bags é/1"):
        assert read_arguments(ARGUMENTS, {name: str(tmp_path / text)})
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    for text in (str(tmp_path / "file" / "a"), "/proc/cabols"):
        with pytest.raises(ConfigError, match=f"{name}: expected a"):
            read_arguments(ARGUMENTS, {name: text})
    if name == "bias_file":
        with pytest.raises(ConfigError, match="expected a file, found a folder"):
            read_arguments(ARGUMENTS, {name: str(tmp_path)})


@pytest.mark.parametrize("text", ["233", "-1", "abc", " ", "1.0", "0x1", "٣", "1e2"])
def test_a_domain_that_dds_has_not_is_refused(text):
    with pytest.raises(ConfigError, match="ROS_DOMAIN_ID: expected a whole number from 0 to 232"):
        domain_id({"ROS_DOMAIN_ID": text})


def test_domains_that_there_are():
    assert [domain_id(e) for e in ({}, {"ROS_DOMAIN_ID": ""}, {"ROS_DOMAIN_ID": "232"})] == [
        *(0, 0, 232)
    ]
    assert max(vars(ports_of(232)).values()) <= 65535
