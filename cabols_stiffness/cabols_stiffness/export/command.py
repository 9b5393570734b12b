"""cabols-stiffness export: identified joints for a simulator, as URDF, SDF, MuJoCo or CSV.

`cabols-stiffness export result.yaml --robot robot.urdf --to mujoco` writes robot.mjcf.xml beside
the result. Every joint gets a spring about its commanded position (--at: where that is; a loaded
simulation may set it anew) and a little damping. A file holds the joints alone: what a result has
besides (base, links, cubic terms) is named. A result of another robot, or one whose model does not
explain its data, is refused.
"""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cabols_control.command_line import DONE, CommandParser
from cabols_control.configuration import read_yaml
from cabols_control.errors import UsageError
from cabols_control.rig_folder import rig_file
from cabols_stiffness.data_files.command_words import joint_position
from cabols_stiffness.export.gazebo import to_sdf, to_urdf
from cabols_stiffness.export.mujoco import to_mujoco
from cabols_stiffness.export.springs import Springs, springs_of
from cabols_stiffness.model.denavit_hartenberg import ENDINGS
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.result_file import read_result, tool_of
from cabols_stiffness.model.robot import RobotModel, load_robot

NAMES = {"urdf": "urdf", "sdf": "sdf", "mujoco": "mjcf.xml", "csv": "springs.csv"}


def main(words: Sequence[str]) -> int:
    """Export; 0, 1 if the result cannot be used, 2 for a wrong command line."""
    options = _arguments(words)
    result = read_result(options.result)
    place, turn = tool_of(read_yaml(options.result))
    locked = dict(joint_position(word) for word in options.lock)
    robot = load_robot(options.robot or None, options.tip, place, turn, locked=locked)
    springs = springs_of(result, robot)
    command = np.zeros(robot.n) if options.at is None else np.array(options.at)
    if command.shape != (robot.n,):
        raise UsageError(
            f"--at: expected {robot.n} positions, one a joint [rad, m], got {command.size}"
        )
    path = Path(options.output or options.result.with_name(f"robot.{NAMES[options.to]}"))
    if path.exists() and not options.overwrite:
        raise UsageError(f"{path}: expected no such file yet, got one; --overwrite replaces it")
    if options.to == "urdf":
        source = Path(rig_file("robot.urdf", options.robot or None))
        if source.suffix.lower() in ENDINGS:
            raise UsageError(f"{source}: expected a URDF to add springs to, got a table; use sdf")
        text = to_urdf(source, robot, springs, command)
    elif options.to == "sdf":
        text = to_sdf(robot, springs, command)
    elif options.to == "mujoco":
        text = to_mujoco(robot, springs, command)
    else:
        text = to_csv(result, robot, springs)
    path.write_text(text, encoding="utf-8")
    for what in springs.left_out:
        print(f"left out: {what}; the simulated robot is stiffer by that")
    print(f"  {path}")
    return DONE


def to_csv(result: StiffnessResult, robot: RobotModel, springs: Springs) -> str:
    """CSV of the springs with their deviations.

    Args:
        result: of an identification.
        robot: that it is of.
        springs: of both.
    """
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(["joint", "unit", "stiffness", "deviation", "low_95", "high_95", "friction"])
    for j, name in enumerate(robot.joint_names):
        numbers = (
            springs.stiffness[j],
            result.standard_deviation[j],
            *result.interval[j],
            springs.friction[j],
        )
        unit = "N/m" if robot.slides[j] else "N m/rad"
        rows.writerow([name, unit, *(f"{float(value):.8g}" for value in numbers)])
    return out.getvalue()


def _arguments(words: Sequence[str]) -> argparse.Namespace:
    parser = CommandParser("cabols-stiffness export", __doc__)
    add = parser.add_argument
    add("result", type=Path, metavar="RESULT", help="result.yaml of an identification")
    add("--to", required=True, choices=list(NAMES), help="form of the file")
    add("--robot", default="", help="as for identify; default: the bench's IRB 1600")
    add("--tip", default="", help="link that carries the tool; default: tool0 or flange")
    add("--lock", action="append", default=[], metavar="JOINT=POSITION", help="hold a joint there")
    add("--at", nargs="+", type=float, metavar="Q", help="commanded positions [rad, m]; default 0")
    add("--output", default="", help="file to write; default: beside the result")
    add("--overwrite", action="store_true", help="replace it if it exists")
    return parser.parse_args(words)
