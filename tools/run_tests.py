# SPDX-License-Identifier: Apache-2.0
"""Run the tests as `make test` does: pure ones, graphs that bear company, then real time alone.

python tools/run_tests.py [pytest's arguments]

Tests that run against the wall clock, such as a graph at 1 kHz with its watchdogs of 10 ms, share
the machine with no other test. Graphs in lockstep or with long watchdogs bear company, and wait
more than they compute. What the arguments select by `-m` is split the same way. Tests marked
`long` run only where `-m` names them. The last line is one closing line of pytest for all parts.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

TWO = ("-n", "2", "--dist", "loadfile", "--no-loadscope-reorder")
"""Two processes, a file at a time, in the order of tests/harness/longest_first.py. Graphs wait for
a third of their time, but three at a time let a page or a supervisor starve for seconds."""
PARTS = (
    ("not (ros or realtime)", TWO, ""),
    ("ros and not realtime", TWO, "mark.ros"),
    ("realtime", (), "mark.realtime"),
)
"""Tests that run one part after the other, how pytest runs them, and what their files must name."""
MARKS = "CABOLS_TEST_MARKS"
"""Environment variable for the latter: importing all files takes as long as a graph."""
COUNTS = "CABOLS_TEST_COUNTS"
"""Environment variable: file for the numbers of outcomes, see tests/harness/outcome_counts.py."""
NOTHING_COLLECTED = 5
LONGEST_S = 4500.0
"""Longest that all parts may take without tests marked `long`: five times an idle machine's."""
SUMMARY_S = 60.0
"""Most that pytest may take to end and tell what it has found, once interrupted."""
ORDER = ("failed", "passed", "skipped", "deselected", "xfailed", "xpassed", "warnings", "errors")


def split_marks(words: Sequence[str]) -> tuple[str, list[str]]:
    """Take `-m EXPRESSION` out of pytest's arguments.

    Returns:
        The expression (empty: none), and the other arguments.
    """
    expression, others, rest = "", [], iter(words)
    for word in rest:
        if word == "-m":
            expression = next(rest, "")
        elif word.startswith("-m") and not word.startswith("--"):
            expression = word[2:].removeprefix("=")
        else:
            others.append(word)
    return expression, others


def selection(part: str, expression: str) -> str:
    """Marker expression of one part of what the arguments select."""
    parts = [part, expression, "" if "long" in expression else "not long"]
    return " and ".join(f"({each})" for each in parts if each)


def run_part(
    words: Sequence[str], marks: str = "", limit_s: float | None = None
) -> tuple[int, Counter[str]]:
    """Run pytest once, for at most a time; return its exit code and the numbers of outcomes."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "counts.json"
        # Matrices are small: on a busy machine threads for them make a fit 30 times slower.
        environment = {"OPENBLAS_NUM_THREADS": "1", **os.environ, COUNTS: str(file), MARKS: marks}
        command = [sys.executable, "-m", "pytest", *words]
        with subprocess.Popen(command, env=environment) as process:
            code = _end_in_time(process, limit_s)
        counts = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        left_out = Path(f"{file}.deselected")
        if left_out.exists():
            counts["deselected"] = sum(map(int, left_out.read_text(encoding="utf-8").split()))
    return code, Counter(counts)


def _end_in_time(process: subprocess.Popen[bytes], limit_s: float | None) -> int:
    """Wait for pytest; interrupt it after a time, so that it tells what it has found."""
    try:
        return process.wait(limit_s)
    except subprocess.TimeoutExpired:
        print(f"\ninterrupted, as tests may take {LONGEST_S:g} s altogether", flush=True)
        process.send_signal(signal.SIGINT)
    try:
        return process.wait(SUMMARY_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def closing_line(counts: Counter[str], seconds: float) -> str:
    """What pytest would say of all parts."""
    text = ", ".join(f"{counts[name]} {name}" for name in ORDER if counts[name])
    whole = round(seconds)
    clock = f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
    return f" {text or 'no tests ran'} in {seconds:.2f}s ({clock}) ".center(88, "=")


def add_up(*parts: Counter[str]) -> Counter[str]:
    """Outcomes of all parts; deselected are those that no part ran.

    The first part sees all files, and counts what the parts after it run, too. Where it has not
    counted, the last part's number is taken, less what the parts before have run.
    """
    outcomes = ("failed", "passed", "skipped", "xfailed", "xpassed")
    total = sum(parts, Counter[str]())
    counting = 0 if "deselected" in parts[0] else len(parts) - 1
    others = [part for number, part in enumerate(parts) if number != counting]
    run = sum(part[name] for part in others for name in outcomes)
    total["deselected"] = max(parts[counting]["deselected"] - run, 0)
    return total


def verdict(codes: Sequence[int]) -> int:
    """Exit code of all parts: the first that failed; nothing collected only if in none."""
    failed = [code for code in codes if code not in (0, NOTHING_COLLECTED)]
    if failed:
        return failed[0]
    return 0 if 0 in codes else NOTHING_COLLECTED


def main(words: Sequence[str]) -> int:
    """Run all parts; 0 if each passed."""
    # A shell starts what is in its background with interrupts ignored: tests of Ctrl-C need them.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    expression, others = split_marks(words)
    began, codes, found = time.monotonic(), [], list[Counter[str]]()
    for part, how, marks in PARTS:
        left_s = None if "long" in expression else began + LONGEST_S - time.monotonic()
        chosen = [*how, "-m", selection(part, expression), *others]
        code, counts = run_part(chosen, marks, left_s if left_s is None else max(left_s, 0.0))
        codes.append(code)
        found.append(counts)
        if code not in (0, NOTHING_COLLECTED) and {"-x", "--exitfirst"} & set(others):
            break
    print(closing_line(add_up(*found), time.monotonic() - began), flush=True)
    return verdict(codes)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
