# SPDX-License-Identifier: Apache-2.0
"""Options of the command `workspace`; light to import, as `--help` needs no more."""

from __future__ import annotations

import argparse
from math import inf
from pathlib import Path

from cabols_control.command_line import rig_option

DESIGN_PATTERNS = ("alternating", "aligned", "opposed", "given")
"""Families of `cabols_control.workspace.design`; a test holds the two together."""
EXCHANGED = ("caspr", "cdpyr", "wirex")
"""Formats of other programs; likewise."""
STIFFNESS_POSITIONS = 5


def rig_options(parser: argparse.ArgumentParser) -> None:
    """Options that every subcommand takes."""
    rig_option(parser)
    parser.add_argument("--geometry", type=Path, help="YAML of another robot; default: the rig's")
    parser.add_argument("--control", type=Path, help="YAML with the tension limits")
    parser.add_argument("--bodies", type=Path, help="YAML of platform and target")
    parser.add_argument("--no-bodies", action="store_true", help="leave interference out")
    parser.add_argument(
        "--box",
        type=float,
        nargs=6,
        metavar=("FX", "FY", "FZ", "MX", "MY", "MZ"),
        help="required wrenches: half widths of a box [N, N m] (default: the robot's "
        "required_wrench, or 50 N, 5 N m)",
    )
    parser.add_argument("--wrenches", type=Path, help="CSV, six columns: their convex hull instead")
    parser.add_argument(
        "--platform-axes", action="store_true", help="required wrenches turn with the platform"
    )
    parser.add_argument("--output", type=Path, default=Path("build/workspace"), help="folder")


def worker_options(parser: argparse.ArgumentParser) -> None:
    """Add the options about workers."""
    parser.add_argument(
        "--scheduler",
        default="local",
        help='"local" processes (default), "inline", or a Dask scheduler: tcp://HOST:8786',
    )
    parser.add_argument("--workers", type=int, help="local processes (default: one per core)")


def add_map(parser: argparse.ArgumentParser) -> None:
    """Options of `workspace map` beside those of a rig and of workers."""
    parser.add_argument(
        "--half-widths",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="of the grid round the reference position [m] (default: 0.6 0.5 0.5, for another "
        "rig or robot a third of the frame's sides)",
    )
    parser.add_argument(
        "--counts",
        type=int,
        nargs=3,
        default=[25, 25, 25],
        metavar=("NX", "NY", "NZ"),
        help="positions along each axis",
    )
    parser.add_argument(
        "--tilt",
        type=float,
        default=15.0,
        help="+- about each axis, the orientations that must all do [deg]; 0: one orientation",
    )
    parser.add_argument(
        "--in-pieces",
        action="store_true",
        help="for maps beyond memory: results as pieces in a folder, which a later run completes; "
        "no table, meshes and figures",
    )


def add_design(parser: argparse.ArgumentParser) -> None:
    """Options of the subcommand."""
    parser.add_argument(
        "--patterns",
        nargs="+",
        choices=DESIGN_PATTERNS,
        help="families of rigs (default: of another robot than the bench, given, which stretches "
        "and turns its own points; of the bench, the three of its own)",
    )
    parser.add_argument("--tilt", type=float, default=15.0, help="+- about each axis [deg]")
    parser.add_argument("--generations", type=int, default=80, help="of differential evolution")
    parser.add_argument("--population", type=int, default=48, help="rigs in a generation")
    parser.add_argument("--seed", type=int, default=1)
    parser.set_defaults(output=Path("build/design"))


def add_stiffness(parser: argparse.ArgumentParser) -> None:
    """Options of the subcommand."""
    parser.add_argument(
        "--spring", type=float, nargs="+", help="k_e, one or one a cable [N/m] (default: the rig's)"
    )
    parser.add_argument(
        "--axial", type=float, default=inf, help="EA of the cables [N] (default: no stretch)"
    )
    parser.add_argument(
        "--counts", type=int, nargs=3, default=[STIFFNESS_POSITIONS] * 3, metavar=("NX", "NY", "NZ")
    )
    parser.add_argument("--half-widths", type=float, nargs=3, metavar=("X", "Y", "Z"))
    parser.add_argument("--tilt", type=float, default=0.0, help="+- about each axis [deg]")


def add_import(parser: argparse.ArgumentParser) -> None:
    """Options of `workspace import`.

    Args:
        parser: of the subcommand.
    """
    parser.add_argument(
        "files",
        nargs="+",
        type=Path,
        help="CASPR: NAME_bodies.xml NAME_cables.xml; WireX: .xml, .txt or both; cdpyr: one .json "
        "or .yaml",
    )
    parser.add_argument(
        "--position",
        type=float,
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="of the reference pose [m], in place of the file's",
    )
    parser.add_argument("--cable-set", default="", help="of CASPR's file (default: its own)")
    parser.add_argument("--output", type=Path, default=Path("robot.yaml"), help="robot file")


def add_export(parser: argparse.ArgumentParser) -> None:
    """Options of `workspace export` beside those of a rig.

    Args:
        parser: of the subcommand.
    """
    parser.add_argument("--format", choices=EXCHANGED, required=True)
    parser.add_argument("--name", default="robot", help="of the files")


def add_loss(parser: argparse.ArgumentParser) -> None:
    """Options of the subcommand."""
    parser.add_argument("--count", type=int, default=20_000, help="wrenches drawn from the box")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
