# SPDX-License-Identifier: Apache-2.0
"""Command: what this computer's kernel gives a control loop, and what to set."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from cabols_control.command_line import DONE, FAILED, CommandParser, command
from cabols_control.realtime.kernel_check import judge, read_facts, run_timer, stolen_share

TEXT = """Say what this computer's kernel gives a control loop of 1 kHz, and what to set.

Looks at the kernel and at what it allows this user, and lets a bare timer run, in the ordinary
class and, where it is allowed, in the real-time class."""
STAT = Path("/proc/stat")


def _stat() -> str:
    return STAT.read_text(encoding="utf-8").partition("\n")[0]


@command
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; returns 0, 1 if something is not as a rig wants it, 2 for wrong words."""
    parser = CommandParser("rt_check", TEXT)
    parser.add_argument("--seconds", type=float, default=5.0, help="of each timer's run")
    parser.add_argument("--output", type=Path, default=None, help="JSON file of the same")
    options = parser.parse_args(arguments)
    if not 0.1 <= options.seconds <= 3600.0:
        parser.error(f"--seconds: expected 0.1 to 3600, got {options.seconds:g}")
    facts, before = read_facts(), _stat()
    runs = [run_timer(options.seconds, fifo) for fifo in (False, True) if not fifo or facts.fifo]
    stolen = stolen_share(before, _stat())
    findings = judge(facts, runs, stolen)
    width = max(len(finding.subject) for finding in findings)
    for finding in findings:
        print(f"{'good' if finding.good else 'SET ':4}  {finding.subject:{width}}  {finding.found}")
    wanting = [finding for finding in findings if not finding.good]
    if wanting:
        print("\nTo set:")
    for finding in wanting:
        print(f"  {finding.subject}: {finding.advice}")
    if options.output is not None:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(
            {
                "facts": asdict(facts),
                "timers": [asdict(run) for run in runs],
                "stolen_share": stolen,
                "not_as_wanted": [finding.subject for finding in wanting],
            },
            indent=2,
        )
        options.output.write_text(text + "\n", encoding="utf-8")
    return FAILED if wanting else DONE


if __name__ == "__main__":
    sys.exit(main())
