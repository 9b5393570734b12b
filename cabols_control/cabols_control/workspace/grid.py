# SPDX-License-Identifier: Apache-2.0
"""Grids of positions and orientations, and results on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from cabols_control.checks import BoolArray, FloatArray, finite_array, in_range
from cabols_control.errors import CabolsError, ShapeError

from .bodies import InterferenceTask
from .capacity import Capacity, CapacityTask, as_capacity, evaluate_poses
from .facet_result import RESULTS
from .interference import Clearance, clearance_loop, clearance_work
from .surface import NO_MESH, Mesh, level_surface

SLAB_M = 1.0
"""Height of the solid whose volume gives a plane region's area."""
CHUNK_POSES = 20_000
"""Poses of one piece of work, about a tenth of a second, so that cores end together."""


@dataclass(frozen=True, eq=False)
class PoseGrid:
    """Every position of a box-shaped grid, each with every orientation.

    Attributes:
        x: (nx,) rising, base frame [m].
        y: (ny,) rising [m].
        z: (nz,) rising [m].
        angles_deg: (o, 3) intrinsic x-y-z Euler angles of the orientations, from `rotation` [deg].
        rotation: (3, 3) from platform to base axes at angles zero.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    angles_deg: FloatArray
    rotation: FloatArray

    def __post_init__(self) -> None:
        """Check shapes and order."""
        for name in ("x", "y", "z"):
            axis = finite_array(name, getattr(self, name), (None,))
            if not (axis.size >= 1 and (np.diff(axis) > 0.0).all()):
                raise CabolsError(f"{name}: expected rising positions, got {axis}")
            object.__setattr__(self, name, axis)
        angles = finite_array("angles_deg", self.angles_deg, (None, 3))
        if angles.shape[0] < 1:
            raise ShapeError("angles_deg: expected at least one orientation, got none")
        object.__setattr__(self, "angles_deg", angles)
        object.__setattr__(self, "rotation", finite_array("rotation", self.rotation, (3, 3)))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of positions along each axis."""
        return self.x.size, self.y.size, self.z.size

    @property
    def flat_axis(self) -> int | None:
        """Axis of one position, where the two others have more; None for other grids."""
        single = [k for k in range(3) if self.shape[k] == 1]
        return single[0] if len(single) == 1 else None

    @property
    def poses(self) -> int:
        """Number of poses."""
        return self.x.size * self.y.size * self.z.size * int(self.angles_deg.shape[0])

    @property
    def positions(self) -> FloatArray:
        """(k, 3) all positions, z fastest [m]."""
        mesh = np.meshgrid(self.x, self.y, self.z, indexing="ij")
        return np.ascontiguousarray(np.stack(mesh, axis=-1).reshape(-1, 3))

    def positions_of(self, part: slice) -> FloatArray:
        """(k, 3) some of the positions, without the others [m].

        Args:
            part: from where to where in `positions`.
        """
        i, j, k = np.unravel_index(np.arange(part.start, part.stop), self.shape)
        return np.column_stack([self.x[i], self.y[j], self.z[k]])

    @property
    def rotations(self) -> FloatArray:
        """(o, 3, 3) from platform to base axes."""
        turns = Rotation.from_euler("XYZ", self.angles_deg, degrees=True).as_matrix()
        return np.ascontiguousarray(self.rotation @ turns)

    @property
    def base_angles_deg(self) -> FloatArray:
        """(o, 3) intrinsic x-y-z Euler angles of the rotations, from base axes [deg]."""
        return np.asarray(Rotation.from_matrix(self.rotations).as_euler("XYZ", degrees=True))

    @property
    def cell_volume(self) -> float:
        """Volume that one position stands for [m^3]; an axis of one position counts as 1 m."""
        steps = [float(np.diff(axis).mean()) if axis.size > 1 else 1.0 for axis in self._axes]
        return float(np.prod(steps))

    @property
    def _axes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self.x, self.y, self.z


def box_grid(
    centre: ArrayLike,
    half_widths: ArrayLike,
    counts: tuple[int, int, int],
    angles_deg: ArrayLike = ((0.0, 0.0, 0.0),),
    rotation: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
) -> PoseGrid:
    """Return a grid of `counts` positions over centre +- half_widths, both (3,) [m].

    Args:
        centre: (3,) of the box in the base frame [m].
        half_widths: (3,) along the axes [m].
        counts: positions along each axis.
        angles_deg: (o, 3) rotations about x, y and z of the platform [deg], one after the other.
        rotation: (3, 3) of the platform that the angles start from.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a count is below 1 or a half width is not positive.
    """
    middle = finite_array("centre", centre, (3,))
    half = finite_array("half_widths", half_widths, (3,))
    if not ((half > 0.0).all() and min(counts) >= 1):
        raise CabolsError(f"half_widths, counts: expected positive numbers, got {half}, {counts}")
    x, y, z = (
        np.linspace(m - h, m + h, count) if count > 1 else np.array([m])
        for m, h, count in zip(middle, half, counts, strict=True)
    )
    # Not converted before its checks: that forgets the mask of a masked array.
    angles = finite_array("angles_deg", angles_deg, (None, 3))
    return PoseGrid(x, y, z, angles, finite_array("rotation", rotation, (3, 3)))


def tilts(angle_deg: float) -> FloatArray:
    """(7, 3) Euler angles [deg]: none, then +- one angle about each axis."""
    turns = in_range("tilt", angle_deg, 0.0, 180.0) * np.eye(3)
    return np.concatenate([np.zeros((1, 3)), turns, -turns])


class Piece(NamedTuple):
    """Results of some positions: (k, o, RESULTS) capacity, (k, o, 3) clearances [m]."""

    capacity: FloatArray
    clearance: FloatArray


def evaluate_piece(
    task: CapacityTask,
    bodies: InterferenceTask | None,
    positions: FloatArray,
    rotations: FloatArray,
) -> Piece:
    """Evaluate (k, 3) positions, each with all (o, 3, 3) rotations; one core.

    Args:
        task: wrenches that are required, and limits.
        bodies: what must not be touched; None: clearances are not computed.
        positions: (k, 3) in the base frame [m].
        rotations: (o, 3, 3) from platform to base axes.
    """
    shape = (positions.shape[0], rotations.shape[0])
    capacity, clearance = np.empty((*shape, RESULTS)), np.full((*shape, 3), np.inf)
    evaluate_poses(task, positions, rotations, capacity)
    if bodies is not None:
        clearance_loop(bodies, positions, rotations, clearance_work(bodies), clearance)
    return Piece(capacity, clearance)


def _positions_each(grid: PoseGrid) -> int:
    """Positions of a piece of about CHUNK_POSES poses."""
    return max(CHUNK_POSES // int(grid.angles_deg.shape[0]), 1)


def piece_count(grid: PoseGrid) -> int:
    """Number of pieces that a grid is cut into."""
    return -(-int(np.prod(grid.shape)) // _positions_each(grid))


def piece_of(grid: PoseGrid, k: int) -> slice:
    """Positions of a piece.

    Args:
        grid: that is cut.
        k: number of the piece, from 0.
    """
    each = _positions_each(grid)
    return slice(k * each, min((k + 1) * each, int(np.prod(grid.shape))))


def pieces_of(grid: PoseGrid) -> list[slice]:
    """Cut the positions of a grid into pieces of about CHUNK_POSES poses."""
    return [piece_of(grid, k) for k in range(piece_count(grid))]


@dataclass(frozen=True, eq=False)
class WorkspaceMap:
    """Results on a grid; arrays are (nx, ny, nz, o).

    Attributes:
        grid: where.
        capacity: margin, factor, closure.
        clearance: between cables, to the platform, to the target [m]; inf where not requested.
        free_above: clearance that counts as free of interference [m].
    """

    grid: PoseGrid
    capacity: Capacity
    clearance: Clearance
    free_above: float

    @property
    def feasible(self) -> BoolArray:
        """Wrench-feasible poses."""
        return self.capacity.feasible

    @property
    def free(self) -> BoolArray:
        """Poses free of interference."""
        return self.clearance.least >= self.free_above

    @property
    def usable(self) -> BoolArray:
        """Poses that are both."""
        return np.asarray(self.feasible & self.free)

    def volume(self, poses: BoolArray) -> float:
        """Count positions where every orientation belongs to `poses`, a cell each [m^3].

        Cells at the grid's boundary reach beyond it: `solids` has the volumes that are printed.
        """
        return float(poses.all(axis=-1).sum()) * self.grid.cell_volume

    def levels(self) -> dict[str, FloatArray]:
        """(nx, ny, nz) values above zero where a region is, worst over the orientations.

        Regions: "closed" (wrench-closed), "feasible", "free" of interference, "usable" (both).
        """
        free = (self.clearance.least - self.free_above).min(axis=-1)
        return {
            "closed": np.where(self.capacity.closed.all(axis=-1), 1.0, -1.0),
            "feasible": np.asarray(self.capacity.margin.min(axis=-1)),
            "free": np.where(np.isnan(free), -np.inf, free),
            "usable": self.level(),
        }

    def solids(self) -> dict[str, Mesh]:
        """Closed mesh round each region of `levels`; its volume is the region's, within the box.

        A grid of one position along an axis has no volume: its meshes are empty.
        """
        flat = min(self.grid.shape) < 2
        return {
            name: NO_MESH if flat else level_surface(self.grid.x, self.grid.y, self.grid.z, level)
            for name, level in self.levels().items()
        }

    def areas(self) -> dict[str, float]:
        """Area of each region of `levels` on a grid of one position along one axis [m^2].

        Raises:
            CabolsError: if the grid is another one.
        """
        axis = self.grid.flat_axis
        if axis is None:
            raise CabolsError(f"grid: expected one position along one axis, got {self.grid.shape}")
        axes = [self.grid.x, self.grid.y, self.grid.z]
        axes[axis] = np.array([0.0, SLAB_M])
        x, y, z = axes
        return {
            name: level_surface(x, y, z, np.repeat(level, 2, axis=axis)).volume / SLAB_M
            for name, level in self.levels().items()
        }

    def level(self) -> FloatArray:
        """(nx, ny, nz) least margin over the orientations, for surfaces at zero [N].

        Where cables interfere it is at most the missing clearance, in mm.
        """
        missing = 1e3 * (self.clearance.least - self.free_above)
        margin = np.where(
            missing < 0.0, np.minimum(self.capacity.margin, missing), self.capacity.margin
        )
        return np.asarray(margin.min(axis=-1))


def assemble(grid: PoseGrid, pieces: list[Piece], free_above: float = 0.0) -> WorkspaceMap:
    """Join the pieces of a grid in order.

    Args:
        grid: that was divided.
        pieces: its results, in order.
        free_above: clearance from which a pose counts as free [m].
    """
    shape = (*grid.shape, grid.angles_deg.shape[0])
    capacity = np.concatenate([piece.capacity for piece in pieces]).reshape(*shape, RESULTS)
    clearance = np.concatenate([piece.clearance for piece in pieces]).reshape(*shape, 3)
    return WorkspaceMap(
        grid, as_capacity(capacity), Clearance(*np.moveaxis(clearance, -1, 0)), free_above
    )
