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
    root = Path(__file__).parents[2]
    (tmp_path / "test_it.py").write_text(TESTS, encoding="utf-8")
    hook = (root / "tests" / "harness" / "outcome_counts.py").read_text("utf-8")
    (tmp_path / "conftest.py").write_text(hook, encoding="utf-8")
    settings = "[pytest]\nmarkers =\n    ros\n    realtime\n    long\n"
    (tmp_path / "pytest.ini").write_text(settings, encoding="utf-8")
    command = [sys.executable, str(root / "tools" / "run_tests.py"), "-p", "no:cacheprovider"]
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
