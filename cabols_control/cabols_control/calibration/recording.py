# SPDX-License-Identifier: Apache-2.0
"""Files of a self-calibration: the table of readings, the plan of stops, the rig that results."""

from __future__ import annotations

import csv
import hashlib
import re
import shutil
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError, ConfigError, DataFileError
from cabols_control.files.plain_numbers import plain_number
from cabols_control.geometry import RigGeometry
from cabols_control.naming import number
from cabols_control.rig_folder import RigFolder
from cabols_control.workspace.tool.files import write_geometry

from .estimate import Calibration
from .model import Noise, Readings

POSE_COLUMNS = ("x_m", "y_m", "z_m", "q_x", "q_y", "q_z", "q_w")
WRENCH_COLUMNS = ("f_x_n", "f_y_n", "f_z_n", "m_x_nm", "m_y_nm", "m_z_nm")
QUATERNION_SLACK = 1e-3
RECORD = "calibration.yaml"


def length_columns(cables: int) -> tuple[str, ...]:
    """Names of the columns of let-out lengths [m].

    Args:
        cables: number of cables.
    """
    return tuple(f"let_out_{number(i)}_m" for i in range(cables))


def read_readings(path: Path, cables: int, tension: float) -> Readings:
    """Read a table of readings: CSV, a row a stop, wrench columns empty where no load is on.

    Args:
        path: with the columns POSE_COLUMNS, length_columns and WRENCH_COLUMNS.
        cables: number of cables.
        tension: of the cables without a load [N].

    Raises:
        ConfigError: if the file cannot be read.
        DataFileError: naming the line and what was expected.
    """
    lengths = length_columns(cables)
    wanted = [*POSE_COLUMNS, *lengths, *WRENCH_COLUMNS]
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            names = list(reader.fieldnames or [])
            twice = [name for name in wanted if names.count(name) > 1]
            if twice:
                raise DataFileError(f"{path}: expected each column once, got {twice[0]} twice")
            missing = sorted(set(wanted) - set(reader.fieldnames or []))
            if missing:
                raise DataFileError(
                    f"{path}: expected the columns {', '.join(wanted)}, missing "
                    f"{', '.join(missing)}"
                )
            rows = [_numbers(path, reader.line_num, row, wanted) for row in reader]
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (csv.Error, UnicodeDecodeError) as error:
        raise DataFileError(f"{path}: expected CSV as UTF-8 text, got {error}") from error
    if not rows:
        raise DataFileError(f"{path}: expected at least one reading, got none")
    table = np.array(rows)
    position, quaternion, let_out, wrench = np.split(table, [3, 7, 7 + cables], axis=1)
    size = np.linalg.norm(quaternion, axis=1)
    if not (np.abs(size - 1.0) < QUATERNION_SLACK).all():
        line = int(np.argmax(~(np.abs(size - 1.0) < QUATERNION_SLACK)))
        raise DataFileError(
            f"{path}, reading {line + 1}: expected a unit quaternion, got one of {size[line]:g}"
        )
    turns = Rotation.from_quat(quaternion).as_matrix()
    return Readings(position, turns, let_out, wrench, tension)


def _numbers(path: Path, line: int, row: dict[str, str], wanted: list[str]) -> list[float]:
    """Numbers of one row; a wrench is whole or missing."""
    if None in row or None in row.values():
        raise DataFileError(f"{path}, line {line}: expected as many cells as columns, got {row}")
    cells = [row[name].strip() for name in wanted]
    wrench = cells[-6:]
    if any(wrench) and not all(wrench):
        raise DataFileError(f"{path}, line {line}: expected a whole wrench or none, got {wrench}")
    try:
        numbers = [plain_number(cell) if cell else float("nan") for cell in cells]
    except ValueError as error:
        raise DataFileError(f"{path}, line {line}: expected numbers, got {cells}") from error
    whole = numbers if all(wrench) else numbers[:-6]
    if not np.isfinite(whole).all():
        raise DataFileError(f"{path}, line {line}: expected finite numbers, got {cells}")
    return numbers


def write_plan(path: Path, stops: list[tuple[FloatArray, FloatArray]]) -> None:
    """Write the stops of a plan: CSV of poses.

    Args:
        path: file to write.
        stops: (3,) position [m] and (3, 3) rotation of each.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(POSE_COLUMNS)
        for position, rotation in stops:
            quaternion = Rotation.from_matrix(rotation).as_quat()
            writer.writerow([f"{value:.6f}" for value in (*position, *quaternion)])


def calibrated_geometry(geometry: RigGeometry, found: Calibration) -> RigGeometry:
    """Return the geometry with what was found.

    Args:
        geometry: of the drawing.
        found: the estimate.

    Raises:
        ConfigError: if what was found cannot be a rig.
    """
    own = found.layout.parts(found.values)
    try:
        return replace(
            geometry,
            base_points=own["base"],
            platform_points=own["platform"],
            pulley_radius=own["radius"],
            pulley_axes=geometry.pulley_axes,
        )
    except CabolsError as error:
        raise ConfigError(f"calibration: {error}; are these this rig's readings?") from error


def write_rig(
    source: RigFolder,
    target: Path,
    geometry: RigGeometry,
    found: Calibration,
    data: Path,
    noise: Noise,
    held_out: float,
) -> None:
    """Copy a rig's folder with what was found, and say where it comes from.

    Args:
        source: of the drawing.
        target: folder to make.
        geometry: what was found.
        found: the estimate.
        data: table of readings.
        noise: that was assumed.
        held_out: weighted rms of readings that were not fitted.

    Raises:
        ConfigError: if the folder exists.
    """
    try:
        shutil.copytree(source.path, target)
    except FileExistsError as error:
        raise ConfigError(f"{target}: expected nothing there; name another folder") from error
    day = datetime.now(timezone.utc).strftime("%Y-%m-%d")
    digest = hashlib.sha256(data.read_bytes()).hexdigest()
    comment = (
        f"Calibrated {day} from {data.name} (sha256 {digest[:16]}), beginning with the rig "
        f"{source.name}.\nDeviations and what the data did not tell: {RECORD}"
    )
    (target / "geometry.yaml").unlink()
    write_geometry(geometry, target / "geometry.yaml", comment)
    springs = found.layout.parts(found.values)["stiffness"]
    limbs = target / "limbs.yaml"
    each = ", ".join(f"{k_e:.1f}" for k_e in springs)
    # Also a list over several lines: up to the next line that begins with a key or a comment.
    new, count = re.subn(
        r"(?m)^stiffness:.*\n(?:[ \t\]\-].*\n|\n)*",
        f"stiffness: [{each}]   # N/m, by {RECORD}, {day}\n",
        limbs.read_text(encoding="utf-8"),
    )
    if count == 1 and found.told[_places(found, "stiffness")].all():
        limbs.write_text(new, encoding="utf-8")
    record = {
        "date": day,
        "data": data.name,
        "sha256": digest,
        "rig": source.name,
        "noise": {name: float(value) for name, value in vars(noise).items()},
        "residual_rms": round(found.residual, 4),
        "held_out_rms": round(held_out, 4),
        "parameters": [
            {
                "name": name,
                "value": float(value),
                "deviation": float(deviation),
                "drawing": float(start),
                "told": bool(told),
            }
            for name, value, deviation, start, told in zip(
                found.layout.names,
                found.values,
                found.deviation,
                found.layout.start,
                found.told,
                strict=True,
            )
        ],
    }
    (target / RECORD).write_text(yaml.safe_dump(record, sort_keys=False), encoding="utf-8")


def _places(found: Calibration, name: str) -> FloatArray:
    """(p,) whether a parameter belongs to a part."""
    mark = np.zeros(found.values.size)
    found.layout.parts(mark)[name][...] = 1.0
    return np.asarray(mark > 0.0)
