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

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import CabolsError
from cabols_control.geometry import RigGeometry

from .bodies import Bodies, interference_task
from .capacity import capacity_task
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
_CORNERS_DEG = (45.0, 135.0, 225.0, 315.0)
_GUIDE = 0.1
"""Weight of the mean factor in the cost: a guide where no position is feasible yet."""


def rig_of(parameters: ArrayLike, pattern: str, reference: RigGeometry) -> RigGeometry:
    """Return a member of the family.

    Args:
        parameters: (12,) see PARAMETERS [m, deg].
        pattern: key of PATTERNS.
        reference: gives the reference pose, where the family is centred, and the frames' names.

    Raises:
        ShapeError: if the parameters are not (12,) or not finite.
        CabolsError: if the pattern is unknown.
        DegenerateGeometryError: if the rig cannot carry a 6-DOF wrench at the reference pose.
    """
    p = finite_array("parameters", parameters, (len(PARAMETERS),))
    if pattern not in PATTERNS:
        raise CabolsError(f"pattern: expected one of {', '.join(PATTERNS)}, got {pattern!r}")
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


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Criteria of a design.

    Attributes:
        reference: rig whose pose and frames are kept.
        pattern: key of PATTERNS.
        tension_min: [N].
        tension_max: [N].
        required: wrenches, base axes.
        bodies: for the interference test; None leaves it out.
        grid: positions that count, with the orientations that must all do.
    """

    reference: RigGeometry
    pattern: str
    tension_min: float
    tension_max: float
    required: WrenchSet
    bodies: Bodies | None
    grid: PoseGrid

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
        task = capacity_task(geometry, self.tension_min, self.tension_max, self.required)
        touching = None if self.bodies is None else interference_task(geometry, self.bodies)
        piece = evaluate_piece(task, touching, self.grid.positions, self.grid.rotations)
        free_above = 0.0 if self.bodies is None else self.bodies.clearance
        return assemble(self.grid, [piece], free_above)


def design_bounds() -> list[tuple[float, float]]:
    """Return the parameters' bounds for scipy's optimisers."""
    return list(zip(LOWER, UPPER, strict=True))


def parameters_of(values: FloatArray) -> dict[str, float]:
    """Name the parameters, for tables and files."""
    return {name: float(v) for name, v in zip(PARAMETERS, values, strict=True)}
