# SPDX-License-Identifier: Apache-2.0
"""Paths of the loaded robot: points in joint space, from stored configurations or a file; pure."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError
from cabols_control.files.given_file import read_given
from cabols_control.files.plain_numbers import plain_number
from cabols_control.naming import number
from cabols_hw.abb.configurations import RobotConfigurations

COLUMNS = tuple(f"joint_{number(i)}" for i in range(6))
MOST_POINTS = 200
"""Of a path: more are a trajectory, which wants a stream to the robot."""
MOST_DEG = 400.0
"""Largest angle that can be degrees."""


def path_points(
    stored: RobotConfigurations, index: Sequence[int], path_file: str, folder: Path
) -> FloatArray:
    """Return a path's points.

    Args:
        stored: configurations of the robot.
        index: of those that the path goes through, from 0; empty for a file.
        path_file: CSV, absolute or in the rig's folder; empty for stored configurations.
        folder: of the rig.

    Returns:
        (k, 6) joint angles [rad].

    Raises:
        ConfigError: if there is not just one of both, or it cannot be used.
    """
    if bool(len(index)) == bool(path_file):
        raise ConfigError("path: expected indices of configurations or a path_file, one of both")
    if path_file:
        return read_path(folder / path_file)
    if len(index) > MOST_POINTS:
        raise ConfigError(f"index: expected at most {MOST_POINTS} points, got {len(index)}")
    unknown = [int(i) for i in index if not 0 <= int(i) < len(stored)]
    if unknown:
        raise ConfigError(f"index: expected numbers from 0 to {len(stored) - 1}, got {unknown[0]}")
    return np.array([stored.joints(int(i)) for i in index])


def read_path(path: Path) -> FloatArray:
    """Read a path's file: a header joint_1 to joint_6, then rows of angles [deg].

    Args:
        path: of the CSV.

    Returns:
        (k, 6) [rad].

    Raises:
        ConfigError: naming the file, the line, what was expected and what came.
    """
    try:
        lines = io.StringIO(read_given(path, "utf-8-sig"), newline="")
        rows = [row for row in csv.reader(lines, strict=True) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: expected a CSV file of a path, got {error}") from error
    if not rows or tuple(cell.strip() for cell in rows[0]) != COLUMNS:
        got = ",".join(rows[0]) if rows else "nothing"
        raise ConfigError(f"{path}: expected the header {','.join(COLUMNS)}, got {got}")
    if not 1 <= len(rows) - 1 <= MOST_POINTS:
        raise ConfigError(f"{path}: expected 1 to {MOST_POINTS} points, got {len(rows) - 1}")
    points = np.full((len(rows) - 1, 6), np.nan)
    for line, row in enumerate(rows[1:], start=2):
        try:
            points[line - 2] = [plain_number(cell) for cell in row]
        except ValueError as error:
            raise ConfigError(f"{path}, row {line}: expected 6 numbers, got {row}") from error
        if not np.abs(points[line - 2]).max() <= MOST_DEG:
            raise ConfigError(f"{path}, row {line}: expected angles in degrees, got {row}")
    return np.asarray(np.deg2rad(points), dtype=np.float64)
