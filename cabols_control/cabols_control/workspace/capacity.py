# SPDX-License-Identifier: Apache-2.0
"""Wrench closure, wrench feasibility and capacity margins of poses and of structure matrices."""

from __future__ import annotations

from math import comb
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import BoolArray, FloatArray, IntArray, finite_array, in_range
from cabols_control.errors import ShapeError
from cabols_control.geometry import RigGeometry
from cabols_control.tension import DEFAULT_WEIGHTS, work_size
from cabols_control.tension.arguments import check_limits, check_weights

from .capacity_loops import capacity_loop, capacity_loop_of_part
from .facet_result import CLOSURE, FACTOR, HIGHEST, LOWEST, MARGIN, RESULTS
from .hyperplanes import capacity_of_matrix, facet_normals
from .wrench_set import WrenchSet

CLOSED = 1e-9
"""Smallest radius of the closure ball that counts; below it rounding decides."""

MOST_WEIGHT_N = 1e9
"""Largest weight of a platform that is taken: above, the units are wrong."""


class Capacity(NamedTuple):
    """What the cables can give at k poses.

    Attributes:
        margin: (k,) capacity margin: least distance from the required set to the boundary of
            the available wrenches, negative by how far it sticks out at most; torques count as
            forces by the weights [N]. -inf where the structure matrix has not full rank.
        factor: (k,) largest multiple of the required set (about the zero wrench, what is held
            staying) that the cables can give; 0 where none, or where only multiples above 1 fit,
            so that it is never above 1 where the set is not feasible.
        closure: (k,) radius of the ball of weighted wrenches that tensions from 0 to 1 N give:
            positive where the pose is wrench-closed.
        factor_low: (k,) least multiple of the set that fits; NaN where none does.
        factor_high: (k,) largest one; NaN where none does.
    """

    margin: FloatArray
    factor: FloatArray
    closure: FloatArray
    factor_low: FloatArray
    factor_high: FloatArray

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
        cables: (n,) records of CABLE.
        low: (n,) [N].
        high: (n,) [N].
        weights: (6,) of wrench components.
        points: (q, 6) of the required set, times the weights.
        generators: (p, 6) of it, times the weights.
        platform_axes: whether the required set turns with the platform.
        held: (6,) constant part of the required set, base axes [N, N m].
        weight: [N], along -z of the base frame.
        centre_of_mass: (3,) where it acts, platform axes [m].
        holds: whether there is a constant part at all.
        shortest: least length of a cable [m].
        longest: largest [m].
        directions: (m,) components of a wrench that count, of 6: see Motion.
    """

    cables: Any
    low: FloatArray
    high: FloatArray
    weights: FloatArray
    points: FloatArray
    generators: FloatArray
    platform_axes: bool
    held: FloatArray
    weight: float
    centre_of_mass: FloatArray
    holds: bool
    shortest: float
    longest: float
    directions: IntArray


class PlatformWeight(NamedTuple):
    """What hangs on the cables at every pose.

    Attributes:
        weight: [N], along -z of the base frame.
        centre_of_mass: (3,) where it acts, platform axes [m].
    """

    weight: float
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0)


NO_WEIGHT = PlatformWeight(0.0)


def capacity_task(
    geometry: RigGeometry,
    tension_min: ArrayLike,
    tension_max: ArrayLike,
    required: WrenchSet,
    platform_axes: bool = False,
    weights: ArrayLike | None = None,
    platform: PlatformWeight = NO_WEIGHT,
) -> CapacityTask:
    """Check and scale the arguments of `capacity_along`.

    Args:
        geometry: attachment points of n cables.
        tension_min: number or (n,) [N].
        tension_max: number or (n,) [N].
        required: wrenches (q, 6) that must be feasible at once [N, N m].
        platform_axes: whether they are given in platform axes; else in base axes.
        weights: (6,) positive, of the wrench's components; None for those of `distribute`.
        platform: its weight, held beside the required wrenches.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a lower limit is above its upper limit or a weight is not positive.
    """
    if required.dimension != 6:
        raise ShapeError(f"required: expected wrenches (q, 6), got (q, {required.dimension})")
    scale = check_weights(weights)
    weight = in_range("weight", platform.weight, 0.0, MOST_WEIGHT_N)
    centre = finite_array("centre_of_mass", platform.centre_of_mass, (3,))
    low, high = check_limits(geometry.cables, tension_min, tension_max)
    # What overflows here is inf or NaN, and fails at every pose.
    with np.errstate(over="ignore"):
        points, generators = required.points * scale, required.generators * scale
    return CapacityTask(
        cables=geometry.records(),
        low=low,
        high=high,
        weights=scale,
        points=points,
        generators=generators,
        platform_axes=platform_axes,
        held=required.held,
        weight=weight,
        centre_of_mass=centre,
        holds=bool(weight > 0.0 or required.held.any()),
        shortest=geometry.cable_length_min,
        longest=geometry.cable_length_max,
        directions=geometry.motion.directions,
    )


def evaluate_poses(
    task: CapacityTask, positions: FloatArray, rotations: FloatArray, results: FloatArray
) -> None:
    """Fill results (k, o, RESULTS) for every position (k, 3) with every rotation (o, 3, 3).

    Args:
        task: rig, limits and required wrenches.
        positions: (k, 3) base frame [m].
        rotations: (o, 3, 3) from platform to base axes.
        results: filled.
    """
    loop = capacity_loop if task.directions.size == 6 else capacity_loop_of_part
    loop(task, positions, rotations, *capacity_scratch(task), results)


def capacity_scratch(task: CapacityTask) -> tuple[FloatArray, FloatArray]:
    """Return the scratch of `capacity_loop`: one flat array, and normals."""
    n, m = task.cables.shape[0], task.directions.size
    size = work_size(n) + n * (len(task.points) + len(task.generators) + n) + 12 * n
    return np.zeros(size), np.zeros((comb(n, m - 1), m))


def capacity_along(
    geometry: RigGeometry,
    positions: ArrayLike,
    rotations: ArrayLike,
    tension_min: ArrayLike,
    tension_max: ArrayLike,
    required: WrenchSet,
    platform_axes: bool = False,
    weights: ArrayLike | None = None,
    platform: PlatformWeight = NO_WEIGHT,
) -> Capacity:
    """Margins at the poses of a trajectory.

    A pose where a cable is shorter or longer than the geometry allows is out of reach: margin
    -inf, the rest 0.

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
        platform: its weight, held at every pose beside the required wrenches.

    Returns:
        Margin, factor, closure and interval of factors for every pose.

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        CabolsError: if a lower limit is above its upper limit or a weight is not positive.

    Source:
        Bouchard, Gosselin, Moore 2010 (hyperplane shifting); Ruiz, Caro, Cardou, Guay 2015
        (capacity margin).
    """
    task = capacity_task(
        geometry, tension_min, tension_max, required, platform_axes, weights, platform
    )
    points = finite_array("positions", positions, (None, 3))
    turns = finite_array("rotations", rotations, (points.shape[0], 3, 3))
    results = np.empty((points.shape[0], 1, RESULTS))
    scratch, normals = capacity_scratch(task)
    loop = capacity_loop if task.directions.size == 6 else capacity_loop_of_part
    for k in range(points.shape[0]):
        loop(task, points[k : k + 1], turns[k : k + 1], scratch, normals, results[k : k + 1])
    return as_capacity(results.reshape(-1, RESULTS))


def as_capacity(results: FloatArray) -> Capacity:
    """Split rows (..., RESULTS) into a Capacity."""
    return Capacity(*(results[..., k] for k in (MARGIN, FACTOR, CLOSURE, LOWEST, HIGHEST)))


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
    with np.errstate(over="ignore"):
        points, generators = required.points * scale, required.generators * scale
        scaled = np.ascontiguousarray(array * scale[:, None])
        held = required.held * scale
    for matrix, row in zip(scaled, results, strict=True):
        capacity_of_matrix(matrix, low, high, held, points, generators, normals, row)
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
