# SPDX-License-Identifier: Apache-2.0
"""A cable robot for the workspace tool: geometry, tension limits, weight, from one file.

A rig's folder describes the rig that is controlled. A robot that is only analysed needs less: its
attachment points, and what its cables bear. Nothing of the bench stands in without being told.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field
from pydantic.dataclasses import dataclass as config_dataclass

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.configuration import STRICT, load_config, read_yaml
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.geometry import GeometryFile, RigGeometry, geometry_of
from cabols_control.motion import Motion
from cabols_control.rig_folder import RigFolder, find_rig, rig_file
from cabols_control.tension.arguments import WEIGHT_LENGTH_M, check_limits

from .bodies import Bodies
from .capacity import MOST_WEIGHT_N, PlatformWeight

GRAVITY_M_S2 = 9.80665
MOST_TENSION_N = 1e8
"""Largest tension that is taken: above, the units are wrong."""
GRID_SHARE = 1.0 / 3.0
"""Half widths of a grid that is not given, of the frame's sides."""


@config_dataclass(frozen=True, config=STRICT)
class _RobotFile(GeometryFile):
    tension_min: float | list[float] | None = None
    tension_max: float | list[float] | None = None
    mass: float = 0.0
    centre_of_mass: list[float] = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    characteristic_length: float | None = None
    required_wrench: list[float] | None = None
    bodies: Bodies | None = None


@dataclass(frozen=True, eq=False)
class Robot:
    """What the workspace of a robot depends on.

    Attributes:
        geometry: attachment points.
        tension_min: (n,) [N].
        tension_max: (n,) [N].
        platform: its weight, held beside the required wrenches.
        weights: (6,) that make forces and torques comparable.
        required: (6,) half widths of the box of required wrenches of its file [N, N m], or None.
        bodies: of its file, or None.
        own_bodies: whether the rig's bodies, and its other files, are those of this robot.
        notes: what was taken from elsewhere, for people.
    """

    geometry: RigGeometry
    tension_min: FloatArray
    tension_max: FloatArray
    platform: PlatformWeight
    weights: FloatArray
    required: FloatArray | None
    bodies: Bodies | None
    own_bodies: bool
    notes: tuple[str, ...]

    def half_widths(self) -> FloatArray:
        """(3,) half widths of a grid round the reference position: a third of the frame [m].

        Across a flat frame it is the platform's radius, of a point a third of the largest side.
        """
        sides = GRID_SHARE * np.ptp(self.geometry.base_points, axis=0)
        radius = self.geometry.platform_radius
        return np.where(sides > 0.0, sides, radius if radius > 0.0 else sides.max())


def load_robot(
    rig: str | Path | RigFolder = "",
    geometry: str | Path | None = None,
    control: str | Path | None = None,
) -> Robot:
    """Read a robot.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        geometry: YAML of another robot in place of the rig's: a geometry file which may also hold
            `tension_min` and `tension_max` (a number or one for each cable [N]), `mass` [kg] and
            `centre_of_mass` [m, platform axes], `characteristic_length` [m], at which torques
            count as forces, `required_wrench` (half widths of a box [N, N m]) and `bodies` (as
            in bodies.yaml); None or empty: the rig's.
        control: YAML whose `tension_min` and `tension_max` are taken, of any size; None or empty:
            the robot file's, or the rig's.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    folder = find_rig(rig)
    source = rig_file("geometry.yaml", geometry, folder)
    content = load_config(_RobotFile, source)
    shape = geometry_of(content, source)
    notes: list[str] = []
    own = content.tension_min, content.tension_max
    if control or own == (None, None):
        limits_source = rig_file("control.yaml", control, folder)
        values = read_yaml(limits_source)
        own = values.get("tension_min"), values.get("tension_max")
        if geometry and not control:
            notes.append(
                f"tension limits are those of the rig {folder.name}: {own[0]} to {own[1]} N; for "
                "others: tension_min and tension_max in the robot's file, or --control"
            )
    else:
        limits_source = source
    length = content.characteristic_length
    if length is None:
        length = WEIGHT_LENGTH_M
        if geometry and shape.motion is not Motion.POINT:
            notes.append(
                f"torques count as forces at {length} m, as on the bench; for another length: "
                "characteristic_length in the robot's file"
            )
    across = shape.motion.across
    if geometry and across is not None:
        notes.append(
            f"the platform moves in the {shape.motion.value[-2:]} plane: wrenches across it"
            f"{', its weight among them,' if across == 2 and content.mass else ''} do not count"
        )
    try:
        low, high = _limits(shape.cables, *own)
        in_range("mass", content.mass, 0.0, MOST_WEIGHT_N / GRAVITY_M_S2)
        in_range("characteristic_length", length, 1e-6, 1e6)
        centre = finite_array("centre_of_mass", content.centre_of_mass, (3,))
        box = content.required_wrench
        required = None if box is None else finite_array("required_wrench", box, (6,))
    except CabolsError as error:
        raise ConfigError(f"{limits_source}: {error}") from error
    return Robot(
        geometry=shape,
        tension_min=low,
        tension_max=high,
        platform=PlatformWeight(GRAVITY_M_S2 * content.mass, (centre[0], centre[1], centre[2])),
        weights=np.array([1.0, 1.0, 1.0, *[1.0 / length] * 3]),
        required=required,
        bodies=content.bodies,
        own_bodies=not geometry,
        notes=tuple(notes),
    )


def robot_words(robot: Robot) -> dict[str, Any]:
    """Return what a robot's file says beside its geometry; `load_robot` reads it.

    Args:
        robot: to write.
    """
    words: dict[str, Any] = {
        "tension_min": robot.tension_min.tolist(),
        "tension_max": robot.tension_max.tolist(),
        "characteristic_length": float(1.0 / robot.weights[3:].max()),
    }
    if robot.platform.weight > 0.0:
        words["mass"] = robot.platform.weight / GRAVITY_M_S2
        words["centre_of_mass"] = [float(value) for value in robot.platform.centre_of_mass]
    if robot.required is not None:
        words["required_wrench"] = robot.required.tolist()
    if robot.bodies is not None:
        words["bodies"] = asdict(robot.bodies)
    return words


def _limits(cables: int, low: Any, high: Any) -> tuple[FloatArray, FloatArray]:
    """Tension limits of a file, checked."""
    found: list[ArrayLike] = []
    for name, value in (("tension_min", low), ("tension_max", high)):
        if value is None:
            raise ConfigError(f"{name}: expected a number or one for each cable [N], got none")
        for each in value if isinstance(value, list) else [value]:
            if isinstance(each, bool) or not isinstance(each, (int, float)):
                raise ConfigError(f"{name}: expected numbers [N], got {each!r}")
            in_range(name, each, 0.0, MOST_TENSION_N)
        found.append(value)
    return check_limits(cables, *found)
