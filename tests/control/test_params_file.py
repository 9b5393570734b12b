# SPDX-License-Identifier: Apache-2.0
"""One file of parameters for all nodes: every parameter is reachable, every mistake is named."""

from __future__ import annotations

import pytest
import yaml

from cabols_control.bringup.graph import all_nodes, rig_graph
from cabols_control.errors import ConfigError
from cabols_control.parameters.file import (
    OF_THE_LAUNCH,
    complete,
    default_of,
    launched_nodes,
    main,
    parameters_of,
    params_text,
    read_params_file,
)
from cabols_sim.bringup_nodes import bench_graph

NODES = [node for node in all_nodes() if node.joins]
PARAMETERS = [(node, parameter) for node in NODES for parameter in parameters_of(node)]


def text_of(node, values):
    return yaml.safe_dump({f"/**/{node}": {"ros__parameters": values}})


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "params.yaml"
        path.write_text(text)
        return path

    return write


def given(nodes, name):
    return next(node for node in nodes if node.executable == name).parameters


@pytest.mark.parametrize("kind", ["rig", "bench"])
def test_the_written_file_is_read_and_names_every_parameter(kind, file):
    nodes = launched_nodes(kind)
    text = params_text(nodes)
    values = read_params_file(file(text))
    for node in nodes:
        for parameter in parameters_of(node):
            if parameter.name in OF_THE_LAUNCH:
                continue
            default = default_of(parameter)
            if default is None:
                assert f"# {parameter.name}: {parameter.description}" in text
            else:
                assert values[node.executable][parameter.name] == default


def test_the_written_file_changes_nothing(file):
    path = str(file(params_text(launched_nodes("rig"))))
    with_file = complete(rig_graph(), {"params_file": path})
    for node, plain in zip(with_file, complete(rig_graph(), {}), strict=True):
        known = {p.name: default_of(p) for p in parameters_of(node)}
        told = {k: v for k, v in node.parameters.items() if v != known[k]}
        assert told == {k: v for k, v in plain.parameters.items() if v != known[k]}


@pytest.mark.parametrize(
    ("node", "parameter"), PARAMETERS, ids=[f"{n.executable}-{p.name}" for n, p in PARAMETERS]
)
def test_every_parameter_right_wrong_and_misspelt(node, parameter, file):
    default = default_of(parameter)
    right = default if default is not None else ["limb_state"]
    values = read_params_file(file(text_of(node.executable, {parameter.name: right})))
    assert values == {node.executable: {parameter.name: right}}
    wrong = "fast" if not isinstance(default, str) else 3.5
    with pytest.raises(ConfigError, match=f"{node.executable}: {parameter.name}: expected"):
        read_params_file(file(text_of(node.executable, {parameter.name: wrong})))
    misspelt = parameter.name + "x"
    with pytest.raises(ConfigError, match=f"no parameter {misspelt}; did you mean"):
        read_params_file(file(text_of(node.executable, {misspelt: right})))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (text_of("supervisr", {"auto_start": True}), "no such node; did you mean supervisor"),
        ("supervisor: {auto_start: true}", "expected ros__parameters"),
        ("- 1", "expected nodes with their parameters"),
        ("a: [", "expected YAML"),
        (text_of("load_program", {"scale": 99.0}), "scale: expected -10 to 10, got 99"),
        (text_of("plant", {"card_file": "/none.yaml"}), "card_file: expected a file, found none"),
        (
            text_of("abb_tracker_bridge", {"robot_position": [0.0, "x", 1.0]}),
            "robot_position: expected a list, each a number",
        ),
    ],
)
def test_what_cannot_be_used_is_named(text, said, file):
    with pytest.raises(ConfigError, match=said):
        read_params_file(file(text))


@pytest.mark.parametrize(
    ("text", "of_supervisor"),
    [
        ("", {}),
        ("# all of it deleted", {}),
        ("/**: {ros__parameters: {state_timeout: 1.0}}", {"state_timeout": 1.0}),
        (
            "/**: {ros__parameters: {state_timeout: 1, auto_start: true}}\n"
            "supervisor: {ros__parameters: {state_timeout: 2.0}}",
            {"state_timeout": 2.0, "auto_start": True},
        ),
        ("/cabols: {supervisor: {ros__parameters: {auto_start: true}}}", {"auto_start": True}),
        ("/cabols/supervisor: {ros__parameters: {auto_start: true}}", {"auto_start": True}),
        ("cabols/supervisor: {ros__parameters: {auto_start: true}}", {"auto_start": True}),
        ("'**/supervisor': {ros__parameters: {auto_start: true}}", {"auto_start": True}),
        (
            "/rig2/supervisor: {ros__parameters: {auto_start: true}}\n"
            "/cabols/supervisor: {ros__parameters: {state_timeout: 1.0}}",
            {"state_timeout": 1.0},
        ),
        (
            "/rig2: {supervisor: {ros__parameters: {auto_start: true}}}\n"
            "/**: {ros__parameters: {state_timeout: 1.0}}",
            {"state_timeout": 1.0},
        ),
        ("/**: {ros__parameters: {use_sim_time: false}}", {}),
        ("/**: {ros__parameters: {scale: 2}}", {}),
    ],
)
def test_ros_own_forms(text, of_supervisor, file):
    assert read_params_file(file(text)).get("supervisor", {}) == of_supervisor


def test_sections_of_another_namespace_are_its_rigs(file):
    mine, other = ({"ros__parameters": {"auto_start": value}} for value in (True, False))
    sections = {"/rig2/supervisor": mine, "/rig3/supervisor": other}
    path = str(file(yaml.safe_dump(sections)))
    for namespace, told in (("/rig2", True), ("/rig3", False)):
        values = {"params_file": path, "namespace": namespace}
        assert given(complete(rig_graph(), values), "supervisor")["auto_start"] is told
    # Nothing of it would be obeyed: a misspelt namespace.
    with pytest.raises(ConfigError, match="expected a section of /rig4, got those of /rig2, /rig3"):
        complete(rig_graph(), {"params_file": path, "namespace": "/rig4"})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("/**: {ros__parameters: {nonsense: 1}}", "no node has a parameter nonsense$"),
        ("/**: {ros__parameters: {auto_strt: true}}", "auto_strt; did you mean auto_start"),
        ("/**: {ros__parameters: {auto_start: 1}}", "auto_start: expected true or false, got 1"),
        ("/**: {ros__parameters: {use_sim_time: true}}", "use_sim_time: expected false, got"),
        ("/rig2/supervisr: {ros__parameters: {}}", "did you mean supervisor"),
        ("/cabols: {supervisor: {ros_parameters: {}}}", "expected ros__parameters"),
        (text_of("abb_tracker_bridge", {"robot_maker": "kuka"}), "expected one of abb, ur"),
        (text_of("wrench_controller", {"tension_method": "pnorm"}), "expected one of min_norm"),
        (text_of("load_program", {"program": "stairs"}), "program:=stairs"),
        (text_of("recorder", {"record_also": "/tff"}), "record_also:=/tff"),
        (text_of("recorder", {"output": "/proc/a"}), "expected a place to write to"),
        (text_of("plant", {"rig": "nowhere"}), "rig:=nowhere"),
    ],
)
def test_values_are_judged_as_arguments_are(text, said, file):
    with pytest.raises(ConfigError, match=said):
        read_params_file(file(text))


def test_all_mistakes_are_told_at_once(file):
    text = text_of("supervisor", {"autostart": True, "state_timeout": "long"})
    with pytest.raises(ConfigError) as caught:
        read_params_file(file(text))
    assert "autostart" in str(caught.value)
    assert "state_timeout" in str(caught.value)


def test_arguments_that_are_given_go_before_the_file(file):
    path = str(file(text_of("load_program", {"scale": 2, "rate": 100})))
    nodes = complete(rig_graph(), {"params_file": path, "scale": 3.0}, {"scale"})
    assert given(nodes, "load_program") == {"scale": 3.0, "rate": 100.0}
    # A default of the launch file's own is nobody's wish.
    nodes = complete(rig_graph(), {"params_file": path, "scale": 3.0}, ())
    assert given(nodes, "load_program")["scale"] == 2.0


def test_what_the_launch_sets_itself_is_not_changed(file):
    path = str(file(text_of("plant", {"robot": False})))
    with pytest.raises(ConfigError, match="plant: robot is set by the launch itself to True"):
        complete(bench_graph(), {"params_file": path})


def test_nodes_of_different_rigs_are_refused(file):
    path = str(file(text_of("supervisor", {"control_file": __file__})))
    with pytest.raises(ConfigError, match="control_file: expected the same for all nodes"):
        complete(rig_graph(), {"params_file": path})


def test_namespace_and_log_level_reach_every_node_of_the_graph():
    for node in complete(bench_graph(), {"namespace": "/rig2", "log_level": "debug"}):
        words = node.arguments()
        if not node.joins:
            assert "__ns:=/rig2" not in words
            continue
        assert words[words.index("-r") + 1] == "__ns:=/rig2"
        assert words[words.index("--log-level") + 1] == f"rig2.{node.executable}:=debug"
    assert all("-r" not in node.arguments() for node in complete(bench_graph(), {}))


def test_the_command_writes_it(tmp_path, capsys):
    path = tmp_path / "all.yaml"
    assert main(["--kind", "bench", "--output", str(path)]) == 0
    assert "/**/plant:" in path.read_text()
    assert main([]) == 0
    assert "/**/q8_ati_bridge:" in capsys.readouterr().out
