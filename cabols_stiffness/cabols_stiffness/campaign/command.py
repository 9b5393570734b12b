# SPDX-License-Identifier: Apache-2.0
"""Options of the command `run_campaign`."""

from __future__ import annotations

from pathlib import Path

from cabols_control.command_line import CommandParser, existing_path

START_S = 180.0
"""The nodes must run within this; a first start compiles for a minute or two."""


def run_campaign_parser() -> CommandParser:
    """Return the parser."""
    parser = CommandParser(
        "run_campaign", "Begin a campaign, or go on with one; show it; Ctrl-C aborts it."
    )
    add = parser.add_argument
    add(
        "--campaign", type=existing_path, help="campaign.yaml; default: the folder's, or the node's"
    )
    add("--folder", type=Path, help="where the data go; one with data in it is continued")
    add("--accuracy", type=float, default=0.0, help="stop at this relative deviation; 0: never")
    add("--wait", type=float, default=START_S, help="s until it must have begun")
    return parser
