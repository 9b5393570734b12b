# SPDX-License-Identifier: Apache-2.0
"""The robot that a command line names: file, tip, held joints, coupled drives."""

from __future__ import annotations

import argparse
from pathlib import Path

from numpy.typing import ArrayLike

from cabols_control.configuration import read_yaml
from cabols_control.errors import CabolsError, ConfigError, UsageError
from cabols_stiffness.data_files.command_words import joint_position
from cabols_stiffness.model.robot import RobotModel, load_robot

COUPLING = "joints_by_drives"
"""Key of a file of coupled drives: a row for each joint, a column for each drive."""


def require_file(path: Path) -> None:
    """Refuse a path that leads to no file.

    Args:
        path: of a command line.

    Raises:
        UsageError: saying what is there.
    """
    if not path.is_file():
        what = "a folder" if path.is_dir() else "nothing there"
        raise UsageError(f"{path}: expected a table's file, got {what}; check the path")


def robot_of(
    options: argparse.Namespace, position: ArrayLike, rotation: ArrayLike | None = None
) -> RobotModel:
    """Load the robot of a command line.

    Args:
        options: robot, tip, lock, coupling.
        position: (3,) of the tool's origin, axes of the tip [m].
        rotation: (3, 3) from tool to the tip's axes; None: parallel.

    Raises:
        ConfigError: if a file cannot be used.
    """
    locked = dict(joint_position(word) for word in options.lock)
    robot = load_robot(
        options.robot or None, options.tip, position, rotation, locked=locked, least=1
    )
    if not options.coupling:
        return robot
    content = read_yaml(options.coupling)
    if set(content) != {COUPLING}:
        raise ConfigError(
            f"{options.coupling}: expected {COUPLING}, a matrix with a row for each joint, got "
            f"{', '.join(map(str, content)) or 'nothing'}"
        )
    try:
        return robot.coupled(content[COUPLING])
    except (CabolsError, TypeError, ValueError) as error:
        raise ConfigError(f"{options.coupling}: {error}") from error
