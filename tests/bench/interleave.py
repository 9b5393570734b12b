# SPDX-License-Identifier: Apache-2.0
"""Run one benchmark alternately in two checkouts and print the ratios of their figures.

Usage: python tests/bench/interleave.py BASE --bench tension [--rounds 3] [-- ARGUMENTS]

BASE is the folder of another checkout with its own .venv, e.g. a worktree of the commit before.
Each checkout's package sources and Python are used. A script that BASE lacks is taken from here.
What the machine does besides hits both alike, so that ratios tell more than two runs in a row.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(HERE / "tools"))
from setup_workspace import clean_environment  # noqa: E402

PACKAGES = ("cabols_control", "cabols_hw", "cabols_sim", "cabols_stiffness")


def numbers(document: Any, prefix: str = "") -> dict[str, float]:
    """Every number of a JSON document by its dotted place."""
    found: dict[str, float] = {}
    items = document.items() if isinstance(document, dict) else []
    for key, value in items:
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            # Older files have their figures at the top level, newer ones in `figures`.
            found |= numbers(value, prefix if key == "figures" else f"{name}.")
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            found[name] = float(value)
    return found


def run(checkout: Path, bench: str, arguments: list[str]) -> dict[str, float]:
    """Run a benchmark of a checkout once; its figures.

    Args:
        checkout: folder of the checkout.
        bench: name, as in bench_NAME.py.
        arguments: more for the script.
    """
    script = f"tests/bench/bench_{bench}.py"
    path = checkout / script if (checkout / script).exists() else HERE / script
    sources = os.pathsep.join(str(checkout / package) for package in PACKAGES)
    # Without what this checkout's wheels told the loader: the other one has libraries of its own.
    environment = {**clean_environment(), "PYTHONPATH": sources, "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "figures.json"
        command = [checkout / ".venv/bin/python", path, "--output", output, *arguments]
        done = subprocess.run(
            command, check=False, cwd=checkout, env=environment, capture_output=True, text=True
        )
        if done.returncode:
            sys.exit(f"{path} ended with {done.returncode}:\n{done.stderr or done.stdout}")
        return numbers(json.loads(output.read_text(encoding="utf-8")))


def compare(
    before: list[dict[str, float]], now: list[dict[str, float]]
) -> dict[str, dict[str, float | None]]:
    """Medians over the rounds of every figure that all have, and their ratio (None: of nothing)."""
    ratios: dict[str, dict[str, float | None]] = {}
    for name in now[0]:
        if all(name in figures for figures in (*before, *now)):
            base, here = (statistics.median(f[name] for f in runs) for runs in (before, now))
            ratios[name] = {"base": base, "here": here, "ratio": here / base if base else None}
    return ratios


def main() -> int:
    """Alternate, print, write build/bench/against_NAME.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("base", type=Path, help="folder of the other checkout")
    parser.add_argument("--bench", default="limb_step", help="NAME of bench_NAME.py")
    parser.add_argument("--rounds", type=int, default=3)
    at = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    more = sys.argv[at + 1 :]
    options = parser.parse_args(sys.argv[1:at])
    base = options.base.resolve()
    if not (base / ".venv/bin/python").exists():
        parser.error(f"{base}: expected a checkout with its .venv; run `make setup` in it")
    if options.rounds < 1:
        parser.error(f"--rounds: expected at least 1, got {options.rounds}")
    taken: dict[Path, list[dict[str, float]]] = {base: [], HERE: []}
    for turn in range(options.rounds):
        for checkout in (base, HERE):
            taken[checkout].append(run(checkout, options.bench, more))
        print(f"round {turn + 1} of {options.rounds} done", file=sys.stderr)
        ratios = compare(taken[base], taken[HERE])
        # After every round, so that an interruption loses one round and not all.
        output = HERE / f"build/bench/against_{options.bench}.json"
        output.parent.mkdir(parents=True, exist_ok=True)
        document = {"rounds": turn + 1, "figures": ratios}
        output.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    for name, figure in ratios.items():
        ratio = figure["ratio"]
        shown = "       -" if ratio is None else f"{ratio:8.3f}"
        print(
            f"{name:44s} base {figure['base']:12.4g}   here {figure['here']:12.4g}"
            f"   here/base {shown}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
