# SPDX-License-Identifier: Apache-2.0
"""Subcommands `workspace import` and `workspace export`: robot files of CASPR, WireX and cdpyr."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.cable_kernels import (
    MIN_CABLE_LENGTH_M,
    cable_lengths_unchecked,
    cable_records,
)
from cabols_control.errors import CabolsError
from cabols_control.files.output_folder import output_folder
from cabols_control.geometry import RigGeometry
from cabols_control.motion import Motion, motion_of
from cabols_control.naming import cable_names
from cabols_control.workspace.formats.caspr import read_caspr, write_caspr
from cabols_control.workspace.formats.cdpyr import read_cdpyr, write_cdpyr
from cabols_control.workspace.formats.exchanged import ExchangedRobot, numbers, xml_tree
from cabols_control.workspace.formats.wirex import read_wirex, write_wirex
from cabols_control.workspace.robot import GRAVITY_M_S2, Robot, load_robot

from . import files

SAME_LENGTH_M = 1e-9
"""Difference of lengths that writing and reading may leave."""
WRITERS = {"caspr": write_caspr, "cdpyr": write_cdpyr, "wirex": write_wirex}


def run_import(options: argparse.Namespace) -> None:
    """Read another program's files, write a robot file.

    Args:
        options: of the command.

    Raises:
        CabolsError: naming file and place, if the files are not a robot that is read.
    """
    given = list(options.files)
    found = _read(given, options.cable_set)
    if options.position is not None:
        found.position = numbers("--position", options.position, 3)
    write_robot(found, options.output, f"Imported from {', '.join(path.name for path in given)}.")
    load_robot(geometry=options.output)
    for note in found.notes:
        print(f"note: {note}")
    print(f"{len(found.base_points)} cables; the robot file is {options.output}")


def _read(given: list[Path], cable_set: str) -> ExchangedRobot:
    """Read the files of one robot, by whatever program."""
    kinds = sorted(path.suffix for path in given)
    if kinds == [".xml", ".xml"]:
        if "cables" in given[0].name and "bodies" in given[1].name:
            given.reverse()
        return read_caspr(given[0], given[1], cable_set)
    if kinds == [".txt", ".xml"]:
        text, xml = sorted(given, key=lambda path: path.suffix)
        return read_wirex(xml, text)
    if kinds == [".txt"]:
        return read_wirex(given[0])
    if kinds == [".xml"]:
        if str(xml_tree(given[0]).tag) in ("bodies_system", "cables"):
            raise CabolsError("files: expected two of CASPR, bodies and cables, got 1")
        return read_wirex(given[0])
    if len(given) != 1:
        raise CabolsError(
            f"files: expected one of cdpyr, two of CASPR, one .xml, one .txt or both of WireX, got "
            f"{len(given)}"
        )
    return read_cdpyr(given[0])


def write_robot(found: ExchangedRobot, path: Path, comment: str) -> None:
    """Write an exchanged robot as a robot file.

    Args:
        found: the robot.
        path: to write.
        comment: above it.

    Raises:
        CabolsError: if the robot is degenerate.
    """
    pose = (np.asarray(found.position), np.asarray(found.rotation))
    guessed = motion_of(found.base_points, found.platform_points, *pose)
    motion = found.motion or guessed
    if motion is Motion.SPATIAL and guessed is Motion.POINT:
        # Other programs give a point mass a joint in space, too.
        print("note: all cables meet in one point: the platform is read as a point")
        motion = Motion.POINT
    geometry = RigGeometry(
        found.base_points,
        found.platform_points,
        *pose,
        pulley_radius=found.pulley_radius if found.pulley_radius.size else 0.0,
        pulley_axes=found.pulley_axes,
        motion=motion,
        cable_length_min=max(found.length_min, MIN_CABLE_LENGTH_M),
        cable_length_max=found.length_max,
    )
    words: dict[str, Any] = {}
    if found.tension_min is not None and found.tension_max is not None:
        words["tension_min"] = found.tension_min.tolist()
        words["tension_max"] = found.tension_max.tolist()
    if found.mass > 0.0:
        words["mass"] = float(found.mass)
        words["centre_of_mass"] = [float(value) for value in found.centre_of_mass]
    path.parent.mkdir(parents=True, exist_ok=True)
    files.write_geometry(geometry, path, comment, words)


def run_export(options: argparse.Namespace, robot: Robot) -> None:
    """Write a robot in another program's format, and say what the format cannot hold.

    Args:
        options: of the command.
        robot: to write.
    """
    found = exchanged_of(robot)
    lost = ["characteristic_length"]
    if robot.required is not None:
        lost.append("required_wrench")
    if robot.bodies is not None:
        lost.append("bodies")
    if np.isfinite(robot.geometry.cable_length_max) and options.format != "wirex":
        lost.append("cable_length_max")
    if options.format == "cdpyr":
        lost.append("tension_min")
    if options.format == "wirex":
        lost.append("the reference pose (import --position)")
        if np.ptp(robot.tension_min) > 0.0 or np.ptp(robot.tension_max) > 0.0:
            lost.append("tension limits of each cable (the narrowest are written)")
    with output_folder(options.output, "workspace", keep=True) as folder:
        written = WRITERS[options.format](found, options.output, options.name)
        folder.finish()
    print(f"note: the format has no place for {', '.join(lost)}")
    changed = other_lengths(found, _read(list(written), ""))
    if changed:
        # The formats' frames of a wheel leave open from which side its cable comes.
        print(
            f"warning: read back, {cable_names(changed)} would have other lengths: their pulleys' "
            "axes point towards the platform, and the format has no place for that"
        )
    print(f"written: {', '.join(str(path) for path in written)}")


def other_lengths(one: ExchangedRobot, other: ExchangedRobot) -> list[int]:
    """Return the cables whose lengths two robots do not share at the first one's reference pose.

    Args:
        one: robot.
        other: robot with as many cables.
    """
    lengths = []
    for each in (one, other):
        radius = each.pulley_radius if each.pulley_radius.size else 0.0
        cables = cable_records(each.base_points, each.platform_points, radius, each.pulley_axes)
        lengths.append(cable_lengths_unchecked(cables, one.position, one.rotation))
    differ = ~(np.abs(lengths[0] - lengths[1]) < SAME_LENGTH_M)
    return [int(index) for index in np.flatnonzero(differ)]


def exchanged_of(robot: Robot) -> ExchangedRobot:
    """Return what is exchanged of a robot.

    Args:
        robot: of a robot file or a rig.
    """
    geometry = robot.geometry
    turn = Rotation.from_matrix(geometry.reference_rotation)
    axes = geometry.pulley_axes
    return ExchangedRobot(
        position=np.array(geometry.reference_position),
        rotation=np.asarray(turn.as_matrix()),
        base_points=np.array(geometry.base_points),
        platform_points=np.array(geometry.platform_points),
        motion=Motion(geometry.motion),
        tension_min=np.array(robot.tension_min),
        tension_max=np.array(robot.tension_max),
        mass=robot.platform.weight / GRAVITY_M_S2,
        centre_of_mass=np.array(robot.platform.centre_of_mass),
        pulley_radius=np.array(geometry.pulley_radius),
        pulley_axes=None if axes is None else np.array(axes),
        length_min=float(geometry.cable_length_min),
        length_max=float(geometry.cable_length_max),
    )
