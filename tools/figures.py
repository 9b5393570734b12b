# SPDX-License-Identifier: Apache-2.0
"""Write the tables of docs/figures.md from what the benchmarks left in build/.

Usage: figures.py [--build build]      (`make figures`)

Each block of the page belongs to one command. A block whose JSON file exists is written anew, with
date and machine; the others stay as they are. Needs the environment of `make setup`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable
from datetime import datetime, timezone
from pathlib import Path

from figure_rows import BLOCKS, Block, Figures, Row
from structure import ROOT

PAGE = ROOT / "docs" / "figures.md"
ARCHITECTURE = ROOT / "docs" / "architecture.md"
RUNS = ("rigid_target", "all_bridges")
BUDGET_US = (
    ("plant", "plant (a rig's bridge has no physics to compute)", 250),
    ("wrench_controller", "wrench controller", 120),
    ("limb_controller", "limb controller", 120),
)
"""Loop, its name for people, and what it may take of a cycle [us]."""


def circumstances(content: Figures, path: Path) -> str:
    """Say when and where figures were measured.

    Args:
        content: of the JSON file.
        path: of the file; its date stands in where the content does not tell.
    """
    run = content.get("run")
    if not run:
        date = datetime.fromtimestamp(path.stat().st_mtime, timezone.utc)
        return f"Measured {date:%Y-%m-%d}."
    return (
        f"Measured {run['date']} at commit {run['commit']}: {run['processor']}, "
        f"{run['cores']} cores, load {run['load_average']:.1f} at the end, Python {run['python']}."
    )


def table(rows: Iterable[Row]) -> list[str]:
    """Write rows as a Markdown table; a target that is missed is said in bold."""
    lines = ["| | measured | target |", "|---|---|---|"]
    for what, measured, target, met in rows:
        verdict = "" if met is None else ", **met**" if met else ": **not met**"
        lines.append(f"| {what} | {measured} | {target}{verdict} |")
    return lines


def render(block: Block, path: Path) -> str:
    """Write one block from its file.

    Args:
        block: which.
        path: of the JSON.

    Raises:
        ValueError: if the file lacks a figure.
    """
    content = json.loads(path.read_text(encoding="utf-8"))
    try:
        rows = list(block.rows(content))
    except (KeyError, IndexError, TypeError) as error:
        raise ValueError(f"{path}: expected figures as of today, got none for {error}; "
                         "run the benchmark again") from error  # fmt: skip
    lines = [f"### {block.title}", "", circumstances(content, path), "", *table(rows)]
    return "\n".join(lines)


def replaced(page: str, name: str, text: str) -> str:
    """Put a text between the markers of a block.

    Args:
        page: the page.
        name: of the block.
        text: new content.

    Raises:
        ValueError: if the page does not hold both markers once.
    """
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    if page.count(begin) != 1 or page.count(end) != 1:
        raise ValueError(f"expected {begin} and {end}, once each: put them in the page")
    head, rest = page.split(begin)
    return f"{head}{begin}\n\n{text}\n\n{end}{rest.split(end)[1]}"


def budget(content: Figures) -> str:
    """Write what each control loop may take of a cycle, and takes."""
    lines = [
        "| loop | budget [us] | rigid target: median, p99 [us] | all bridges: median, p99 [us] |"
    ]
    lines += ["|---|---|---|---|"]
    for name, label, allowed in BUDGET_US:
        work = [content[run]["work"][name] for run in RUNS]
        cells = [f"{1e6 * w['median_s']:.0f}, {1e6 * w['p99_s']:.0f}" for w in work]
        lines.append(f"| {label} | {allowed} | {' | '.join(cells)} |")
    both = [content[run] for run in RUNS]
    trips = [
        f"{1e6 * run['round_trip_median_s']:.0f}, {1e6 * run['round_trip_p99_s']:.0f}"
        for run in both
    ]
    lines.append(f"| the whole round trip, transport included | 500 | {' | '.join(trips)} |")
    return "\n".join(lines)


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Write docs/figures.md from build/.")
    parser.add_argument("--build", type=Path, default=ROOT / "build", help="where the figures are")
    build = parser.parse_args().build
    page = PAGE.read_text(encoding="utf-8")
    for block in BLOCKS:
        path = build / block.file
        if path.exists():
            page = replaced(page, f"figures: {block.name}", render(block, path))
        print(
            f"{block.name:16} {'written from ' + str(path) if path.exists() else 'left as it is'}"
        )
    PAGE.write_text(page, encoding="utf-8")
    realtime_file = build / "bench" / "realtime.json"
    if realtime_file.exists():
        content = json.loads(realtime_file.read_text(encoding="utf-8"))
        text = "\n".join([circumstances(content, realtime_file), "", budget(content)])
        old = ARCHITECTURE.read_text(encoding="utf-8")
        ARCHITECTURE.write_text(replaced(old, "budget", text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
