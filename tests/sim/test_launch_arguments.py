# SPDX-License-Identifier: Apache-2.0
"""Every argument of both launch files: a right, a wrong and a misspelt value."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from cabols_control.bringup import argument_text
from cabols_control.bringup.argument_text import read_arguments
from cabols_control.bringup.graph import all_arguments, rig_graph
from cabols_control.errors import ConfigError
from cabols_control.parameters.file import complete
from cabols_control.rig_folder import find_rig
from cabols_sim.bringup_nodes import bench_graph

CASES = {kind: [a for a in all_arguments() if kind in a.kinds] for kind in ("bench", "rig")}
EVERY = [(kind, argument) for kind, arguments in CASES.items() for argument in arguments]
TEXTS = {
    "rig": ("bench", "no_such_rig"),
    "namespace": ("/rig2/left", "rig 2"),
    "frame_prefix": ("rig2/", "2 rigs"),
    "tension_method": ("p_norm", "p-norm"),
    "program": ("steps", "stairs"),
    "output": ("{new}", "{full}"),
    "campaigns": ("{new}", "{file}"),
    "uploads": ("{new}", "{file}"),
    "campaign_folder": ("{new}", "{file}"),
    "bias_file": ("{new}", None),
    "description": ("a first run, 20 N", None),
    "nodes": ("supervisor, limb_controller", "supervisor,limb"),
    "record_also": ("/rosout,/room/t:std_msgs/msg/String", "/room/t"),
    "console_host": ("0.0.0.0", "my host"),
    "robot_address": ("192.168.125.1", "192.168 125.1"),
    "tracker_address": ("10.0.0.5:50551", "10.0.0.5"),
    "board": ("1", "first"),
    "robot_position": ("[0.1, -2, 3e-1]", "[0.1, -2]"),
    "robot_rotation_xyz_deg": ("0,0,90", "0,0,east"),
}
"""Right and wrong; any text may be a description, and a bias is written where there is none."""
FILES = {
    "geometry_file": "geometry.yaml",
    "limbs_file": "limbs.yaml",
    "control_file": "control.yaml",
    "card_file": "card.yaml",
    "safety_file": "safety.yaml",
    "robot_configurations_file": "robot.yaml",
    "tracker_file": "tracker.yaml",
    "plant_file": "plant.yaml",
    "robot_file": "robot_truth.yaml",
}
"""Files that a launch reads before anything starts."""


@pytest.fixture
def places(tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "old.txt").write_text("x")
    (tmp_path / "file").write_text("{}")
    for name, of_bench in FILES.items():
        (tmp_path / name).write_bytes((find_rig().path / of_bench).read_bytes())
    return {name: str(tmp_path / name) for name in ("new", "full", "file", *FILES)}


def values_of(argument):
    if argument.name in TEXTS:
        return TEXTS[argument.name]
    if argument.choices:
        return argument.choices[-1], argument.choices[-1] + "s"
    if argument.name in FILES:
        return f"{{{argument.name}}}", "{new}"
    if argument.name.endswith("_file"):
        return "{file}", "{new}"
    if isinstance(argument.default, bool):
        return str(not argument.default), "flase"
    assert argument.bounds is not None, f"{argument.name}: say which values are wrong"
    low, high = argument.bounds
    return str(low if high == argument.default else high), str(high + 1)


@pytest.mark.parametrize(("kind", "argument"), EVERY, ids=[f"{k}-{a.name}" for k, a in EVERY])
def test_right_wrong_and_misspelt(kind, argument, places, monkeypatch):
    if argument.name in argument_text.NEEDED_TYPES:
        monkeypatch.setattr(argument_text, "type_is_installed", lambda _: True)
    right, wrong = (text and text.format(**places) for text in values_of(argument))
    if argument.name == "params_file":
        Path(right).write_text("/**/supervisor: {ros__parameters: {state_timeout: 1.0}}\n")
    values = read_arguments(CASES[kind], {argument.name: right})
    assert type(values[argument.name]) is type(argument.default)
    assert values[argument.name] != argument.default or argument.name == "rig"
    graph = bench_graph() if kind == "bench" else rig_graph()
    changed = complete(graph, values, {argument.name})
    told = [node.executable for node in changed if argument.name in node.takes]
    for node in changed:
        if node.executable in told and argument.name != "rig":
            given = {**node.options, **node.parameters}
            name = argument.parameter or argument.name
            below = node.fifo_below if argument.name == "fifo_priority" else 0
            assert given[name] == (
                values[argument.name] - below if below else values[argument.name]
            )
    if wrong is not None:
        with pytest.raises(ConfigError, match=rf"^{argument.name}:"):
            read_arguments(CASES[kind], {argument.name: wrong})
    misspelt = argument.name[0] + argument.name
    with pytest.raises(ConfigError, match=rf"{misspelt}: there is no such argument; did you mean"):
        read_arguments(CASES[kind], {misspelt: right})


def test_each_host_of_a_rig_starts_its_own_nodes():
    """In the graph's order; a node that the graph lacks is told."""
    whole = [node.executable for node in complete(bench_graph(), {})]
    at_the_rig = [name for name in whole if name != "limb_controller"]
    for names in (["limb_controller"], at_the_rig):
        nodes = complete(bench_graph(), {"nodes": ",".join(reversed(names))})
        assert [node.executable for node in nodes] == names
    with pytest.raises(ConfigError, match=r"^nodes: expected some of .* got frames; .*campaign"):
        complete(bench_graph(), {"nodes": "frames,plant"})


def test_an_argument_of_the_other_launch_file_is_none_of_this_one():
    for kind, other in (("rig", "bench"), ("bench", "rig")):
        mine = {argument.name for argument in CASES[kind]}
        for argument in CASES[other]:
            if argument.name not in mine:
                with pytest.raises(ConfigError, match=f"{argument.name}: there is no such"):
                    read_arguments(CASES[kind], {argument.name: str(argument.default)})


def test_every_file_of_a_rig_is_read():
    assert {a.name for a in all_arguments() if a.reader} == set(FILES)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize(
    "content", [b"", b"- 1", b"nothing: [", b"\xff\xfe\x00", b"of_another_kind: 1"]
)
def test_a_file_that_cannot_be_used_is_refused_before_anything_starts(name, content, tmp_path):
    path = tmp_path / "my own é file.yaml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"my own é file\.yaml"):
        complete(bench_graph(), {name: str(path)}, {name})


def test_a_folder_that_is_no_rig_is_refused_before_anything_starts(tmp_path):
    with pytest.raises(ConfigError, match=r"expected geometry\.yaml, got nothing"):
        complete(rig_graph(), {"rig": str(tmp_path)}, {"rig"})


def test_files_that_fit_each_other_alone_are_read_together(tmp_path):
    """Seven cables in geometry and limbs: either file beside the bench's other one is wrong."""
    bench = find_rig().path
    geometry = yaml.safe_load((bench / "geometry.yaml").read_text())
    for points in ("base_points", "platform_points"):
        geometry[points] = geometry[points][:7]
    limbs = {
        key: value[:7] if isinstance(value, list) else value
        for key, value in yaml.safe_load((bench / "limbs.yaml").read_text()).items()
    }
    given = {"geometry_file": geometry, "limbs_file": limbs}
    paths = {name: str(tmp_path / f"{name}.yaml") for name in given}
    for name, content in given.items():
        Path(paths[name]).write_text(yaml.safe_dump(content))
    complete(rig_graph(), paths, set(paths))
    for name, path in paths.items():
        with pytest.raises(ConfigError):
            complete(rig_graph(), {name: path}, {name})
