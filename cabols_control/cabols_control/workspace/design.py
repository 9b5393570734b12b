# SPDX-License-Identifier: Apache-2.0
"""Attachment points for the largest workspace: a symmetric family of rigs and its cost.

The family: base points in the corners of two rectangles, one above and one below the platform's
reference position; platform points on two circles, each at its corner's angle plus or minus a
swirl. Which way each cable swirls is the pattern. The reference bench is one member.

The source shows three combinations of attachments in its figure 4.3, of which its text keeps
only the caption, and says of figure 3.2 that upper and lower cables swirl in opposite directions.
The patterns here are this project's reading: see PATTERNS.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import CabolsError
from cabols_control.geometry import RigGeometry

from .bodies import Bodies, interference_task
from .capacity import NO_WEIGHT, CapacityTask, PlatformWeight, capacity_task
from .grid import PoseGrid, WorkspaceMap, assemble, evaluate_piece
from .wrench_set import WrenchSet

PATTERNS: dict[str, tuple[int, ...]] = {
    "alternating": (1, -1, 1, -1, -1, 1, -1, 1),
    "aligned": (1, -1, 1, -1, 1, -1, 1, -1),
    "opposed": (1, 1, 1, 1, -1, -1, -1, -1),
}
"""Swirl of the cables from the four upper corners (at 45, 135, 225, 315 deg), then the lower.

alternating: neighbours swirl against each other, lower cables against the upper ones of the same
corner (the reference bench). aligned: the same, but the two cables of a corner swirl alike.
opposed: all upper cables one way, all lower ones the other (the source's text).
"""
PARAMETERS = (
    "upper_x_m",
    "upper_y_m",
    "upper_z_m",
    "lower_x_m",
    "lower_y_m",
    "lower_z_m",
    "upper_radius_m",
    "lower_radius_m",
    "upper_height_m",
    "lower_height_m",
    "upper_swirl_deg",
    "lower_swirl_deg",
)
"""Half widths of the upper corners and their height above the reference position; those of the
lower corners and their depth below it; radius and height of the circles that hold the cables from
the upper and lower corners; swirl."""
REFERENCE = (0.9, 0.8, 0.8, 0.9, 0.8, 0.8, 0.15, 0.15, -0.10, 0.10, 45.0, 45.0)
"""The reference bench's parameters, with the pattern "alternating"."""
LOWER = (0.5, 0.5, 0.4, 0.5, 0.5, 0.4, 0.08, 0.08, -0.2, -0.2, 0.0, 0.0)
UPPER = (0.9, 0.8, 0.8, 0.9, 0.8, 0.8, 0.25, 0.25, 0.2, 0.2, 90.0, 90.0)
"""Bounds: no frame larger than the reference bench's, a platform of at most 0.5 by 0.4 m."""
BENCH = "alternating"
"""The reference bench's pattern."""
GIVEN = "given"
"""Family of a given robot of any number of cables: its points, stretched and turned."""
GIVEN_PARAMETERS = (
    "base_x",
    "base_y",
    "base_z",
    "platform_x",
    "platform_y",
    "platform_z",
    "platform_turn_deg",
)
"""Factors on the base points about their middle and on the platform points about the platform's
origin, along the axes of the reference pose; turn of the platform points about z, or across the
plane of a planar robot."""
GIVEN_REFERENCE = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0)
GIVEN_LOWER = (0.5, 0.5, 0.5, 0.5, 0.5, -1.6, -45.0)
GIVEN_UPPER = (1.0, 1.0, 1.0, 1.6, 1.6, 1.6, 45.0)
"""No frame larger than the given one's; upper and lower platform points may change places."""
_CORNERS_DEG = (45.0, 135.0, 225.0, 315.0)
_GUIDE = 0.1
"""Weight of the mean factor in the cost: a guide where no position is feasible yet."""


def rig_of(parameters: ArrayLike, pattern: str, reference: RigGeometry) -> RigGeometry:
    """Return a member of the family.

    Args:
        parameters: (12,) see PARAMETERS [m, deg]; of GIVEN (7,), see GIVEN_PARAMETERS.
        pattern: key of PATTERNS, or GIVEN.
        reference: gives the reference pose, where the family is centred, and the frames' names.

    Raises:
        ShapeError: if the parameters have another shape or are not finite.
        CabolsError: if the pattern is unknown.
        DegenerateGeometryError: if the rig cannot carry every wrench at the reference pose.
    """
    if pattern == GIVEN:
        return _stretched(finite_array("parameters", parameters, (7,)), reference)
    p = finite_array("parameters", parameters, (len(PARAMETERS),))
    if pattern not in PATTERNS:
        raise CabolsError(
            f"pattern: expected one of {', '.join([*PATTERNS, GIVEN])}, got {pattern!r}"
        )
    base, platform = np.empty((8, 3)), np.empty((8, 3))
    for i, sign in enumerate(PATTERNS[pattern]):
        lower, corner = divmod(i, 4)
        angle = np.deg2rad(_CORNERS_DEG[corner])
        side = np.sign([np.cos(angle), np.sin(angle)])
        half = p[3 * lower : 3 * lower + 3]
        base[i] = (*side * half[:2], -half[2] if lower else half[2])
        angle += np.deg2rad(sign * p[10 + lower])
        radius = p[6 + lower]
        platform[i] = (radius * np.cos(angle), radius * np.sin(angle), p[8 + lower])
    rotation = np.array(reference.reference_rotation)
    return replace(
        reference,
        base_points=np.array(reference.reference_position) + base @ rotation.T,
        platform_points=platform,
    )


def _stretched(p: FloatArray, reference: RigGeometry) -> RigGeometry:
    """Return a given robot with its points stretched and turned; see GIVEN_PARAMETERS."""
    rotation = np.array(reference.reference_rotation)
    middle = reference.base_points.mean(axis=0)
    base = (reference.base_points - middle) @ rotation * p[:3]
    *_, degrees = p
    axis = np.eye(3)[2 if reference.motion.across is None else reference.motion.across]
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * (rotation.T @ axis)).as_matrix()
    platform = reference.platform_points * p[3:6] @ turn.T
    return replace(reference, base_points=middle + base @ rotation.T, platform_points=platform)


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Criteria of a design.

    Attributes:
        reference: rig whose pose and frames are kept.
        pattern: key of PATTERNS, or GIVEN.
        tension_min: one, or for each cable [N].
        tension_max: likewise [N].
        required: wrenches, base axes.
        bodies: for the interference test; None leaves it out.
        grid: positions that count, with the orientations that must all do.
        weights: (6,) that make forces and torques comparable; None for the bench's.
        platform: its weight, held beside the required wrenches.
    """

    reference: RigGeometry
    pattern: str
    tension_min: ArrayLike
    tension_max: ArrayLike
    required: WrenchSet
    bodies: Bodies | None
    grid: PoseGrid
    weights: FloatArray | None = None
    platform: PlatformWeight = NO_WEIGHT

    def task(self, geometry: RigGeometry) -> CapacityTask:
        """Return the arguments of the capacity of a rig.

        Args:
            geometry: of the rig.
        """
        return capacity_task(
            geometry,
            self.tension_min,
            self.tension_max,
            self.required,
            weights=self.weights,
            platform=self.platform,
        )

    def __call__(self, parameters: ArrayLike) -> float:
        """Cost of a member of the family: minus the usable share of the grid, and a guide.

        The guide is a tenth of the mean factor (at most 1) over the positions, less where cables
        interfere. A degenerate rig costs 0, the worst.
        """
        try:
            found = self.map(rig_of(parameters, self.pattern, self.reference))
        except CabolsError:
            return 0.0
        usable = found.usable.all(axis=-1)
        least = np.clip(found.capacity.factor, 0.0, 1.0).min(axis=-1)
        free = found.free.mean(axis=-1)
        return -float(usable.mean() + _GUIDE * (least * free).mean())

    def map(self, geometry: RigGeometry) -> WorkspaceMap:
        """Evaluate a rig on the problem's grid; one core."""
        task = self.task(geometry)
        touching = None if self.bodies is None else interference_task(geometry, self.bodies)
        piece = evaluate_piece(task, touching, self.grid.positions, self.grid.rotations)
        free_above = 0.0 if self.bodies is None else self.bodies.clearance
        return assemble(self.grid, [piece], free_above)


def design_bounds(pattern: str = "") -> list[tuple[float, float]]:
    """Return the parameters' bounds for scipy's optimisers.

    Args:
        pattern: GIVEN, or a key of PATTERNS.
    """
    if pattern == GIVEN:
        return list(zip(GIVEN_LOWER, GIVEN_UPPER, strict=True))
    return list(zip(LOWER, UPPER, strict=True))


def reference_of(pattern: str) -> FloatArray:
    """Parameters of the rig that a family starts from.

    Args:
        pattern: GIVEN, or a key of PATTERNS.
    """
    return np.array(GIVEN_REFERENCE if pattern == GIVEN else REFERENCE)


def parameters_of(values: FloatArray) -> dict[str, float]:
    """Name the parameters, for tables and files.

    Args:
        values: (12,) or, of GIVEN, (7,).
    """
    names = PARAMETERS if len(values) == len(PARAMETERS) else GIVEN_PARAMETERS
    return {name: float(v) for name, v in zip(names, values, strict=True)}
