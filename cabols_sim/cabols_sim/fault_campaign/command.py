# SPDX-License-Identifier: Apache-2.0
"""Options of the command `fault_campaign`."""

from __future__ import annotations

from pathlib import Path

from cabols_control.command_line import CommandParser, rig_option

TEXT = """Every fault, many times, in the simulated rig: first in one process, in every state of the
rig, then with the real nodes under load.

Goes on where it was interrupted; build/faults/generated.jsonl and trials.jsonl keep every trial."""

PARTS = ("all", "generated", "nodes", "crossed", "hanging")


def fault_campaign_parser() -> CommandParser:
    """Return the parser."""
    parser = CommandParser("fault_campaign", TEXT)
    rig_option(parser)
    add = parser.add_argument
    add("--output", type=Path, default=Path("build/faults"), help="folder (default: %(default)s)")
    add("--seeds", type=int, default=20, help="trials of each kind (default: %(default)s)")
    add(
        "--generated", type=int, default=12, help="trials of each kind in one process (%(default)s)"
    )
    add(
        "--short",
        action="store_true",
        help="one trial of each kind in one process, none with the real nodes: minutes",
    )
    add(
        "--minutes",
        type=float,
        default=0.0,
        help="end after so long, judge what is there; 0: when all is done (default: %(default)s)",
    )
    add(
        "--part",
        choices=PARTS,
        default=PARTS[0],
        help="in one process; with the real nodes, under load; kinds of the first part once more "
        "with the real nodes, in each state; a rig whose platform hangs on its cables, in one "
        "process; or all (default: %(default)s)",
    )
    add("--only", default="", help="only kinds whose name contains this")
    add("--fresh", action="store_true", help="forget the trials done so far")
    add(
        "--speed",
        type=float,
        default=1.0,
        help="of the rig's time: without real-time scheduling, slow motion (0.3) keeps this "
        "computer's stalls out of the watchdogs of 10 ms (default: %(default)s)",
    )
    return parser
