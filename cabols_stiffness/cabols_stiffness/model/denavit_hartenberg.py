# SPDX-License-Identifier: Apache-2.0
"""Robots from a table of Denavit-Hartenberg parameters, as data sheets and papers print them.

A YAML file:

    name: UR10
    convention: standard        # or modified (Craig)
    joints:
      - {name: base, a_mm: 0, alpha_deg: 90, d_mm: 127.3, theta_deg: 0}

or a CSV file with the same names as headers, one joint a line, the convention in a column. Every
length and angle has its unit in its name. theta is the offset of a joint that turns (its position
is added), d that of one that slides (`type: prismatic`). `sign: -1` is for a joint that counts the
other way; lower and upper are its limits.

Standard (Denavit and Hartenberg 1955): Rz(theta) Tz(d) Tx(a) Rx(alpha), joint i turns about the
axis z of frame i - 1. Modified (Craig, Introduction to Robotics, 1986): Rx(alpha) Tx(a) Rz(theta)
Tz(d), joint i turns about the axis z of frame i. The last frame carries the tool.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray
from cabols_control.configuration import read_yaml
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.files.plain_numbers import plain_number
from cabols_control.naming import number
from cabols_control.serial_arms.arm import SerialArm
from cabols_stiffness.data_files.cells import read_cells
from cabols_stiffness.data_files.unit_words import ANGLE, LENGTH

ENDINGS = (".yaml", ".yml", ".csv")
"""Of files that hold such a table; a URDF has others."""

STANDARD, MODIFIED = "standard", "modified"
TURNS = ("revolute", "continuous")
SLIDES = "prismatic"
PARAMETERS = {"a": LENGTH, "alpha": ANGLE, "d": LENGTH, "theta": ANGLE}
FLANGE = "last frame"


@dataclass(frozen=True)
class _Row:
    """One joint; lengths [m], angles [rad]."""

    name: str
    a: float
    alpha: float
    d: float
    theta: float
    slides: bool
    sign: float
    limits: tuple[float, float]


def read_dh(path: str | Path, locked: Mapping[str, float] | None = None) -> SerialArm:
    """Read a table of Denavit-Hartenberg parameters.

    Args:
        path: YAML or CSV.
        locked: as of a URDF; none are possible here.

    Raises:
        ConfigError: naming joint and parameter, what was expected and what came.
    """
    if locked:
        raise ConfigError(
            f"{path}: locked: expected none for a table of parameters, got {', '.join(locked)}; "
            "leave the joint out and put its position into the parameters"
        )
    name, convention, rows = _content(Path(path))
    try:
        joints = [_row(row, i) for i, row in enumerate(rows)]
    except CabolsError as error:
        raise ConfigError(f"{path}: {error}") from error
    known = (STANDARD, MODIFIED)
    if convention not in known:
        raise ConfigError(
            f"{path}: convention: expected one of {', '.join(known)}, got {convention!r}; the same "
            "numbers are another robot in the other one"
        )
    if len({joint.name for joint in joints}) != len(joints):
        raise ConfigError(f"{path}: joints: expected each name once, got one twice")
    return _arm(name, joints, convention == STANDARD)


def _content(path: Path) -> tuple[str, str, list[dict[str, Any]]]:
    if path.suffix.lower() == ".csv":
        cells = read_cells(path)
        names = [header if not unit else f"{header}_{unit}" for header, unit in
                 zip(cells.headers, cells.units, strict=True)]  # fmt: skip
        rows: list[dict[str, Any]] = [dict(zip(names, row, strict=True)) for row in cells.rows]
        said = {str(row.pop("convention", "")).strip().lower() for row in rows}
        return path.stem, said.pop() if len(said) == 1 else "", rows
    content = read_yaml(path)
    unknown = sorted(set(content) - {"name", "convention", "joints"})
    joints = content.get("joints")
    listed = isinstance(joints, list) and all(isinstance(one, dict) for one in joints)
    if unknown or not listed or not joints:
        raise ConfigError(
            f"{path}: expected name, convention and joints (a list of a, alpha, d, theta with "
            f"their units in the names), got {', '.join(map(str, content)) or 'nothing'}"
        )
    return str(content.get("name", path.stem)), str(content.get("convention", "")), joints


def _row(row: Mapping[str, Any], index: int) -> _Row:
    kind = str(row.get("type", TURNS[0])).strip().lower()
    slides, name = kind == SLIDES, str(row.get("name", row.get("joint", f"joint_{number(index)}")))
    if kind not in (*TURNS, SLIDES):
        raise ConfigError(
            f"{name}: type: expected one of {', '.join((*TURNS, SLIDES))}, got {kind!r}"
        )
    left = set(row) - {"type", "name", "joint", "sign"}
    values: dict[str, float] = {}
    limit = LENGTH if slides else ANGLE
    for parameter, units in {**PARAMETERS, "lower": limit, "upper": limit}.items():
        mine = [key for key in left if str(key).rpartition("_")[0] == parameter]
        left -= set(mine)
        if not mine and parameter in ("lower", "upper"):
            continue
        unit = str(mine[0]).rpartition("_")[2].lower() if len(mine) == 1 else ""
        if unit not in units:
            raise ConfigError(
                f"{name}: expected one {parameter} with its unit, as in "
                f"{parameter}_{next(iter(units))}, got {', '.join(map(str, mine)) or 'none'}; "
                f"known are {', '.join(units)}"
            )
        values[parameter] = units[unit] * _number(row[mine[0]], f"{name}: {mine[0]}")
    if left:
        raise ConfigError(
            f"{name}: expected a, alpha, d, theta, lower, upper with their units, name, type, "
            f"sign, got {', '.join(map(str, sorted(left)))}"
        )
    sign = _number(row.get("sign", 1.0), f"{name}: sign")
    limits = values.get("lower", -np.inf), values.get("upper", np.inf)
    if abs(sign) != 1.0 or not limits[0] < limits[1]:
        raise ConfigError(
            f"{name}: expected a sign of 1 or -1 and lower < upper, got {sign:g}, {limits}"
        )
    parameters = {key: values[key] for key in PARAMETERS}
    return _Row(name=name, slides=slides, sign=sign, limits=limits, **parameters)


def _number(value: Any, what: str) -> float:
    try:
        return plain_number(str(value))
    except ValueError as error:
        raise ConfigError(f"{what}: {error}") from error


def _arm(name: str, joints: list[_Row], standard: bool) -> SerialArm:
    origins, rotations = [], []
    place, turned = np.zeros(3), np.eye(3)
    for joint in joints:
        about_x = Rotation.from_rotvec([joint.alpha, 0.0, 0.0]).as_matrix()
        about_z = Rotation.from_rotvec([0.0, 0.0, joint.theta]).as_matrix()
        if standard:
            origins.append(place)
            rotations.append(turned @ about_z)
            place, turned = np.array([joint.a, 0.0, joint.d]), about_x
        else:
            shift = about_x @ np.array([0.0, 0.0, joint.d])
            origins.append(np.array([joint.a, 0.0, 0.0]) + shift)
            rotations.append(about_x @ about_z)
    axes: FloatArray = np.array([[0.0, 0.0, joint.sign] for joint in joints])
    return SerialArm(
        name=name,
        joints=tuple(joint.name for joint in joints),
        origins=np.array(origins),
        rotations=np.array(rotations),
        axes=axes,
        limits=np.array([joint.limits for joint in joints]),
        slides=np.array([joint.slides for joint in joints], dtype=np.bool_),
        flange=FLANGE,
        flange_position=place,
        flange_rotation=turned,
    )
