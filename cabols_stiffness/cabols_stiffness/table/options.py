# SPDX-License-Identifier: Apache-2.0
"""Options of cabols-stiffness' tasks; nothing here needs numpy."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cabols_control.command_line import CommandParser
from cabols_control.parameters.declared import docstring_of
from cabols_stiffness.model.model_words import LINEAR, Rung, model_word

TASKS = {
    "correct": "cabols_stiffness.table.program",
    "export": "cabols_stiffness.export.command",
}
"""Besides identify, each with options of its own: modules whose `run` does it."""

EXPORTED = {"urdf": "urdf", "sdf": "sdf", "mujoco": "mjcf.xml", "csv": "springs.csv"}
"""Forms of a file, and the endings of its name."""


def _number(word: str) -> float:
    """Read a number; NaN where there is none."""
    try:
        return float(word)
    except ValueError:
        return math.nan


def positive(word: str) -> float:
    """Read a deviation: finite and above zero.

    Raises:
        ArgumentTypeError: if it is something else.
    """
    value = _number(word)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number above zero, got {word!r}")
    return value


def finite(word: str) -> float:
    """Read a coordinate.

    Raises:
        ArgumentTypeError: if it is not finite.
    """
    value = _number(word)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, got {word!r}")
    return value


def identify_options(words: Sequence[str]) -> argparse.Namespace:
    """Options of identify."""
    parser = CommandParser("cabols-stiffness", docstring_of("cabols_stiffness.table.command"))
    add = parser.add_argument
    add("task", choices=["identify", *TASKS], help="what to do")
    add("table", type=Path, metavar="TABLE", help="CSV or Parquet file")
    add("--robot", default="", help="URDF, or YAML or CSV of DH parameters; default: IRB 1600")
    add("--tip", default="", help="link that carries the tool; default: tool0 or flange")
    add("--lock", action="append", default=[], metavar="JOINT=POSITION", help="hold a joint there")
    add("--coupling", default="", help="YAML: joints_by_drives, a matrix, where drives are coupled")
    vector: dict[str, Any] = {"nargs": 3, "type": finite, "metavar": ("X", "Y", "Z")}
    add("--tool", default=(0.0, 0.0, 0.0), **vector, help="tool's origin, axes of the tip [m]")
    add("--reflector", default=(0.0, 0.0, 0.0), **vector, help="measured point, tool axes [m]")
    add("--anchor", default=None, **vector, help="other end of a distance, base axes [m]")
    axes = ["base", "tool"]
    add("--wrench-axes", default="base", choices=axes, help="axes of the wrench, at the tool")
    add("--mapping", default="", help="YAML: header: {as: name, unit: unit}")
    add(
        "--model",
        default=LINEAR,
        type=model_word,
        help="linear; cubic; auto: the ladder of models, by held-out configurations; or its rungs: "
        + "+".join(Rung),
    )
    add("--deviation-um", type=positive, default=20.0, help="of a displacement [um]")
    add("--deviation-urad", type=positive, default=80.0, help="of a rotation [urad]")
    add("--deviation-n", type=positive, default=0.5, help="of a force [N]")
    add("--deviation-nm", type=positive, default=0.05, help="of a torque [N m]")
    add("--statement", default="", help="YAML of a certificate: operator, instruments, type B")
    add("--output", type=Path, help="folder to fill; default: the table's name")
    return parser.parse_args(words)


def correct_options(words: Sequence[str]) -> argparse.Namespace:
    """Options of correct."""
    parser = CommandParser("cabols-stiffness correct", docstring_of(TASKS["correct"]))
    add = parser.add_argument
    add("program", type=Path, metavar="PROGRAM", help="CSV of points")
    add("--result", required=True, help="result.yaml of an identification; it has the tool")
    add("--robot", default="", help="as for identify; default: the bench's IRB 1600")
    add("--tip", default="", help="link that carries the tool; default: tool0 or flange")
    add("--lock", action="append", default=[], metavar="JOINT=POSITION", help="hold a joint there")
    add("--coupling", default="", help="YAML: joints_by_drives, a matrix, where drives are coupled")
    wrench: dict[str, Any] = {"nargs": 6, "type": finite, "default": None}
    axes = ("FX", "FY", "FZ", "MX", "MY", "MZ")
    add("--wrench", **wrench, metavar=axes, help="of all points, on the tool [N, N m]")
    add("--wrench-axes", default="base", choices=["base", "tool"], help="axes of the wrench")
    add("--anywhere", action="store_true", help="also where nothing was measured")
    add("--output", default="", help="CSV to write; default: PROGRAM_corrected.csv")
    add("--overwrite", action="store_true", help="replace it if it exists")
    return parser.parse_args(words)


def export_options(words: Sequence[str]) -> argparse.Namespace:
    """Options of export."""
    parser = CommandParser("cabols-stiffness export", docstring_of(TASKS["export"]))
    add = parser.add_argument
    add("result", type=Path, metavar="RESULT", help="result.yaml of an identification")
    add("--to", required=True, choices=list(EXPORTED), help="form of the file")
    add("--robot", default="", help="as for identify; default: the bench's IRB 1600")
    add("--tip", default="", help="link that carries the tool; default: tool0 or flange")
    add("--lock", action="append", default=[], metavar="JOINT=POSITION", help="hold a joint there")
    add("--coupling", default="", help="YAML: joints_by_drives, a matrix, where drives are coupled")
    add("--at", nargs="+", type=finite, metavar="Q", help="commanded positions [rad, m]; default 0")
    add("--output", default="", help="file to write; default: beside the result")
    add("--overwrite", action="store_true", help="replace it if it exists")
    return parser.parse_args(words)


OPTIONS = {"correct": correct_options, "export": export_options}
