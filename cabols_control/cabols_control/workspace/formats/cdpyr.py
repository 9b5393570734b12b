# SPDX-License-Identifier: Apache-2.0
"""Robots of cdpyr (Cable-Driven Parallel Robots in Python), as its JSON and YAML streams hold them.

`frame.anchors` and `platforms[].anchors` with `position` [m] and `dcm`, `cables`, and
`kinematic_chains` that join them by number; a frame anchor may hold a `pulley` with a radius. The
format has no tension limits: a cable's `breaking_load` [N] is taken as its largest tension.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError, DataFileError
from cabols_control.motion import Motion

from .exchanged import ExchangedRobot, frame_along, numbers

DIAMETER_M = 1e-3
"""Of a cable that is written and whose own is not known: the format asks for one."""


def read_cdpyr(path: Path) -> ExchangedRobot:
    """Read a robot of one platform from JSON or YAML.

    Args:
        path: of the file.

    Raises:
        ConfigError: if it cannot be read.
        DataFileError: naming file and place, if it is not a robot of one platform.
    """
    content = _load(path)
    content = content.get("robot", content)
    try:
        anchors = content["frame"]["anchors"]
        platforms, chains = content["platforms"], content["kinematic_chains"]
    except (KeyError, TypeError) as error:
        raise DataFileError(
            f"{path}: expected frame.anchors, platforms and kinematic_chains, missing {error}"
        ) from error
    if not (isinstance(platforms, list) and len(platforms) == 1):
        raise DataFileError(f"{path}: expected one platform, got {len(platforms)}")
    notes: list[str] = []
    cables = content.get("cables") or []
    base, held, radius, axes, loads = [], [], [], [], []
    for index, chain in enumerate(chains):
        where = f"{path}: kinematic_chains[{index}]"
        frame = _item(where, chain, "frame_anchor", anchors)
        own = _item(where, chain, "platform_anchor", platforms[0].get("anchors"))
        base.append(numbers(f"{where}: frame_anchor: position", frame.get("position"), 3))
        held.append(numbers(f"{where}: platform_anchor: position", own.get("position"), 3))
        pulley = frame.get("pulley") or {}
        size = pulley.get("radius")
        radius.append(0.0 if size is None else numbers(f"{where}: pulley.radius", [size], 1)[0])
        axes.append(_matrix(f"{where}: frame_anchor: dcm", frame.get("dcm"))[:, 2])
        cable = _item(where, chain, "cable", cables) if cables else {}
        load = cable.get("breaking_load")
        loads.append(np.inf if load is None else float(numbers(where, [load], 1)[0]))
    if not chains:
        raise DataFileError(f"{path}: expected kinematic_chains, got none")
    position, rotation = _home(path, content.get("home_pose"), notes)
    robot = ExchangedRobot(
        position=position,
        rotation=rotation,
        base_points=np.array(base),
        platform_points=np.array(held),
        pulley_radius=np.array(radius),
        notes=notes,
    )
    if np.isfinite(loads).all():
        robot.tension_max, robot.tension_min = np.array(loads), np.zeros(len(loads))
        notes.append("largest tensions are the cables' breaking loads, the least are 0 N")
    else:
        notes.append("no tension limits in the file")
    if np.any(radius):
        robot.pulley_axes = _outwards(robot, np.array(axes))
        notes.append("pulleys swivel about the z axes of their anchors")
    _read_body(robot, path, platforms[0])
    return robot


def _outwards(robot: ExchangedRobot, axes: FloatArray) -> FloatArray:
    """Turn axes away from the platform: cables come that way and run over the wheel."""
    held = robot.position + robot.platform_points @ robot.rotation.T
    along = np.einsum("ij,ij->i", robot.base_points - held, axes)
    return np.where(along[:, None] >= 0.0, axes, -axes)


def _read_body(robot: ExchangedRobot, path: Path, platform: dict[str, Any]) -> None:
    """Fill in mass and centre of mass, where they are."""
    inertia = platform.get("inertia") or {}
    linear = inertia.get("linear") if isinstance(inertia, dict) else None
    if linear is not None:
        robot.mass = float(_matrix(f"{path}: inertia.linear", linear, turn=False)[0, 0])
        if not np.isfinite(robot.mass):
            robot.mass = 0.0
    centre = platform.get("center_of_gravity")
    if centre is not None:
        robot.centre_of_mass = numbers(f"{path}: center_of_gravity", centre, 3)
    if robot.mass == 0.0:
        robot.notes.append("no mass in the file")
    if platform.get("motion_pattern") == "3T" or platform.get("motion_pattern") == [3, 0]:
        robot.motion = Motion.POINT


def _home(path: Path, pose: Any, notes: list[str]) -> tuple[FloatArray, FloatArray]:
    """Reference pose of a file."""
    if not isinstance(pose, dict):
        notes.append("no home pose in the file: the reference pose is the origin")
        return np.zeros(3), np.eye(3)
    linear, angular = pose.get("linear") or pose, pose.get("angular") or pose
    position = numbers(f"{path}: home_pose: position", linear.get("position"), 3)
    return position, _matrix(f"{path}: home_pose: dcm", angular.get("dcm"))


def _matrix(where: str, value: Any, turn: bool = True) -> FloatArray:
    """(3, 3) matrix of a file; None is the unit matrix."""
    if value is None:
        return np.eye(3)
    if not (isinstance(value, list) and len(value) == 3):
        raise DataFileError(f"{where}: expected three rows of three numbers, got {value!r}")
    matrix = np.array([numbers(where, row, 3) for row in value])
    if turn and not np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-6:
        raise DataFileError(f"{where}: expected a rotation, got {value!r}")
    return matrix


def _item(where: str, chain: Any, key: str, items: Any) -> dict[str, Any]:
    """Return the part of a robot that a chain names by number."""
    index = chain.get(key) if isinstance(chain, dict) else None
    count = len(items) if isinstance(items, list) else 0
    if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < count:
        raise DataFileError(
            f"{where}: {key}: expected a number from 0 to {count - 1}, got {index!r}"
        )
    found = items[index]
    if not isinstance(found, dict):
        raise DataFileError(f"{where}: {key}: expected fields, got {found!r}")
    return found


def _load(path: Path) -> dict[str, Any]:
    """Content of a JSON or YAML file."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise DataFileError(f"{path}: expected UTF-8 text, got {error}") from error
    try:
        content = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        raise DataFileError(f"{path}: expected JSON or YAML, got {error}") from error
    if not isinstance(content, dict):
        raise DataFileError(f"{path}: expected the fields of a robot, got {content!r:.80}")
    return content


def write_cdpyr(robot: ExchangedRobot, folder: Path, name: str) -> list[Path]:
    """Write a robot as NAME.json.

    Args:
        robot: to write.
        folder: that exists.
        name: of the robot.

    Returns:
        The file.
    """
    n, unit = len(robot.base_points), np.eye(3).tolist()
    anchors: list[dict[str, Any]] = []
    for index in range(n):
        anchor: dict[str, Any] = {"position": robot.base_points[index].tolist(), "dcm": unit}
        if robot.pulley_radius.size and robot.pulley_radius[index] > 0.0:
            anchor["pulley"] = {"radius": float(robot.pulley_radius[index])}
            if robot.pulley_axes is not None:
                anchor["dcm"] = frame_along(robot.pulley_axes[index]).tolist()
        anchors.append(anchor)
    platform: dict[str, Any] = {
        "name": "platform",
        "anchors": [{"position": row.tolist(), "dcm": unit} for row in robot.platform_points],
        "center_of_gravity": robot.centre_of_mass.tolist(),
        "inertia": {"linear": (robot.mass * np.eye(3)).tolist()},
    }
    cables: list[dict[str, Any]] = [{"diameter": DIAMETER_M} for _ in range(n)]
    if robot.tension_max is not None:
        for cable, load in zip(cables, robot.tension_max, strict=True):
            cable["breaking_load"] = float(load)
    content = {
        "name": name,
        "frame": {"anchors": anchors},
        "platforms": [platform],
        "cables": cables,
        "kinematic_chains": [
            {"frame_anchor": k, "platform": 0, "platform_anchor": k, "cable": k} for k in range(n)
        ],
        "home_pose": {
            "linear": {"position": robot.position.tolist()},
            "angular": {"dcm": robot.rotation.tolist()},
        },
    }
    path = folder / f"{name}.json"
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return [path]
