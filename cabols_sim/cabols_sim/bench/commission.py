# SPDX-License-Identifier: Apache-2.0
"""Limb commissioning on the simulated rig: starts the bench, runs the tool there, ends both."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

from cabols_control.bringup.log_line import read_line
from cabols_control.bringup.specs import NodeSpec
from cabols_control.command_line import (
    DONE,
    FAILED,
    INTERRUPTED,
    CommandParser,
    command,
    fail,
    rig_option,
)
from cabols_control.files.output_folder import output_folder
from cabols_control.naming import limb_names
from cabols_sim.bench.run import forgiving, real_time_arguments, run_bench

TOOL = "commission"


@dataclass(frozen=True)
class ToolSpec(NodeSpec):
    """A tool among the nodes, with plain arguments; all nodes end with it."""

    words: tuple[str, ...] = ()

    def arguments(self) -> list[str]:
        """Return the command line behind the executable's name."""
        return list(self.words)


@command
def main() -> int:
    """Commission the simulated rig; returns 0, 1 after a failure, 130 after Ctrl-C."""
    arguments = _arguments()
    with output_folder(arguments.output, "commission_bench") as folder:
        code = _run(arguments)
        if code == DONE:
            folder.finish()
    return code


def _run(arguments: argparse.Namespace) -> int:
    """Run bench and tool to the tool's end."""
    output = arguments.output
    values = {
        "rig": arguments.rig,
        "record": False,
        "robot": arguments.robot,
        "seed": arguments.seed,
        "speed": arguments.speed,
        **forgiving(arguments.speed),
        **real_time_arguments(),
    }
    pace = "real time" if arguments.speed == 1.0 else f"{arguments.speed:g} of real time"
    which = limb_names(limb - 1 for limb in arguments.limb) if arguments.limb else "all limbs"
    print(f"cabols commissioning: {which} of the simulated rig, {pace} at 1 kHz", flush=True)
    tool = ToolSpec("cabols_control", TOOL, (), (), words=_words(arguments))
    ended = run_bench(values, _show, output / "log", tools=[tool])
    if not ended.first:
        print(f"interrupted: all nodes ended, motors at zero; what was done is in {output}")
        return INTERRUPTED
    if ended.first != TOOL or ended.code != 0:
        log = output / "log" / f"{ended.first}.log"
        if arguments.speed == 1.0:
            print("on a busy machine try --speed 0.3: the rig in slow motion", file=sys.stderr)
        return fail(f"{ended.first} ended with code {ended.code}: {log}", FAILED)
    return DONE


def _arguments() -> argparse.Namespace:
    parser = CommandParser("commission_bench", __doc__)
    rig_option(parser)
    add = parser.add_argument
    add("--output", type=Path, default=Path("build/commission"), help="folder to fill")
    add("--limb", type=int, action="append", help="from 1; repeat; default: all")
    add("--no-step", action="store_true", help="do not identify gain and time constant")
    add("--no-ramp", action="store_true", help="do not identify the stiffness")
    add("--ramp-tension", type=float, default=0.0, help="N (default: 150)")
    add("--seed", type=int, default=0, help="of all noise of the simulated rig")
    add("--speed", type=float, default=1.0, help="below 1: the rig in slow motion")
    add(
        "--robot",
        action="store_true",
        help="with robot and tracker; k_e then contains the robot's deflection, up to a tenth",
    )
    return parser.parse_args()


def _words(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Command line of the tool."""
    words = ["--rig", arguments.rig, "--output", str(arguments.output)]
    words += ["--speed", f"{arguments.speed:g}"]
    for limb in arguments.limb or []:
        words += ["--limb", str(limb)]
    for name in ("no_step", "no_ramp"):
        if getattr(arguments, name):
            words.append("--" + name.replace("_", "-"))
    if arguments.ramp_tension:
        words += ["--ramp-tension", f"{arguments.ramp_tension:g}"]
    return tuple(words)


def _show(node: str, line: str) -> None:
    """Show the tool's lines, and the other nodes' warnings and errors."""
    if node == TOOL:
        print(line, flush=True)
    elif (read := read_line(line)).loud:
        print(f"  {node}: {read.words}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
