# SPDX-License-Identifier: Apache-2.0
"""Options of the command `commission`."""

from __future__ import annotations

from pathlib import Path

from cabols_control.command_line import CommandParser, existing_file, rig_option

TEXT = """Commission limbs of a running rig.

Writes limbs.yaml, gains.yaml, a table and figures."""


def commission_parser() -> CommandParser:
    """Return the parser."""
    parser = CommandParser("commission", TEXT)
    rig_option(parser)
    add = parser.add_argument
    add("--limb", type=int, action="append", help="from 1; repeat; default: all")
    add("--output", type=Path, default=Path("build/commission"), help="to fill")
    add("--no-step", action="store_true", help="do not identify gain and time")
    add("--no-ramp", action="store_true", help="do not identify the stiffness")
    add("--step-current", type=float, default=0.0, help="A (default: 0.5)")
    add("--ramp-tension", type=float, default=0.0, help="N (default: 150)")
    add("--backlash", action="store_true", help="write the gears' play, which control then knows")
    add("--speed", type=float, default=1.0, help="of a simulated rig's time")
    for name in ("geometry", "limbs", "control"):
        add(f"--{name}-file", type=existing_file, default="", help="as the rig runs with")
    return parser


POWER_ON_TEXT = """Check a rig's wiring at its first power-on.

Winds one limb after the other at 0.1 A for at most 5 mm, with slack cables, and compares what
moved, which switch closed and what the force/torque sensor felt with the configuration. Until all
limbs have passed, the rig's bridge lets nothing else move."""


def power_on_parser() -> CommandParser:
    """Return the parser of `first_power_on`."""
    parser = CommandParser("first_power_on", POWER_ON_TEXT)
    rig_option(parser)
    parser.add_argument("--limb", type=int, action="append", help="from 1; repeat; default: all")
    parser.add_argument("--file", type=Path, default=None, help="result; default: the state folder")
    return parser
