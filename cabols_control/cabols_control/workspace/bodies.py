# SPDX-License-Identifier: Apache-2.0
"""Bodies that cables must not touch: platform, target and frame as capsules, from YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from cabols_control.checks import FloatArray, IntArray, finite_array, in_range
from cabols_control.configuration import STRICT, load_config
from cabols_control.errors import ConfigError
from cabols_control.geometry import RigGeometry
from cabols_control.rig_folder import RigFolder, rig_file

SAME_POINT_M = 1e-6
"""Attachment points closer than this are one point."""
NO_PAIR, SHARE_PLATFORM, SHARE_BASE = 0, 1, 2


@dataclass(frozen=True, config=STRICT)
class Capsule:
    """All points within a radius of a segment.

    Attributes:
        start: (3,) one end of the segment [m].
        end: (3,) the other [m].
        radius: [m].
        start_frame: "platform" or "base": which frame `start` is given in and moves with.
        end_frame: the same for `end`.
    """

    start: list[float]
    end: list[float]
    radius: float
    start_frame: str = "platform"
    end_frame: str = "platform"

    def __post_init__(self) -> None:
        """Check shapes, sign and names."""
        finite_array("start", self.start, (3,))
        finite_array("end", self.end, (3,))
        in_range("radius", self.radius, 0.0, 10.0)
        for name, frame in (("start_frame", self.start_frame), ("end_frame", self.end_frame)):
            if frame not in ("platform", "base"):
                raise ConfigError(f'{name}: expected "platform" or "base", got "{frame}"')


@dataclass(frozen=True, config=STRICT)
class Bodies:
    """Sizes and bodies for the interference test; see rigs/bench/bodies.yaml.

    Attributes:
        cable_radius: [m].
        clearance: that must stay free around cables [m].
        joint_length: over which two cables may touch near an attachment point they share [m].
        attachment_length: over which a cable may be near a body, from its platform point on [m].
        platform: capsules of the platform.
        target: capsules of what the platform is fixed to, and of the surroundings.
    """

    cable_radius: float
    clearance: float
    joint_length: float
    attachment_length: float
    platform: list[Capsule] = Field(default_factory=list)
    target: list[Capsule] = Field(default_factory=list)

    def __post_init__(self) -> None:
        """Check ranges."""
        in_range("cable_radius", self.cable_radius, 0.0, 0.1)
        in_range("clearance", self.clearance, 0.0, 1.0)
        in_range("joint_length", self.joint_length, 1e-4, 1.0)
        in_range("attachment_length", self.attachment_length, 0.0, 1.0)


def load_bodies(rig: str | Path | RigFolder = "", path: str | Path | None = None) -> Bodies:
    """Read the bodies that a rig's cables must not touch.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        path: YAML in place of the folder's bodies.yaml; None or empty: the folder's.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    return load_config(Bodies, rig_file("bodies.yaml", path, rig))


class InterferenceTask(NamedTuple):
    """Arguments of the compiled test of a pose.

    Attributes:
        cables: (n,) records of CABLE.
        shared: (n, n) NO_PAIR, SHARE_PLATFORM or SHARE_BASE.
        capsule_ends: (c, 2, 3) [m], those of the platform first.
        on_platform: (c, 2) 1 where the end moves with the platform.
        capsule_radius: (c,) [m].
        platform_capsules: how many of them belong to the platform.
        cable_radius: [m].
        joint_length: [m].
        attachment_length: [m].
    """

    cables: Any
    shared: IntArray
    capsule_ends: FloatArray
    on_platform: IntArray
    capsule_radius: FloatArray
    platform_capsules: int
    cable_radius: float
    joint_length: float
    attachment_length: float


def interference_task(geometry: RigGeometry, bodies: Bodies) -> InterferenceTask:
    """Arrays for the compiled test; pairs that share an attachment point are found here.

    Args:
        geometry: of the rig.
        bodies: capsules that cables must not touch, and their clearance.
    """
    base, platform = np.array(geometry.base_points), np.array(geometry.platform_points)
    shared = np.full((geometry.cables, geometry.cables), NO_PAIR, dtype=np.int64)
    for points, kind in ((platform, SHARE_PLATFORM), (base, SHARE_BASE)):
        apart = np.linalg.norm(points[:, None] - points[None, :], axis=2)
        shared[apart < SAME_POINT_M] = kind
    capsules = [*bodies.platform, *bodies.target]
    return InterferenceTask(
        geometry.records(),
        shared,
        np.array([[c.start, c.end] for c in capsules], dtype=np.float64).reshape(-1, 2, 3),
        np.array(
            [[c.start_frame == "platform", c.end_frame == "platform"] for c in capsules],
            dtype=np.int64,
        ).reshape(-1, 2),
        np.array([c.radius for c in capsules], dtype=np.float64),
        len(bodies.platform),
        bodies.cable_radius,
        bodies.joint_length,
        bodies.attachment_length,
    )
