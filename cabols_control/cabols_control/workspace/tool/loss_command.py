# SPDX-License-Identifier: Apache-2.0
"""Subcommand `workspace loss`: which wrenches remain at the reference pose when a cable parts."""

from __future__ import annotations

import argparse

import numpy as np

from cabols_control.errors import CabolsError
from cabols_control.files.output_folder import output_folder
from cabols_control.kinematics import structure_matrix
from cabols_control.motion import Motion
from cabols_control.naming import cable_name
from cabols_control.workspace.cable_loss import remaining_share
from cabols_control.workspace.robot import Robot

from . import files

COLUMNS = ("cable", "share", "closed")
BOX = (40.0, 40.0, 40.0, 4.0, 4.0, 4.0)


def run_loss(options: argparse.Namespace, robot: Robot) -> None:
    """Print and write the share of the wrenches of a box that remains without each cable.

    Args:
        options: of the command line.
        robot: that loses a cable.

    Raises:
        CabolsError: for a robot of fewer than six directions of motion, or a count below 1.
    """
    geometry = robot.geometry
    if geometry.motion is not Motion.SPATIAL:
        raise CabolsError("loss: expected a robot of six directions of motion, got fewer")
    if options.count < 1:
        raise CabolsError(f"--count: expected at least 1, got {options.count}")
    box = np.array(options.box or (BOX if robot.required is None else robot.required))
    position, rotation = geometry.reference_position, geometry.reference_rotation
    matrix = structure_matrix(geometry, position, rotation)
    arm = rotation @ np.array(robot.platform.centre_of_mass)
    held = robot.platform.weight * np.array([0.0, 0.0, 1.0, arm[1], -arm[0], 0.0])
    random = np.random.default_rng(options.seed)
    wrenches = box * random.uniform(-1.0, 1.0, (options.count, 6))
    found = remaining_share(matrix, robot.tension_min, robot.tension_max, wrenches + held)
    with output_folder(options.output, "workspace", keep=True) as folder:
        rows = np.column_stack([np.arange(geometry.cables), found.without, found.closed])
        files.write_rows(COLUMNS, rows, options.output / "loss.csv")
        folder.finish()
    sizes = ", ".join(f"{value:g}" for value in box)
    print(f"of {options.count} wrenches within +-({sizes}) N, N m at the reference pose")
    print(f"  all cables    {100.0 * found.intact:5.1f} %")
    for i, (share, closed) in enumerate(zip(found.without, found.closed, strict=True)):
        closes = "yes" if closed else "no"
        print(f"  without {cable_name(i):9} {100.0 * share:5.1f} %, wrench closure: {closes}")
    print(f"  mean          {100.0 * found.without.mean():5.1f} %")
    print(f"the table is {options.output / 'loss.csv'}")
