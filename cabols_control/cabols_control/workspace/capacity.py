"""Wrench closure, wrench feasibility and capacity margins of poses and of structure matrices."""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.cable_kernels import structure_matrix_into
from cabols_control.checks import BoolArray, FloatArray, finite_array
from cabols_control.errors import ShapeError
from cabols_control.geometry import RigGeometry
from cabols_control.tension import DEFAULT_WEIGHTS, work_size
from cabols_control.tension.arguments import check_limits, check_weights
from cabols_control.tension.kernels.static_size import compiled

from .hyperplanes import (
    CLOSURE,
    FACTOR,
    MARGIN,
    RESULTS,
    capacity_at,
    capacity_of_matrix,
    facet_normals,
)
from .wrench_set import WrenchSet

CLOSED = 1e-9
"""Smallest radius of the closure ball that counts; below it rounding decides."""


class Capacity(NamedTuple):
    """What the cables can give at k poses.

    Attributes:
        margin: (k,) capacity margin: least distance from the required set to the boundary of
            the available wrenches, negative by how far it sticks out at most; torques count as
            forces by the weights [N]. -inf where the structure matrix has not full rank.
        factor: (k,) largest multiple of the required set (about the zero wrench) that the
            cables can give; 0 where none.
        closure: (k,) radius of the ball of weighted wrenches that tensions from 0 to 1 N give:
            positive where the pose is wrench-closed.
    """

    margin: FloatArray
    factor: FloatArray
    closure: FloatArray

    @property
    def feasible(self) -> BoolArray:
        """(k,) whether every wrench of the required set can be given inside the limits."""
        return self.margin >= 0.0

    @property
    def closed(self) -> BoolArray:
        """(k,) whether the cables, without upper tension limits, can give every wrench."""
        return self.closure > CLOSED


class CapacityTask(NamedTuple):
    """Arguments of a compiled loop over poses, checked and scaled.

    Attributes:
        base_points: (n, 3) A_i [m].
        platform_points: (n, 3) b_i [m].
        low: (n,) [N].
        high: (n,) [N].
        weights: (6,) of wrench components.
        points: (q, 6) of the required set, times the weights.
        generators: (p, 6) of it, times the weights.
        platform_axes: whether the required set turns with the platform.
    """

    base_points: FloatArray
    platform_points: FloatArray
    low: FloatArray
    high: FloatArray
    weights: FloatArray
    points: FloatArray
    generators: FloatArray
    platform_axes: bool


def capacity_task(
    geometry: RigGeometry,
    tension_min: ArrayLike,
    tension_max: ArrayLike,
    required: WrenchSet,
    platform_axes: bool = False,
    weights: ArrayLike | None = None,
) -> CapacityTask:
    """Check and scale the arguments of `capacity_along`.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a lower limit is above its upper limit or a weight is not positive.
    """
    if required.dimension != 6:
        raise ShapeError(f"required: expected wrenches (q, 6), got (q, {required.dimension})")
    scale = check_weights(weights)
    return CapacityTask(
        np.array(geometry.base_points),
        np.array(geometry.platform_points),
        *check_limits(geometry.cables, tension_min, tension_max),
        scale,
        required.points * scale,
        required.generators * scale,
        platform_axes,
    )


@compiled
def to_platform_axes(matrix: FloatArray, rotation: FloatArray) -> None:
    """Turn the columns of a structure matrix (6, n) from base to platform axes, in place."""
    for i in range(matrix.shape[1]):
        for part in range(2):
            x, y, z = matrix[3 * part, i], matrix[3 * part + 1, i], matrix[3 * part + 2, i]
            for k in range(3):
                turned = rotation[0, k] * x + rotation[1, k] * y + rotation[2, k] * z
                matrix[3 * part + k, i] = turned


@compiled
def capacity_loop(
    task: CapacityTask,
    positions: FloatArray,
    rotations: FloatArray,
    scratch: FloatArray,
    normals: FloatArray,
    results: FloatArray,
) -> None:
    """Fill results (k, o, RESULTS) for every position (k, 3) with every rotation (o, 3, 3)."""
    n = task.base_points.shape[0]
    vectors = task.points.shape[0] + task.generators.shape[0] + n
    work = scratch[: work_size(n)]
    start = work_size(n)
    products = scratch[start : start + n * vectors].reshape((n, vectors))
    start += n * vectors
    matrix = scratch[start : start + 6 * n].reshape((6, n))
    scaled = scratch[start + 6 * n : start + 12 * n].reshape((6, n))
    for k in range(positions.shape[0]):
        for o in range(rotations.shape[0]):
            structure_matrix_into(
                task.base_points, task.platform_points, positions[k], rotations[o], matrix
            )
            if task.platform_axes:
                to_platform_axes(matrix, rotations[o])
            capacity_at(task, matrix, work, products, normals, scaled, results[k, o])


def capacity_scratch(task: CapacityTask) -> tuple[FloatArray, FloatArray]:
    """Return the scratch of `capacity_loop`: one flat array, and normals."""
    n = task.base_points.shape[0]
    size = work_size(n) + n * (len(task.points) + len(task.generators) + n) + 12 * n
    return np.zeros(size), np.zeros((comb(n, 5), 6))


def capacity_along(
    geometry: RigGeometry,
    positions: ArrayLike,
    rotations: ArrayLike,
    tension_min: ArrayLike,
    tension_max: ArrayLike,
    required: WrenchSet,
    platform_axes: bool = False,
    weights: ArrayLike | None = None,
) -> Capacity:
    """Margins at the poses of a trajectory.

    Args:
        geometry: attachment points of n cables.
        positions: (k, 3) platform origins, base frame [m].
        rotations: (k, 3, 3) from platform to base axes; not checked to be rotations.
        tension_min: number or (n,) [N].
        tension_max: number or (n,) [N].
        required: wrenches that must be feasible at once, about the platform's origin.
        platform_axes: whether they are given in platform axes; else in base axes.
        weights: (6,) that make forces and torques comparable in the margin; default 1/N for
            force and 1/(0.15 m) for torque, as in `distribute`.

    Returns:
        Margin, factor and closure for every pose.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a lower limit is above its upper limit or a weight is not positive.

    Source:
        Bouchard, Gosselin, Moore 2010 (hyperplane shifting); Ruiz, Caro, Cardou, Guay 2015
        (capacity margin).
    """
    task = capacity_task(geometry, tension_min, tension_max, required, platform_axes, weights)
    points = finite_array("positions", positions, (None, 3))
    turns = finite_array("rotations", rotations, (points.shape[0], 3, 3))
    results = np.empty((points.shape[0], 1, RESULTS))
    scratch, normals = capacity_scratch(task)
    for k in range(points.shape[0]):
        capacity_loop(
            task, points[k : k + 1], turns[k : k + 1], scratch, normals, results[k : k + 1]
        )
    return as_capacity(results.reshape(-1, RESULTS))


def as_capacity(results: FloatArray) -> Capacity:
    """Split rows (..., RESULTS) into a Capacity."""
    return Capacity(results[..., MARGIN], results[..., FACTOR], results[..., CLOSURE])


def capacity_of_matrices(
    matrices: ArrayLike,
    tension_min: ArrayLike,
    tension_max: ArrayLike,
    required: WrenchSet,
    weights: ArrayLike | None = None,
) -> Capacity:
    """Margins for any cable robot, planar (m = 3) or spatial, from its structure matrices.

    Args:
        matrices: (k, m, n) structure matrices, W = A @ tension.
        tension_min: number or (n,) [N].
        tension_max: number or (n,) [N].
        required: wrenches of m components.
        weights: (m,) of the components; default as in `distribute` for m = 6, ones otherwise.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a lower limit is above its upper limit.
    """
    array = finite_array("matrices", matrices, (None, None, None))
    k, m, n = array.shape
    if required.dimension != m:
        raise ShapeError(f"required: expected wrenches (q, {m}), got (q, {required.dimension})")
    low, high = check_limits(n, tension_min, tension_max)
    default = DEFAULT_WEIGHTS if m == 6 else np.ones(m)
    scale = finite_array("weights", default if weights is None else weights, (m,))
    results, normals = np.empty((k, RESULTS)), np.zeros((comb(n, m - 1), m))
    points, generators = required.points * scale, required.generators * scale
    scaled = np.ascontiguousarray(array * scale[:, None])
    for matrix, row in zip(scaled, results, strict=True):
        capacity_of_matrix(matrix, low, high, points, generators, normals, row)
    return as_capacity(results)


def available_wrenches(
    matrix: ArrayLike, tension_min: ArrayLike, tension_max: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Half-spaces normals @ wrench <= offsets that bound what the cables can give.

    Args:
        matrix: (m, n) structure matrix.
        tension_min: number or (n,) [N].
        tension_max: number or (n,) [N].

    Returns:
        (h, m) unit normals and (h,) offsets; h = 0 if the matrix has not rank m. Facets that
        several sets of columns span come more than once.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
    """
    array = finite_array("matrix", matrix, (None, None))
    m, n = array.shape
    low, high = check_limits(n, tension_min, tension_max)
    normals = np.zeros((comb(n, m - 1), m))
    one_side = normals[: facet_normals(array, normals)]
    both = np.concatenate([one_side, -one_side])
    y = both @ array
    return both, np.where(y > 0.0, y * high, y * low).sum(axis=1)
