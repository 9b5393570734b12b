# SPDX-License-Identifier: Apache-2.0
"""Run the tests again and again with a busy loop on one core beside them, until one run fails.

python tools/stress_tests.py [--runs 5] [--fresh] [-- pytest's arguments]

Each run's figures are in build/stress/runs.json: a call that was cut goes on where it was, as long
as the tree and the arguments are the same. Exit code: 0 every run passed, 1 one failed.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import time
from hashlib import sha256
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "build" / "stress"
CLOSING = re.compile(r"^=+ (.* in [\d.]+s.*) =+$", re.MULTILINE)
BUSY = "import os, sys; os.sched_setaffinity(0, {int(sys.argv[1])})\nwhile True: pass"


def tree() -> str:
    """What is tested: the commit, and what is changed beside it."""

    def git(*words: str) -> str:
        command = ["git", "-C", str(ROOT), *words]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout

    return f"{git('rev-parse', 'HEAD').strip()} {hash_of(git('diff', 'HEAD'))}"


def hash_of(text: str) -> str:
    """Short digest of a text."""
    return sha256(text.encode()).hexdigest()[:12]


def run_once(number: int, words: list[str]) -> dict[str, Any]:
    """Run the tests once beside the busy loop; return the run's figures."""
    log = FOLDER / f"run_{number}.log"
    core = max(os.sched_getaffinity(0))
    busy = subprocess.Popen([sys.executable, "-c", BUSY, str(core)])
    began = time.monotonic()
    try:
        with log.open("w", encoding="utf-8") as stream:
            command = [sys.executable, str(ROOT / "tools" / "run_tests.py"), *words]
            code = subprocess.run(
                command, check=False, cwd=ROOT, stdout=stream, stderr=subprocess.STDOUT
            ).returncode
    finally:
        busy.kill()
        busy.wait()
    found = CLOSING.findall(log.read_text(encoding="utf-8"))
    return {
        "run": number,
        "exit_code": code,
        "seconds_s": round(time.monotonic() - began, 1),
        "closing_line": found[-1].strip() if found else "",
        "log": str(log.relative_to(ROOT)),
    }


def table(runs: list[dict[str, Any]]) -> str:
    """One line a run."""
    lines = [f"{'run':>3}  {'time [s]':>8}  result"]
    for run in runs:
        verdict = "passed" if run["exit_code"] == 0 else f"FAILED ({run['log']})"
        lines.append(f"{run['run']:3d}  {run['seconds_s']:8.1f}  {verdict}: {run['closing_line']}")
    return "\n".join(lines)


def main() -> int:
    """Run until one fails, or all have passed."""
    parser = argparse.ArgumentParser(prog="stress_tests", description=__doc__)
    parser.add_argument("--runs", type=int, default=5, help="how many (default: %(default)s)")
    parser.add_argument("--fresh", action="store_true", help="do not go on with what was cut")
    parser.add_argument("words", nargs="*", help="pytest's arguments")
    options = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    file, what = FOLDER / "runs.json", {"tree": tree(), "arguments": options.words}
    before = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    same = {key: before.get(key) for key in what} == what and not options.fresh
    runs = [run for run in before.get("runs", []) if run["exit_code"] == 0] if same else []
    for number in range(len(runs) + 1, options.runs + 1):
        print(f"run {number} of {options.runs} beside a busy loop", flush=True)
        runs.append(run_once(number, options.words))
        file.write_text(json.dumps({**what, "runs": runs}, indent=2) + "\n", encoding="utf-8")
        if runs[-1]["exit_code"]:
            break
    print(table(runs))
    return int(any(run["exit_code"] for run in runs) or len(runs) < options.runs)


if __name__ == "__main__":
    sys.exit(main())
