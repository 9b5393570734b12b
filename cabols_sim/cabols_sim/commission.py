"""Limb commissioning on the simulated rig: starts the bench, runs the tool there, ends both."""

from __future__ import annotations

import argparse
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

from cabols_control.graph import NodeSpec, bench_graph, with_arguments
from cabols_control.processes import run
from cabols_sim.bench_run import isolated_environment, two_cores

TOOL = "commission"
STALL_S = 0.1
"""Watchdogs as in the demo: a desktop's kernel may stall for longer than a rig's allow."""


@dataclass(frozen=True)
class ToolSpec(NodeSpec):
    """A tool among the nodes: it takes plain arguments, and all end with it."""

    words: tuple[str, ...] = ()

    def arguments(self) -> list[str]:
        """Return the command line behind the executable's name."""
        return list(self.words)


def main() -> int:
    """Commission the simulated rig; returns 0, 1 after a failure, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(prog="commission_bench", description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/commission"), help="to fill")
    parser.add_argument("--limb", type=int, action="append", help="from 1; repeat; default: all")
    parser.add_argument("--seed", type=int, default=0, help="of the simulated rig's noise")
    arguments = parser.parse_args()
    output = arguments.output
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir(parents=True)
    words = ["--output", str(output)]
    for limb in arguments.limb or []:
        words += ["--limb", str(limb)]
    values = {
        "seed": arguments.seed,
        "watchdog": STALL_S,
        "command_timeout": STALL_S,
        **two_cores(),
    }
    nodes = with_arguments(bench_graph(record=False), values)
    tool = ToolSpec("cabols_control", TOOL, ("limb_state", "wrench"), (), words=tuple(words))
    print("cabols commissioning: all limbs of the simulated rig, real time at 1 kHz", flush=True)
    ended = run([*nodes, tool], isolated_environment(), _show, output / "log")
    if not ended.first:
        print(f"interrupted: all nodes ended, motors at zero; what was done is in {output}")
        return 130
    if ended.first != TOOL or ended.code != 0:
        log = output / "log" / f"{ended.first}.log"
        print(f"error: {ended.first} ended with code {ended.code}: {log}", file=sys.stderr)
        return 1
    return 0


def _show(node: str, line: str) -> None:
    """Show the tool's lines, and of the others what is not well."""
    if node == TOOL:
        print(line, flush=True)
    elif any(word in line for word in ("error", "ERROR", "WARN", "Traceback")):
        print(f"  {node}: {line.rpartition(']: ')[2]}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
