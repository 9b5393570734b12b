# SPDX-License-Identifier: Apache-2.0
"""Subcommand `workspace stiffness`: how far the required wrenches move the platform, on a grid."""

from __future__ import annotations

import argparse
from math import inf

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_control.files.output_folder import output_folder
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.rig import load_rig
from cabols_control.tension import distribute
from cabols_control.workspace.elastic import platform_stiffness, yield_under
from cabols_control.workspace.grid import PoseGrid
from cabols_control.workspace.robot import Robot
from cabols_control.workspace.wrench_set import WrenchSet

from . import files

COLUMNS = (*files.POSE_COLUMNS, "moved_mm", "turned_mrad", "least_n_per_m", "tension_max_n")
HELD_N = 7.0
"""Least tension of the cables without a load."""


def run_stiffness(
    options: argparse.Namespace, robot: Robot, required: WrenchSet, grid: PoseGrid
) -> None:
    """Judge every pose of the grid; table, and the worst in words.

    Args:
        options: of the command line.
        robot: whose platform is judged.
        required: wrenches that load it [N], [N m].
        grid: of poses.

    Raises:
        CabolsError: for another number of spring stiffnesses than cables.
    """
    spring = np.array(options.spring) if options.spring else _own(options, robot)
    if spring.size not in (1, robot.geometry.cables):
        raise CabolsError(
            f"--spring: expected one or {robot.geometry.cables} numbers, got {spring.size}"
        )
    spring = np.broadcast_to(spring, (robot.geometry.cables,))
    rows = np.array(
        [
            _row(
                robot,
                _loads(required, rotation, options.platform_axes),
                position,
                rotation,
                spring,
                options.axial,
                required.held,
            )
            for position in grid.positions
            for rotation in grid.rotations
        ]
    )
    with output_folder(options.output, "workspace", keep=True) as folder:
        files.write_rows(COLUMNS, rows, options.output / "stiffness.csv")
        folder.finish()
    moved, turned, least = (rows[:, COLUMNS.index(name)] for name in COLUMNS[6:9])
    firm = np.isfinite(moved)
    print(f"{len(rows)} poses, {int(firm.sum())} held by cables that are tight and stable")
    if firm.any():
        print(f"  moved by at most   {moved[firm].max():.2f} mm, least {moved[firm].min():.2f} mm")
        print(f"  turned by at most  {turned[firm].max():.2f} mrad")
        print(f"  least stiffness    {least[firm].min():.4g} N/m")
    print(f"the table is {options.output / 'stiffness.csv'}")


def _own(options: argparse.Namespace, robot: Robot) -> FloatArray:
    """Stiffness of the rig's limbs."""
    if not robot.own_bodies:
        raise CabolsError("--spring: expected k_e of this robot's limbs [N/m], got none")
    return load_rig(options.rig).springs.nominal


def _loads(required: WrenchSet, rotation: FloatArray, platform_axes: bool) -> FloatArray:
    """(q, 6) corners of the required wrenches beside what is held, base axes [N, N m]."""
    corners = required.vertices() - required.held
    if not platform_axes:
        return corners
    return np.hstack([corners[:, :3] @ rotation.T, corners[:, 3:] @ rotation.T])


def _row(
    robot: Robot,
    loads: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    spring: FloatArray,
    axial: float,
    steady: FloatArray,
) -> list[float]:
    """One pose: its coordinates and how far the loads move it; inf out of reach."""
    geometry = robot.geometry
    angles = Rotation.from_matrix(rotation).as_euler("XYZ", degrees=True)
    pose = [*position, *angles]
    try:
        matrix = structure_matrix(geometry, position, rotation)
        length = cable_lengths(geometry, position, rotation)
        if not (
            length.min() >= geometry.cable_length_min and length.max() <= geometry.cable_length_max
        ):
            return [*pose, inf, inf, -inf, inf]
        arm = rotation @ np.array(robot.platform.centre_of_mass)
        carried = robot.platform.weight * np.array([0.0, 0.0, 1.0, arm[1], -arm[0], 0.0])
        used = geometry.motion.directions
        scaled = np.zeros((6, geometry.cables))
        scaled[used] = matrix[used]
        wanted = np.zeros(6)
        wanted[used] = (carried + steady)[used]
        least = np.maximum(robot.tension_min, np.minimum(HELD_N, robot.tension_max))
        held = distribute(scaled, wanted, least, robot.tension_max)
        if not held.feasible:
            return [*pose, inf, inf, -inf, float(held.tension.max())]
        stiffness = platform_stiffness(
            geometry, position, rotation, held.tension, spring, axial, platform=robot.platform
        )
    except CabolsError:
        return [*pose, inf, inf, -inf, inf]
    found = yield_under(stiffness, loads, used, 1.0 / float(robot.weights[-1]))
    return [
        *pose, 1e3 * found.moved, 1e3 * found.turned, found.least, float(held.tension.max())
    ]  # fmt: skip
