"""Options of the command `fault_campaign`."""

from __future__ import annotations

from pathlib import Path

from cabols_control.command_line import CommandParser, rig_option

TEXT = """Every fault, many times, in the loaded simulated rig.

Goes on where it was interrupted; build/faults/trials.jsonl keeps every trial."""


def fault_campaign_parser() -> CommandParser:
    """Return the parser."""
    parser = CommandParser("fault_campaign", TEXT)
    rig_option(parser)
    add = parser.add_argument
    add("--output", type=Path, default=Path("build/faults"), help="folder (default: %(default)s)")
    add("--seeds", type=int, default=20, help="trials of each kind (default: %(default)s)")
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
