# SPDX-License-Identifier: Apache-2.0
"""What is drawn of a rig: geometry, limits, robot and reflectors, as one dictionary of numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass as config_dataclass

from cabols_control.checks import FloatArray, finite_array
from cabols_control.configuration import STRICT, load_config
from cabols_control.console.view3d.arm import read_arm
from cabols_control.errors import ConfigError
from cabols_control.frames import load_frames
from cabols_control.rig import Rig
from cabols_control.rig_folder import RigFolder, find_rig

ROBOT = "robot.urdf"


@config_dataclass(frozen=True, config=STRICT)
class SceneConfig:
    """Pictures of what stands around the cables.

    Attributes:
        reflectors: a row [x, y, z] for each, in platform axes [m].
        joint_offsets: where every joint of the robot sits, in the frame of the link before it [m].
        joint_axes: the axis it turns about, in that frame: 0, 1, 2 for x, y, z.
        robot_base: robot's base, in the rig's base frame [m].
        flange: in the last link's frame [m].
        tracker: laser tracker, in the rig's base frame [m].
    """

    reflectors: list[list[float]]
    joint_offsets: list[list[float]] | None = None
    joint_axes: list[int] | None = None
    robot_base: list[float] = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    flange: list[float] = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    tracker: list[float] | None = None

    def __post_init__(self) -> None:
        """Check lengths and axes."""
        finite_array("reflectors", self.reflectors, (None, 3))
        finite_array("robot_base", self.robot_base, (3,))
        finite_array("flange", self.flange, (3,))
        if self.tracker is not None:
            finite_array("tracker", self.tracker, (3,))
        if (self.joint_offsets is None) != (self.joint_axes is None):
            raise ConfigError("expected joint_offsets and joint_axes together, or neither")
        if self.joint_offsets is not None and self.joint_axes is not None:
            finite_array("joint_offsets", self.joint_offsets, (len(self.joint_axes), 3))
            if not set(self.joint_axes) <= {0, 1, 2}:
                raise ConfigError(f"joint_axes: expected 0, 1 or 2 each, got {self.joint_axes}")


def load_scene(rig: str | Path | RigFolder = "", path: str | Path | None = None) -> SceneConfig:
    """What is drawn of a rig besides its geometry.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench. Tracker and reflectors are
            those of frames.yaml, the robot that of robot.urdf; without such a file none is drawn.
        path: YAML of a scene, in place of the folder's files; None or empty: the folder's.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    folder = find_rig(rig)
    frames = load_frames(folder)
    places: dict[str, Any] = {
        "reflectors": frames.reflectors,
        "tracker": frames.tracker_frame.position,
    }
    if path:
        return load_config(SceneConfig, path, defaults=places)
    robot = read_arm(folder.file(ROBOT)) if folder.has(ROBOT) else None
    if robot is None:
        return SceneConfig(**places)
    return SceneConfig(
        **places,
        joint_offsets=robot.offsets,
        joint_axes=robot.axes,
        flange=robot.flange,
    )


def scene_numbers(rig: Rig, scene: SceneConfig) -> dict[str, Any]:
    """Everything that the page's script draws and scales with, ready for JSON.

    Args:
        rig: geometry, limits of tension and current, range of the force/torque sensor.
        scene: robot, reflectors and tracker.

    Returns:
        By name, in the units and frames of RigGeometry, ControlConfig and SceneConfig; robot and
        tracker are None where there is none.
    """
    robot = None
    if scene.joint_offsets is not None:
        robot = {
            "base": list(scene.robot_base),
            "offsets": scene.joint_offsets,
            "axes": scene.joint_axes,
            "flange": list(scene.flange),
        }
    return {
        "base_points": rig.geometry.base_points.tolist(),
        "platform_points": rig.geometry.platform_points.tolist(),
        "reference_position": rig.geometry.reference_position.tolist(),
        "tension_min": rig.control.tension_min,
        "tension_max": rig.control.tension_max,
        "current_limit": rig.control.current_limit,
        "rated": rig.control.rated.tolist(),
        "reflectors": scene.reflectors,
        "tracker": scene.tracker,
        "robot": robot,
    }


def joint_points(scene: SceneConfig, joints: FloatArray) -> FloatArray:
    """Where a robot's joints and its flange are.

    Args:
        scene: with a robot.
        joints: (k,) angles [rad].

    Returns:
        (k + 2, 3) base, joints, flange in the base frame [m].

    Raises:
        ConfigError: if the scene has no robot, or another number of joints.
    """
    if scene.joint_offsets is None or scene.joint_axes is None:
        raise ConfigError("scene: expected joint_offsets, it has no robot")
    angles = finite_array("joints", joints, (len(scene.joint_axes),))
    place, turn = np.array(scene.robot_base, dtype=np.float64), np.eye(3)
    points = [place.copy()]
    for offset, axis, angle in zip(scene.joint_offsets, scene.joint_axes, angles, strict=True):
        place = place + turn @ np.array(offset)
        points.append(place.copy())
        turn = turn @ _rotation(axis, float(angle))
    points.append(place + turn @ np.array(scene.flange))
    return np.array(points)


def _rotation(axis: int, angle: float) -> FloatArray:
    """Rotation about a coordinate axis."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = np.cos(angle)
    matrix[second, first] = np.sin(angle)
    matrix[first, second] = -np.sin(angle)
    return matrix
