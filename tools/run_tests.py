"""Run the tests as `make test` does: in three processes, then those that need real time alone.

python tools/run_tests.py [pytest's arguments]

Tests that run against the wall clock, such as a graph at 1 kHz with its watchdogs of 10 ms, share
the machine with no other test. Graphs in lockstep or with long watchdogs bear company, and wait
more than they compute. What the arguments select by `-m` is split the same way. Tests marked
`long` run only where `-m` names them. The last line is one closing line of pytest for both halves.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

TOGETHER = "not realtime"
ALONE = "realtime"
TOGETHER_BY = ("-n", "3", "--dist", "loadfile")
COUNTS = "CABOLS_TEST_COUNTS"
"""Environment variable: file for the numbers of outcomes, see tests/harness/outcome_counts.py."""
NOTHING_COLLECTED = 5
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


def selection(half: str, expression: str) -> str:
    """Marker expression of one half of what the arguments select."""
    parts = [half, expression, "" if "long" in expression else "not long"]
    return " and ".join(f"({part})" for part in parts if part)


def run_half(words: Sequence[str]) -> tuple[int, Counter[str]]:
    """Run pytest once; return its exit code and the numbers of outcomes."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "counts.json"
        # Matrices are small: on a busy machine threads for them make a fit 30 times slower.
        environment = {"OPENBLAS_NUM_THREADS": "1", **os.environ, COUNTS: str(file)}
        command = [sys.executable, "-m", "pytest", *words]
        code = subprocess.run(command, check=False, env=environment).returncode
        counts = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    return code, Counter(counts)


def closing_line(counts: Counter[str], seconds: float) -> str:
    """What pytest would say of both halves."""
    text = ", ".join(f"{counts[name]} {name}" for name in ORDER if counts[name])
    whole = round(seconds)
    clock = f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
    return f" {text or 'no tests ran'} in {seconds:.2f}s ({clock}) ".center(88, "=")


def add_up(together: Counter[str], alone: Counter[str]) -> Counter[str]:
    """Outcomes of both halves; deselected are those that neither half ran.

    With processes beside it pytest does not count what it deselects, so the second half's number
    is taken, which counts what the first half has run, too.
    """
    outcomes = ("failed", "passed", "skipped", "xfailed", "xpassed")
    total = together + alone
    total["deselected"] = max(alone["deselected"] - sum(together[name] for name in outcomes), 0)
    return total


def verdict(codes: Sequence[int]) -> int:
    """Exit code of both halves: the first that failed; nothing collected only if in both."""
    failed = [code for code in codes if code not in (0, NOTHING_COLLECTED)]
    if failed:
        return failed[0]
    return 0 if 0 in codes else NOTHING_COLLECTED


def main(words: Sequence[str]) -> int:
    """Run both halves; 0 if both passed."""
    expression, others = split_marks(words)
    began, codes, found = time.monotonic(), [], [Counter[str](), Counter[str]()]
    halves = (
        [
            *TOGETHER_BY,
            "-m",
            selection(TOGETHER, expression),
            *others,
        ],
        ["-m", selection(ALONE, expression), *others],
    )
    for k, half in enumerate(halves):
        code, found[k] = run_half(half)
        codes.append(code)
        if code not in (0, NOTHING_COLLECTED) and {"-x", "--exitfirst"} & set(others):
            break
    print(closing_line(add_up(*found), time.monotonic() - began), flush=True)
    return verdict(codes)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
