# SPDX-License-Identifier: Apache-2.0
"""Graphs from what the packages declare: nothing twice, unknown, or named from above."""

from __future__ import annotations

import ast
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from cabols_control import bringup, bringup_nodes
from cabols_control.bringup.graph import all_arguments, all_nodes, nodes_of, rig_graph
from cabols_control.bringup.specs import Argument, NodeSpec, Role, give
from cabols_control.topics import TOPICS
from cabols_hw.bringup_nodes import BRIDGE
from cabols_sim.bringup_nodes import PLANT, bench_graph

OF_THE_GRAPH = {
    *("record", "console", "campaign", "robot", "lockstep", "frames", "pose_estimator"),
    "ros2_control",
}
"""Arguments that no node gets: they say which nodes there are."""
OF_ALL = {"params_file", "namespace", "log_level", "nodes"}
"""Arguments that are no node's parameter: see params_file.complete."""
CONTROL = [*sorted(Path(bringup.__file__).parent.glob("*.py")), Path(bringup_nodes.__file__)]


def named_from_above(source):
    """Names of nodes and packages above cabols_control that a source's strings or imports hold."""
    above = {
        name
        for node in all_nodes()
        if node.package != "cabols_control"
        for name in (node.package, node.executable)
    }
    tree = ast.parse(source)
    words = {n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            words.add((node.module or "").partition(".")[0])
    return sorted(above & {word for word in words if isinstance(word, str)})


@pytest.mark.parametrize("path", CONTROL, ids=lambda path: path.name)
def test_the_ground_floor_does_not_name_the_roof(path):
    assert named_from_above(path.read_text()) == []


def test_a_name_from_above_is_found():
    assert named_from_above('PLANT = NodeSpec("cabols_sim", "plant", (), ())') == [
        "cabols_sim",
        "plant",
    ]
    assert named_from_above("from cabols_hw.bringup_nodes import ROBOT") == ["cabols_hw"]


def test_everything_is_declared_once_and_known():
    nodes, arguments = all_nodes(), all_arguments()
    assert max(Counter(node.executable for node in nodes).values()) == 1
    assert max(Counter(argument.name for argument in arguments).values()) == 1
    names = {argument.name for argument in arguments}
    taken = {name for node in nodes for name in node.takes}
    assert taken <= names
    assert names - taken == OF_THE_GRAPH | OF_ALL
    assert {topic for node in nodes for topic in (*node.reads, *node.writes)} <= set(TOPICS)


def test_the_clock_starts_last_and_every_node_has_a_role():
    assert all(node.role is not None for node in all_nodes())
    assert rig_graph()[-1].role is Role.CLOCK
    assert bench_graph()[-1].role is Role.SIMULATION
    assert len(nodes_of(Role.CONTROLLER)) == 3


def test_a_node_gets_what_it_takes_and_no_more():
    node = NodeSpec("p", "n", (), (), takes=("fifo_priority", "gain"), fifo_below=2)
    arguments = [
        Argument("fifo_priority", 0, "", parameter=""),
        Argument("gain", 1.0, "", parameter="k"),
        Argument("name", "", ""),
    ]
    (given,) = give([node], arguments, {"fifo_priority": 50, "gain": 2.0, "name": "x"})
    assert given.parameters == {"fifo_priority": 48, "k": 2.0}
    (same,) = give([node], arguments, {"fifo_priority": 0, "gain": 1.0})
    assert same.parameters == {}


def test_the_plant_reads_what_a_bridge_reads():
    """It is one. A reader that a lockstep graph does not count lets its clock start too early."""
    assert set(BRIDGE.reads) <= set(PLANT.reads)


def test_no_node_reads_or_writes_a_topic_twice():
    """A reader that is counted twice is waited for, and the clock of a lockstep graph stands."""
    assert bench_graph(robot=True, lockstep=True)
    with pytest.raises(ValueError, match="plant: a topic twice in mode, mode"):
        replace(PLANT, reads=("mode", "mode"))
