# SPDX-License-Identifier: Apache-2.0
"""The rig as cylinders and spheres, for viewers without a model of it."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.console.view3d.scene import SceneConfig, joint_points
from cabols_control.rig import Rig
from cabols_control.rotations import pose_matrix

COLOURS = np.array(
    [
        [0.30, 0.47, 0.78],
        [0.21, 0.69, 0.67],
        [0.85, 0.78, 0.29],
        [0.95, 0.50, 0.23],
        [0.90, 0.22, 0.17],
    ]
)
"""From no tension to the limit, as on the page."""
SLACK, STEEL, ARM, GLASS = (
    (0.58, 0.63, 0.69),
    (0.79, 0.83, 0.86),
    (0.85, 0.48, 0.17),
    (0.49, 0.83, 0.99),
)
CYLINDER, SPHERE = "cylinder", "sphere"


@dataclass(frozen=True, eq=False)
class Shape:
    """One body, in the base frame.

    Attributes:
        group: cables, platform, robot, reflectors, frame.
        kind: CYLINDER, along its own z, or SPHERE.
        position: (3,) of its centre [m].
        quaternion: (4,) x y z w.
        size: (3,) diameters, the cylinder's length last [m].
        colour: red, green, blue, 0 to 1.
    """

    group: str
    kind: str
    position: FloatArray
    quaternion: FloatArray
    size: tuple[float, float, float]
    colour: tuple[float, float, float]


def tension_colour(share: float) -> tuple[float, float, float]:
    """Colour of a tension, as a share of its limit."""
    at = float(np.clip(share, 0.0, 1.0)) * (len(COLOURS) - 1)
    low = min(int(at), len(COLOURS) - 2)
    mixed = COLOURS[low] + (at - low) * (COLOURS[low + 1] - COLOURS[low])
    return float(mixed[0]), float(mixed[1]), float(mixed[2])


def rod(
    group: str,
    start: FloatArray,
    end: FloatArray,
    diameter: float,
    colour: tuple[float, float, float],
) -> Shape:
    """A cylinder between two points.

    Args:
        group: that it belongs to, see Shape.
        start: (3,) centre of one end face, base frame [m].
        end: (3,) centre of the other [m].
        diameter: [m].
        colour: red, green, blue, 0 to 1.
    """
    along = np.asarray(end) - np.asarray(start)
    length = max(float(np.linalg.norm(along)), 1e-9)
    axis = along / length
    # Half-way vector: the turn from z to the axis; straight down has none, so turn about x.
    half = np.array([-axis[1], axis[0], 0.0, 1.0 + axis[2]])
    size = float(np.linalg.norm(half))
    quaternion = half / size if size > 1e-6 else np.array([1.0, 0.0, 0.0, 0.0])
    middle = 0.5 * (np.asarray(start) + np.asarray(end))
    return Shape(group, CYLINDER, middle, quaternion, (diameter, diameter, length), colour)


def ball(
    group: str, place: FloatArray, diameter: float, colour: tuple[float, float, float]
) -> Shape:
    """A sphere.

    Args:
        group: that it belongs to, see Shape.
        place: (3,) of its centre, base frame [m].
        diameter: [m].
        colour: red, green, blue, 0 to 1.
    """
    upright = np.array([0.0, 0.0, 0.0, 1.0])
    return Shape(group, SPHERE, np.asarray(place), upright, (diameter,) * 3, colour)


def rig_shapes(rig: Rig, scene: SceneConfig, frame: dict[str, Any]) -> list[Shape]:
    """Return the bodies of one frame.

    Args:
        rig: geometry and limits.
        scene: robot and reflectors.
        frame: newest values, as LatestValues holds them; what is missing is not drawn.
    """
    geometry = rig.geometry
    pose = frame.get("P")
    if pose is None or any(value is None for value in pose):
        position, rotation = geometry.reference_position, geometry.reference_rotation
    else:
        position, rotation = np.array(pose[:3]), pose_matrix(pose[3:])
    ends = position + geometry.platform_points @ rotation.T
    found = [ball("frame", point, 0.06, STEEL) for point in geometry.base_points]
    tensions = frame.get("T") or [None] * geometry.cables
    for start, end, tension in zip(geometry.base_points, ends, tensions, strict=True):
        slack = tension is None or tension < rig.control.tension_min
        share = 0.0 if tension is None else tension / rig.control.tension_max
        diameter = 0.006 if slack else 0.01 + 0.01 * min(share, 1.0)
        found.append(rod("cables", start, end, diameter, SLACK if slack else tension_colour(share)))
    heights = geometry.platform_points[:, 2]
    radius = float(np.hypot(*geometry.platform_points[:, :2].T).max())
    for height in (float(heights.min()), float(heights.max())):
        plate = np.array([[0.0, 0.0, height - 0.008], [0.0, 0.0, height + 0.008]])
        low, high = position + plate @ rotation.T
        found.append(rod("platform", low, high, 2.0 * radius, STEEL))
    reflectors = np.asarray(scene.reflectors, dtype=np.float64).reshape(-1, 3)
    found += [ball("reflectors", position + rotation @ p, 0.04, GLASS) for p in reflectors]
    joints = frame.get("J")
    if joints and scene.joint_axes is not None and len(joints) == len(scene.joint_axes):
        points = joint_points(scene, np.array(joints, dtype=np.float64))
        for before, after in itertools.pairwise(points):
            if float(np.linalg.norm(after - before)) > 1e-6:
                found.append(rod("robot", before, after, 0.11, ARM))
        found += [ball("robot", point, 0.15, ARM) for point in points[1:-1]]
    return found
