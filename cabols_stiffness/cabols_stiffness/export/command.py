# SPDX-License-Identifier: Apache-2.0
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
from pathlib import Path

import numpy as np

from cabols_control.command_line import DONE
from cabols_control.configuration import read_yaml
from cabols_control.errors import UsageError
from cabols_control.rig_folder import rig_file
from cabols_stiffness.export.gazebo import to_sdf, to_urdf
from cabols_stiffness.export.mujoco import to_mujoco
from cabols_stiffness.export.springs import Springs, springs_of
from cabols_stiffness.model.denavit_hartenberg import ENDINGS
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.result_file import read_result, tool_of
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.table.options import EXPORTED
from cabols_stiffness.table.robot_options import robot_of


def run(options: argparse.Namespace) -> int:
    """Export; 0.

    Raises:
        CabolsError: if the result cannot be used.
    """
    result = read_result(options.result)
    place, turn = tool_of(read_yaml(options.result))
    robot = robot_of(options, place, turn)
    springs = springs_of(result, robot)
    command = np.zeros(robot.n) if options.at is None else np.array(options.at)
    if command.shape != (robot.n,):
        raise UsageError(
            f"--at: expected {robot.n} positions, one a joint [rad, m], got {command.size}"
        )
    path = Path(options.output or options.result.with_name(f"robot.{EXPORTED[options.to]}"))
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
