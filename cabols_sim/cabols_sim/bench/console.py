# SPDX-License-Identifier: Apache-2.0
"""The operator's console with the simulated rig: all nodes, devices and the page, until Ctrl-C."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from cabols_control.bringup.log_line import read_line
from cabols_control.command_line import (
    DONE,
    FAILED,
    CommandParser,
    command,
    existing_file,
    fail,
    rig_option,
)
from cabols_control.files.output_folder import output_folder
from cabols_sim.bench.run import forgiving, real_time_arguments, run_bench

SHOWN = ("console", "supervisor", "recorder")
"""Nodes whose every line is for the operator: address, modes, bags."""


@command
def main() -> int:
    """Serve the page; returns 0 after Ctrl-C, 1 if a node ended by itself."""
    arguments = _arguments()
    # The folder holds bags, programmes and campaigns of many sessions: nothing is replaced.
    with output_folder(arguments.output, "console_bench", keep=True):
        return _run(arguments)


def _run(arguments: argparse.Namespace) -> int:
    """Run bench and page until Ctrl-C."""
    output = arguments.output
    values = {
        "rig": arguments.rig,
        "robot": not arguments.rigid,
        "console": True,
        "campaign": not arguments.rigid,
        "console_port": arguments.port,
        "console_host": arguments.host,
        "token_file": arguments.token_file,
        "campaigns": str(output / "campaigns"),
        "uploads": str(output / "programs"),
        # The page's button begins a bag.
        "record_at_start": False,
        "output": str(output / "bags" / "first"),
        "operator_timeout": arguments.operator_timeout,
        "seed": arguments.seed,
        "speed": arguments.speed,
        **forgiving(arguments.speed),
        **real_time_arguments(),
    }
    print(
        f"cabols console: the simulated rig at {arguments.speed:g} of real time; "
        f"http://localhost:{arguments.port} once it has started, Ctrl-C ends",
        flush=True,
    )
    ended = run_bench(values, _show, output / "log")
    if not ended.first:
        print("interrupted: all nodes ended, motors at zero")
        return DONE
    log = output / "log" / f"{ended.first}.log"
    return fail(f"{ended.first} ended with code {ended.code}: {log}", FAILED)


def _arguments() -> argparse.Namespace:
    parser = CommandParser("console_bench", __doc__)
    rig_option(parser)
    add = parser.add_argument
    add(
        "--output", type=Path, default=Path("build/console"), help="for bags, programmes, campaigns"
    )
    add("--port", type=int, default=8080, help="of the page (default: %(default)s)")
    add("--host", default="127.0.0.1", help="to serve at; others than loopback need --token-file")
    add(
        "--token-file",
        type=existing_file,
        default="",
        help="its first line is demanded of every visitor",
    )
    add("--rigid", action="store_true", help="a target that never moves: no robot, no tracker")
    add("--seed", type=int, default=0, help="of all noise of the simulated rig")
    add("--speed", type=float, default=1.0, help="below 1: the rig in slow motion")
    add(
        "--operator-timeout",
        type=float,
        default=10.0,
        help="s without the operator's page until the rig unloads (default: %(default)s)",
    )
    return parser.parse_args()


def _show(node: str, line: str) -> None:
    """Show the lines of console, supervisor and recorder, and other nodes' warnings and errors."""
    read = read_line(line)
    if node in SHOWN or read.loud:
        print(f"  {node}: {read.words}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
