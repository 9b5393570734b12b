# SPDX-License-Identifier: Apache-2.0
"""Files of a workspace: meshes, tables, trajectories, geometry."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from cabols_control.cable_kernels import MIN_CABLE_LENGTH_M
from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError, DataFileError
from cabols_control.files.plain_numbers import plain_number
from cabols_control.geometry import RigGeometry
from cabols_control.motion import Motion
from cabols_control.workspace.grid import WorkspaceMap
from cabols_control.workspace.surface import Mesh

STL_FACET = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A triangle of a binary STL file, 50 bytes."""
POSE_COLUMNS = ("x_m", "y_m", "z_m", "rx_deg", "ry_deg", "rz_deg")
MAP_COLUMNS = (
    *POSE_COLUMNS,
    "margin_n",
    "factor",
    "closure",
    "factor_low",
    "factor_high",
    "cables_clearance_m",
    "platform_clearance_m",
    "target_clearance_m",
    "usable",
)


def write_stl(mesh: Mesh, path: Path) -> None:
    """Write a mesh as binary STL, in single precision, normals by the order of the corners.

    Args:
        mesh: in the base frame [m].
        path: of the file, which is replaced.
    """
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    record = np.zeros(len(corners), dtype=STL_FACET)
    record["normal"] = normal / np.maximum(length, 1e-300)
    record["corners"] = corners
    header = b"cabols workspace, metres".ljust(80)
    path.write_bytes(header + np.uint32(len(corners)).tobytes() + record.tobytes())


def write_ply(mesh: Mesh, path: Path) -> None:
    """Write a mesh as binary little-endian PLY, vertices shared between faces.

    Args:
        mesh: in the base frame [m].
        path: of the file, which is replaced.
    """
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment cabols workspace, metres\n"
        f"element vertex {len(mesh.vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.zeros(len(mesh.faces), dtype=[("count", "u1"), ("index", "<i4", (3,))])
    faces["count"], faces["index"] = 3, mesh.faces
    path.write_bytes(header.encode() + mesh.vertices.astype("<f8").tobytes() + faces.tobytes())


def write_map(found: WorkspaceMap, path: Path) -> None:
    """Write every pose of a map as a row of CSV; units in the column names.

    Angles are those of a trajectory's file: intrinsic x-y-z, from base to platform axes.

    Args:
        found: the map; for each position, all of its orientations follow one another.
        path: of the file, which is replaced; columns are MAP_COLUMNS.
    """
    grid = found.grid
    orientations = grid.angles_deg.shape[0]
    positions = np.repeat(grid.positions, orientations, axis=0)
    angles = np.tile(grid.base_angles_deg, (len(grid.positions), 1))
    values = [*found.capacity, *found.clearance, found.usable]
    table = np.column_stack([positions, angles, *[value.ravel() for value in values]])
    form = ["%.9g"] * len(POSE_COLUMNS) + ["%.6g"] * (len(MAP_COLUMNS) - len(POSE_COLUMNS))
    np.savetxt(path, table, fmt=form, delimiter=",", header=",".join(MAP_COLUMNS), comments="")


def write_rows(columns: tuple[str, ...], rows: FloatArray, path: Path) -> None:
    """Write numbers as CSV, nine digits each.

    Args:
        columns: their names, which end in their units.
        rows: (k, len(columns)).
        path: of the file, which is replaced.
    """
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")


def read_poses(path: Path) -> tuple[FloatArray, FloatArray]:
    """Read a trajectory: CSV with the columns x_m, y_m, z_m, rx_deg, ry_deg, rz_deg.

    Returns:
        (k, 3) positions [m] and (k, 3, 3) rotations from intrinsic x-y-z Euler angles.

    Raises:
        ConfigError: if the file is missing.
        DataFileError: naming file, line and column if it cannot be used.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.DictReader(stream)
            _once(path, reader.fieldnames or ())
            missing = set(POSE_COLUMNS) - set(reader.fieldnames or ())
            if missing:
                raise DataFileError(
                    f"{path}: expected the columns {', '.join(POSE_COLUMNS)}, missing "
                    f"{', '.join(sorted(missing))}"
                )
            rows = [_pose(path, reader.line_num, row) for row in reader]
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (csv.Error, UnicodeDecodeError) as error:
        raise DataFileError(f"{path}: expected CSV as UTF-8 text, got {error}") from error
    if not rows:
        raise DataFileError(f"{path}: expected at least one pose, got none")
    table = np.array(rows)
    return table[:, :3], Rotation.from_euler("XYZ", table[:, 3:], degrees=True).as_matrix()


def _once(path: Path, names: Sequence[str]) -> None:
    """Refuse a column that stands twice: which holds?"""
    twice = [name for name in POSE_COLUMNS if names.count(name) > 1]
    if twice:
        raise DataFileError(f"{path}: expected each column once, got {', '.join(twice)} twice")


def _pose(path: Path, line: int, row: dict[str, str]) -> list[float]:
    if None in row or None in row.values():
        raise DataFileError(f"{path}, line {line}: expected as many cells as columns, got {row}")
    try:
        [float(row[name]) for name in POSE_COLUMNS]
    except ValueError as error:
        raise DataFileError(f"{path}, line {line}: expected six numbers, got {row}") from error
    try:
        return [plain_number(row[name]) for name in POSE_COLUMNS]
    except ValueError as error:
        raise DataFileError(f"{path}, line {line}: {error}") from error


def write_geometry(
    geometry: RigGeometry, path: Path, comment: str, words: Mapping[str, Any] | None = None
) -> None:
    """Write a geometry as the YAML that `load_geometry` reads, the comment above it.

    Args:
        geometry: to write.
        path: of the file.
        comment: above it.
        words: more keys, of a robot's file; None for none.
    """
    angles = Rotation.from_matrix(geometry.reference_rotation).as_euler("XYZ", degrees=True)
    content = {
        "base_frame": geometry.base_frame,
        "platform_frame": geometry.platform_frame,
        "reference_pose": {
            "position": _rounded(geometry.reference_position),
            "rotation_xyz_deg": _rounded(angles),
        },
        **_length_limits(geometry),
        **({} if geometry.motion is Motion.SPATIAL else {"motion": geometry.motion.value}),
        "base_points": [_rounded(row) for row in geometry.base_points],
        "platform_points": [_rounded(row) for row in geometry.platform_points],
        **_pulleys(geometry),
        **(words or {}),
    }
    lines = "".join(f"# {line}\n" for line in comment.splitlines())
    path.write_text(lines + yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def _pulleys(geometry: RigGeometry) -> dict[str, Any]:
    """Radii and axes of the pulleys, where there are any."""
    if not geometry.has_pulleys or geometry.pulley_axes is None:
        return {}
    return {
        "pulley_radius": _rounded(np.asarray(geometry.pulley_radius)),
        "pulley_axes": [[float(value) for value in row] for row in geometry.pulley_axes],
    }


def _length_limits(geometry: RigGeometry) -> dict[str, float]:
    """Limits of the cables' lengths, those that are set."""
    limits = {}
    if geometry.cable_length_min > MIN_CABLE_LENGTH_M:
        limits["cable_length_min"] = float(geometry.cable_length_min)
    if geometry.cable_length_max < np.inf:
        limits["cable_length_max"] = float(geometry.cable_length_max)
    return limits


def _rounded(values: FloatArray) -> list[float]:
    """Round to a micrometre (or microdegree); no negative zero."""
    return [round(float(value), 6) + 0.0 for value in values]


def write_json(content: dict[str, Any], path: Path) -> None:
    """Write figures.

    Args:
        content: figures by name; the keys end in their units.
        path: of the file, which is replaced.
    """
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
