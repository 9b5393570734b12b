# SPDX-License-Identifier: Apache-2.0
"""Rig geometry: where the cables leave the frame and where they hold the platform."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from pydantic.dataclasses import dataclass as config_dataclass

from cabols_control.cable_kernels import (
    MIN_CABLE_LENGTH_M,
    cable_lengths_unchecked,
    cable_records,
    structure_matrix_unchecked,
)
from cabols_control.checks import (
    FloatArray,
    finite_array,
    in_range,
    one_or_each,
    rotation_matrix,
    unit_rows,
)
from cabols_control.configuration import STRICT, load_config
from cabols_control.errors import ConfigError, DegenerateGeometryError, OutOfRangeError, ShapeError
from cabols_control.motion import FLAT, Motion, motion_of
from cabols_control.naming import cable_name
from cabols_control.placement import Frame
from cabols_control.rig_checks import check_geometry, check_motion, check_reach
from cabols_control.rig_folder import rig_file

MIN_CABLES = 6
"""Of a rig in space; a platform that moves less needs as many as it has freedoms."""
PULLEY_MAX_M = 10.0
MAX_CONDITION = 1e6
"""Above this condition number (lengths scaled by the platform's radius) a rig is degenerate."""


def _own(name: str, value: FloatArray, shape: tuple[int | None, ...]) -> FloatArray:
    """Check an array and copy it, so that nobody else's is made read-only."""
    return finite_array(name, value, shape).copy()


def _unmasked_zeros(array: FloatArray) -> bool:
    """Whether an array is (m,) zeros, as the radii of a geometry without pulleys."""
    plain = array.dtype == np.float64 and array.ndim == 1 and not np.ma.is_masked(array)
    return bool(plain and array.size and not array.any())


@dataclass(frozen=True, eq=False)
class RigGeometry:
    """Attachment points of n cables and the pose that the rig is built around.

    Attributes:
        base_points: (n, 3) A_i, in the base frame {0} [m].
        platform_points: (n, 3) b_i, in the platform frame {p} [m].
        reference_position: (3,) of the platform's origin, in the base frame [m].
        reference_rotation: (3, 3) from platform to base axes at the reference pose.
        base_frame: name of {0} in message headers.
        platform_frame: name of {p} in message headers.
        cable_length_min: shortest length of a cable between its points [m].
        cable_length_max: longest; poses beyond either are out of reach [m].
        pulley_radius: (n,) of the grooves; 0: the cable leaves the base point itself [m]. The
            base point is then where the cable, coming along the swivel's axis, meets the groove.
        pulley_axes: (n, 3) unit vectors along the swivels' axes, the way the cable comes, base
            frame. Made of None: along z, away from the platform at the reference pose.
        motion: how the platform can move; n is at least its freedom, 6 in space.
    """

    base_points: FloatArray
    platform_points: FloatArray
    reference_position: FloatArray
    reference_rotation: FloatArray
    base_frame: str = "rig_base"
    platform_frame: str = "platform"
    cable_length_min: float = MIN_CABLE_LENGTH_M
    cable_length_max: float = inf
    pulley_radius: FloatArray | float = 0.0
    pulley_axes: FloatArray | None = None
    motion: Motion = Motion.SPATIAL

    @property
    def cables(self) -> int:
        """Number n of cables."""
        return int(self.base_points.shape[0])

    @property
    def platform_radius(self) -> float:
        """Mean distance of the platform points from the platform's origin [m]."""
        return float(np.linalg.norm(self.platform_points, axis=1).mean())

    def records(self) -> Any:
        """(n,) records of CABLE, for the kernels; a new array, whose owner may write to it."""
        points = (self.base_points, self.platform_points)
        return cable_records(*points, self.pulley_radius, self.pulley_axes)

    @property
    def has_pulleys(self) -> bool:
        """Whether any cable leaves a pulley."""
        return bool(np.any(self.pulley_radius))

    def _set_pulleys(self) -> None:
        """Check radii and axes; a rig without pulleys has zeros and no axes."""
        set_field, n = object.__setattr__, self.cables
        given = self.pulley_radius
        # Zeros of another number of cables, too: what replace() keeps of a rig without pulleys.
        if isinstance(given, np.ndarray) and given.shape != (n,) and _unmasked_zeros(given):
            given = np.zeros(n)
        radius = one_or_each("pulley_radius", given, n).copy()
        if not radius.any():
            set_field(self, "pulley_radius", radius)
            set_field(self, "pulley_axes", None)
            return
        for each in radius:
            in_range("pulley_radius", each, 0.0, PULLEY_MAX_M)
        set_field(self, "pulley_radius", radius)
        if self.pulley_axes is None:
            points = self.platform_points @ self.reference_rotation.T + self.reference_position
            axes = np.zeros((n, 3))
            for axis, held, base in zip(axes, points, self.base_points, strict=True):
                axis[2] = 1.0 if held[2] <= base[2] else -1.0
        else:
            axes = unit_rows("pulley_axes", self.pulley_axes, n)
        across = self.motion.across
        if across is not None and not (np.abs(axes[radius > 0.0, across]) < FLAT).all():
            raise ShapeError(
                f"pulley_axes: expected axes in the plane of the motion {self.motion.value}, got "
                "others, by which cables leave it; give them in geometry.yaml"
            )
        set_field(self, "pulley_axes", axes)
        for array in (radius, axes):
            array.setflags(write=False)

    def __post_init__(self) -> None:
        """Check shapes, finiteness and that the points can carry every wrench that counts."""
        set_field = object.__setattr__
        set_field(self, "base_points", _own("base_points", self.base_points, (None, 3)))
        n = self.cables
        set_field(self, "motion", Motion(self.motion))
        if n < self.motion.freedom:
            raise ShapeError(
                f"base_points: expected at least {self.motion.freedom} cables, got {n}, for a "
                f"platform with the motion {self.motion.value}; does it move less (motion: "
                f"{', '.join(kind.value for kind in Motion)})?"
            )
        set_field(self, "platform_points", _own("platform_points", self.platform_points, (n, 3)))
        position = _own("reference_position", self.reference_position, (3,))
        set_field(self, "reference_position", position)
        rotation = rotation_matrix("reference_rotation", self.reference_rotation).copy()
        set_field(self, "reference_rotation", rotation)
        if not MIN_CABLE_LENGTH_M <= self.cable_length_min < self.cable_length_max:
            raise OutOfRangeError(
                "cable_length_min", self.cable_length_min, MIN_CABLE_LENGTH_M, self.cable_length_max
            )
        for array in (self.base_points, self.platform_points, position, rotation):
            array.setflags(write=False)
        self._set_pulleys()
        self._check_not_degenerate()

    def _check_not_degenerate(self) -> None:
        pose = (self.reference_position, self.reference_rotation)
        cables = self.records()
        lengths = cable_lengths_unchecked(cables, *pose)
        if np.isnan(lengths).any():
            wrong = cable_name(int(lengths.argmin()))
            raise DegenerateGeometryError(
                f"{wrong}: expected a platform point that is on neither its pulley nor the "
                "pulley's axis at the reference pose; is pulley_radius in metres?"
            )
        if not lengths.min() >= MIN_CABLE_LENGTH_M:
            shortest = cable_name(int(lengths.argmin()))
            raise DegenerateGeometryError(
                f"{shortest}: expected at least {MIN_CABLE_LENGTH_M} m between "
                f"its points at the reference pose, got {lengths.min():.3g} m"
            )
        matrix = structure_matrix_unchecked(cables, *pose)
        matrix[3:] /= max(self.platform_radius, 1e-9)
        matrix = matrix[self.motion.directions]
        singular = np.linalg.svd(matrix, compute_uv=False)
        if not singular[-1] * MAX_CONDITION >= singular[0]:
            raise DegenerateGeometryError(
                f"geometry: expected a structure matrix of rank {self.motion.freedom} at the "
                "reference pose, got "
                f"singular values {np.array2string(singular, precision=3)}; the cables leave one "
                "direction of force or torque without support (do all swirl the same way?)"
            )


@config_dataclass(frozen=True, config=STRICT)
class GeometryFile:
    """Content of a geometry file; see load_geometry."""

    reference_pose: Frame
    base_points: list[list[float]]
    platform_points: list[list[float]]
    base_frame: str = "rig_base"
    platform_frame: str = "platform"
    cable_length_min: float = MIN_CABLE_LENGTH_M
    cable_length_max: float = inf
    pulley_radius: float | list[float] = 0.0
    pulley_axes: list[list[float]] | None = None
    motion: Motion | None = None


def load_geometry(path: str | Path | None = None) -> RigGeometry:
    """Read a rig's geometry from YAML.

    Args:
        path: file with `reference_pose` (a Frame: position [m] and rotation), `base_points` and
            `platform_points` (a row [x, y, z] per cable [m]), of cables over pulleys also
            `pulley_radius` (a number or one per cable [m]) and `pulley_axes` (a row per cable),
            and `motion` (of Motion; where it is not given, see motion_of); None for the reference
            bench (chosen by this project: the source publishes none).

    Returns:
        The geometry, checked; what is odd about it is a RigWarning.

    Raises:
        ConfigError: if the file cannot be used; the message names file, key and reason.
    """
    source = Path(path) if path is not None else rig_file("geometry.yaml")
    return geometry_of(load_config(GeometryFile, source), source)


def geometry_of(content: GeometryFile, source: str | Path) -> RigGeometry:
    """Return the geometry that a file's content describes, checked.

    Args:
        content: of the file.
        source: its path, for messages.

    Raises:
        ConfigError: if it cannot be used; the message names file, key and reason.
    """
    axes = content.pulley_axes
    radius = content.pulley_radius
    if isinstance(radius, list) and len(radius) != len(content.base_points):
        raise ConfigError(
            f"{source}: pulley_radius: expected shape ({len(content.base_points)},), one for each "
            f"cable, got {len(radius)}"
        )
    if axes is not None and not np.any(content.pulley_radius):
        raise ConfigError(
            f"{source}: pulley_axes: expected pulley_radius above 0 beside it, got none; leave "
            "pulley_axes out where all cables leave points"
        )
    try:
        base = _rows("base_points", content.base_points)
        platform = _rows("platform_points", content.platform_points)
        geometry = RigGeometry(
            base_points=base,
            platform_points=platform,
            reference_position=np.array(content.reference_pose.position),
            reference_rotation=content.reference_pose.rotation,
            base_frame=content.base_frame,
            platform_frame=content.platform_frame,
            cable_length_min=content.cable_length_min,
            cable_length_max=content.cable_length_max,
            pulley_radius=np.array(content.pulley_radius),
            pulley_axes=None if axes is None else _rows("pulley_axes", axes),
            motion=_motion(content, base, platform),
        )
    except DegenerateGeometryError as error:
        raise DegenerateGeometryError(f"{source}: {error}") from error
    except (OutOfRangeError, ShapeError) as error:
        raise ConfigError(f"{source}: {error}") from error
    pose = (geometry.reference_position, geometry.reference_rotation)
    check_geometry(geometry.records(), *pose).settle(source)
    lengths = cable_lengths_unchecked(geometry.records(), *pose)
    check_reach(lengths, geometry.cable_length_min, geometry.cable_length_max).settle(source)
    if geometry.motion.across is not None:
        held = pose[0] + geometry.platform_points @ pose[1].T
        leaves = (geometry.base_points - held)[:, geometry.motion.across]
        size = float(np.ptp(geometry.base_points, axis=0).max())
        check_motion(geometry.motion.value, leaves, size).settle(source)
    return geometry


def _motion(content: GeometryFile, base: FloatArray, platform: FloatArray) -> Motion:
    """Motion that a file gives, or that its points leave."""
    if content.motion is not None:
        return content.motion
    pose = content.reference_pose
    return motion_of(base, platform, np.array(pose.position), pose.rotation)


def _rows(name: str, rows: list[list[float]]) -> FloatArray:
    for index, row in enumerate(rows):
        if len(row) != 3:
            raise ShapeError(f"{name}, {cable_name(index)}: expected [x, y, z], got {row!r}")
    return finite_array(name, rows, (None, 3))
