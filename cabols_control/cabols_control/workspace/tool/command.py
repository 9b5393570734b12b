# SPDX-License-Identifier: Apache-2.0
"""Command `workspace`: maps, meshes and figures of a rig's workspace, no ROS needed.

workspace map            the workspace on a grid of positions and orientations
workspace trajectory     margins along the poses of a CSV file
workspace design         attachment points for the largest workspace
workspace stiffness      how far the required wrenches move the platform
workspace loss           which wrenches remain when a cable parts
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from cabols_control.command_line import DONE, CommandParser, command

from . import options as given

POSES = "x_m, y_m, z_m, rx_deg, ry_deg, rz_deg"


def workspace_parser() -> CommandParser:
    """Return the parser of the command and its subcommands."""
    parser = CommandParser(
        "workspace", "Where a cable rig can give the required wrenches without touching itself."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    mapping = commands.add_parser("map", help="the workspace on a grid")
    given.rig_options(mapping)
    given.worker_options(mapping)
    given.add_map(mapping)
    trajectory = commands.add_parser("trajectory", help="margins along poses of a CSV file")
    given.rig_options(trajectory)
    trajectory.add_argument("poses", type=Path, help=f"CSV: {POSES}")
    design = commands.add_parser("design", help="attachment points for the largest workspace")
    given.rig_options(design)
    given.worker_options(design)
    given.add_design(design)
    elastic = commands.add_parser("stiffness", help="how far loads move the platform")
    given.rig_options(elastic)
    given.add_stiffness(elastic)
    lost = commands.add_parser("loss", help="which wrenches remain when a cable parts")
    given.rig_options(lost)
    given.add_loss(lost)
    taken = commands.add_parser("import", help="a robot file from files of CASPR or cdpyr")
    given.add_import(taken)
    other = commands.add_parser("export", help="a robot in the format of CASPR or cdpyr")
    given.rig_options(other)
    given.add_export(other)
    return parser


@command
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    options = workspace_parser().parse_args(arguments)
    # Compiled code and figures take seconds to import, and only what is run needs them.
    from .maps import RUN

    RUN[options.command](options)
    return DONE


if __name__ == "__main__":
    sys.exit(main())
