# SPDX-License-Identifier: Apache-2.0
"""The command behind `make test`: its halves are disjoint and complete, its verdict is both's."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

import run_tests

TESTS = """
import pytest

def test_pure(): pass

@pytest.mark.xfail(strict=True)
def test_expected(): assert False

@pytest.mark.ros
def test_graph(): pass

@pytest.mark.realtime
def test_clock(): assert False

@pytest.mark.long
def test_minutes(): pass
"""


@pytest.mark.parametrize(
    ("words", "expression", "others"),
    [
        ([], "", []),
        (["-k", "a", "-m", "slow"], "slow", ["-k", "a"]),
        (["-mros or slow", "x.py"], "ros or slow", ["x.py"]),
        (["--maxfail=2"], "", ["--maxfail=2"]),
    ],
)
def test_marks_are_taken_out_of_the_arguments(words, expression, others):
    assert run_tests.split_marks(words) == (expression, others)


@pytest.mark.parametrize(
    ("codes", "expected"), [((0, 0), 0), ((1, 0), 1), ((0, 2), 2), ((0, 5), 0), ((5, 5), 5)]
)
def test_verdict_is_that_of_both_halves(codes, expected):
    assert run_tests.verdict(codes) == expected


def test_closing_line_is_pytests():
    line = run_tests.closing_line(Counter(passed=1200, xfailed=130, failed=1), 425.3)
    assert re.fullmatch(r"=+ 1 failed, 1200 passed, 130 xfailed in 425.30s \(0:07:05\) =+", line)


def test_tests_that_neither_half_ran_are_deselected():
    """Of 10 tests: 6 pure ones in processes, which do not count; 3 with a graph, 1 in neither."""
    total = run_tests.add_up(Counter(passed=5, xfailed=1), Counter(passed=3, deselected=7))
    assert total == Counter(passed=8, xfailed=1, deselected=1)


def test_both_halves_run_once_and_are_added_up(tmp_path):
    """On a small tree of its own, in which one test of the second half fails."""
    small_suite(tmp_path, ["outcome_counts"], TESTS)
    command = [sys.executable, run_tests.__file__, "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*command, "-p", "xdist.plugin", str(tmp_path)],
        # Each of nine processes would import all plugins of this environment.
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    assert " 1 failed, 2 passed, 1 deselected, 1 xfailed in " in done.stdout.splitlines()[-1]


HANGING = """
import pytest
from cabols_control.bringup.processes import run
from cabols_control.bringup.specs import NodeSpec

@pytest.mark.ros
@pytest.mark.timeout(2)
@pytest.mark.parametrize("number", range(4))
def test_graph(number): run([NodeSpec("hanging", "node", (), ())])
"""


def small_suite(folder, hooks, tests):
    """A tree of tests of its own, with some of this one's hooks."""
    harness = Path(__file__).parents[1] / "harness"
    for name in hooks:
        (folder / f"{name}.py").write_bytes((harness / f"{name}.py").read_bytes())
    imports = "\n".join(f"from {name} import *" for name in hooks)
    (folder / "conftest.py").write_text(imports, encoding="utf-8")
    (folder / "test_it.py").write_text(tests, encoding="utf-8")
    settings = "[pytest]\nmarkers =\n    ros\n    realtime\n    long\n"
    (folder / "pytest.ini").write_text(settings, encoding="utf-8")


def test_graphs_that_hang_cost_two_time_outs_and_tell_what_their_nodes_said(tmp_path):
    small_suite(tmp_path, ["outcome_counts", "lost_tests"], HANGING)
    node = tmp_path / "lib" / "hanging" / "node"
    node.parent.mkdir(parents=True)
    node.write_text("#!/bin/sh\necho waits for readers\nexec sleep 600\n", encoding="utf-8")
    node.chmod(0o755)
    command = [sys.executable, run_tests.__file__, "-p", "xdist.plugin", "-p", "pytest_timeout"]
    done = subprocess.run(
        [*command, "-p", "no:cacheprovider", str(tmp_path)],
        env={
            **os.environ,
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            "AMENT_PREFIX_PATH": str(tmp_path),
        },
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode != 0
    assert "lost to time-outs: test_it.py::test_graph[0], test_it.py::test_graph[1]" in done.stdout
    assert "node: waits for readers" in done.stdout.partition("what the nodes printed last")[2]
    assert " 2 failed, 2 deselected in " in done.stdout.splitlines()[-1]


@pytest.mark.parametrize("ignores", [False, True])
def test_a_part_that_does_not_end_is_interrupted(ignores, monkeypatch):
    monkeypatch.setattr(run_tests, "SUMMARY_S", 0.5)
    number = "SIG_IGN" if ignores else "default_int_handler"
    code = f"import signal, time; signal.signal(2, signal.{number}); print(flush=True)"
    with subprocess.Popen(
        [sys.executable, "-c", f"{code}; time.sleep(600)"], stdout=subprocess.PIPE
    ) as process:
        process.stdout.readline()
        assert run_tests._end_in_time(process, 0.1) == (-9 if ignores else -2)
