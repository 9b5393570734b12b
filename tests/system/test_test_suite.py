# SPDX-License-Identifier: Apache-2.0
"""Rules of the tests themselves, each held against a planted violation, too."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from hypothesis import settings

TESTS = Path(__file__).parents[1]
CLOCKS = {"monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns"}
GRAPH = {"next_environment", "run_scenario", "Watcher"}
"""Names whose use starts, or joins, a graph."""


def test_files():
    return sorted(path for path in TESTS.rglob("test_*.py") if "bench" not in path.parts)


test_files.__test__ = False


def reads_clock(node):
    return any(
        isinstance(part, ast.Call)
        and isinstance(part.func, ast.Attribute)
        and part.func.attr in CLOCKS
        for part in ast.walk(node)
    )


def names(node):
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


def is_deadline(test):
    """Whether an assertion only ends a wait: time.monotonic() < give_up."""
    return (
        isinstance(test, ast.Compare)
        and isinstance(test.left, ast.Call)
        and reads_clock(test.left)
        and len(test.comparators) == 1
        and isinstance(test.comparators[0], ast.Name)
    )


def wall_clock_verdicts(text):
    """Lines of assertions that judge a duration by the wall clock, without the machine's stalls."""
    tree, found = ast.parse(text), []
    timed = {"came_s"}
    for _ in range(3):
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign) and (
                reads_clock(node.value) or names(node.value) & timed
            ):
                timed |= set().union(*(names(target) for target in node.targets))
    for node in ast.walk(tree):
        if not isinstance(node, ast.Assert) or is_deadline(node.test):
            continue
        upper = any(
            isinstance(part, ast.Compare)
            and isinstance(part.ops[0], ast.Lt | ast.LtE)
            and (reads_clock(part.left) or names(part.left) & timed)
            for part in ast.walk(node.test)
        )
        if upper and "stalls" not in names(node.test):
            found.append(node.lineno)
    return found


def unmarked_graphs(text):
    """Whether a module starts a graph in a test without the marker `ros` (or `realtime`)."""
    tree = ast.parse(text)
    used = {n for node in tree.body if not isinstance(node, ast.ImportFrom) for n in names(node)}
    return bool(used & GRAPH) and "mark.ros" not in text and "mark.realtime" not in text


@pytest.mark.parametrize("path", test_files(), ids=lambda path: str(path.relative_to(TESTS)))
def test_no_test_judges_the_wall_clock(path):
    assert wall_clock_verdicts(path.read_text("utf-8")) == []


@pytest.mark.parametrize("path", test_files(), ids=lambda path: str(path.relative_to(TESTS)))
def test_every_graph_is_marked(path):
    assert not unmarked_graphs(path.read_text("utf-8"))


@pytest.mark.parametrize(
    "text",
    [
        "began = time.monotonic()\nwork()\nassert time.monotonic() - began < 1.0\n",
        "began = time.monotonic()\nwork()\ntook = time.monotonic() - began\nassert took <= 1.0\n",
        "began = watcher.came_s[3]\nassert began - closed < 2.0\nclosed = time.perf_counter()\n",
    ],
)
def test_planted_wall_clock_verdict_is_found(text):
    assert wall_clock_verdicts(text)


@pytest.mark.parametrize(
    "text",
    [
        "give_up = time.monotonic() + 30.0\nassert time.monotonic() < give_up\n",
        "took = time.monotonic() - began\nassert took - stalls.total_s < 1.0\n",
        "took = time.monotonic() - began\nassert took >= 1.0\n",
    ],
)
def test_deadlines_and_stalls_are_no_verdicts(text):
    assert wall_clock_verdicts(text) == []


def test_planted_graph_without_its_mark_is_found():
    text = "from graph_harness import run_scenario\ndef test_it():\n    run_scenario({}, None)\n"
    assert unmarked_graphs(text)
    assert not unmarked_graphs(text + "pytestmark = pytest.mark.ros\n")


def test_no_drawn_example_has_a_time_limit():
    """By default hypothesis judges an example that takes more than 200 ms."""
    assert settings().deadline is None
    assert settings(max_examples=10).deadline is None
    texts = {path: path.read_text(encoding="utf-8") for path in test_files()}
    assert not [
        path for path, text in texts.items() if path != Path(__file__) and "deadline=" in text
    ]
