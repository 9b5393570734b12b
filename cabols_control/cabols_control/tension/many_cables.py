# SPDX-License-Identifier: Apache-2.0
"""Tensions away from their limits at any redundancy: p-norm, barycentre, analytic centre.

The feasible tensions t = t0 + N z are a polytope of as many dimensions as the cables have degrees
of redundancy. With one or two the compiled loops find its points (methods.py); for more, and for
robots that move in a plane only, `distribute` comes here: milliseconds, for analysis and design.
As there, tensions fade into the least norm's where the polytope is narrow, which keeps them
continuous.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cabols_control.checks import FloatArray

from .methods import ANALYTIC_CENTRE, BARYCENTRE, NARROW

FLAT = 1e-10
"""Inradius over the largest limit below which the polytope is a face of fewer dimensions."""
HELD = 1e-9
"""Times the largest limit: a cable whose limits are closer is held at one tension."""
FIXED = 1e-12
"""A cable whose row of N is shorter has nothing to choose."""
STEPS = 200
BARRIER_FACTOR = 0.1
LEAST_BARRIER = 1e-13
"""Weight of the barrier at which a constrained p-norm ends, in units of the norm."""
DECREMENT = 1e-20

Terms = tuple[float, FloatArray, FloatArray]
"""Value, gradient and Hessian; the value is inf outside."""


def choose_in_polytope(
    matrix: FloatArray,
    tension: FloatArray,
    low: FloatArray,
    high: FloatArray,
    method: int,
    exponent: float,
) -> FloatArray:
    """Tensions of a method from those of the least norm, which give the same wrench.

    Args:
        matrix: (6, n) structure matrix, of any rank.
        tension: (n,) of the least norm, inside the limits [N].
        low: (n,) lower limits [N].
        high: (n,) upper limits [N].
        method: P_NORM, BARYCENTRE or ANALYTIC_CENTRE.
        exponent: p of the p-norm.

    Returns:
        (n,) tensions inside the limits [N].

    Source:
        Boyd and Vandenberghe 2004, 8.5 (centres), 11.3 (barrier); Gosselin and Grenier 2011
        (p-norm); Mikelsons et al. 2008 (barycentre).
    """
    scale = max(float(np.abs([low, high]).max()), np.finfo(float).tiny)
    basis = _null_columns(matrix)
    held = high - low <= HELD * scale
    if held.any():
        basis = basis @ _null_columns(basis[held])
    free = np.linalg.norm(basis, axis=1) > FIXED
    sides = np.vstack([basis[free], -basis[free]])
    room = np.concatenate([(high - tension)[free], (tension - low)[free]])
    ball = _largest_ball(sides, np.maximum(room, 0.0))
    if ball is None or not ball[1] > FLAT * scale:
        return tension
    start, radius = ball
    if method == BARYCENTRE:
        z = _centroid(sides, room, start)
    elif method == ANALYTIC_CENTRE:
        z = _descend(lambda at: _barrier(sides, room, at), start)
    else:
        z = _least_norm_of_power(basis, tension, low, high, (sides, room), start, exponent)
    inside = basis @ (min(radius / (NARROW * scale), 1.0) * z)
    return np.clip(tension + inside, low, high)


def _null_columns(matrix: FloatArray) -> FloatArray:
    """Orthonormal columns of a matrix's null space."""
    _, values, rows = np.linalg.svd(matrix)
    rank = int((values > 1e-10 * values.max(initial=0.0)).sum())
    return np.asarray(rows[rank:].T, dtype=np.float64)


def _largest_ball(sides: FloatArray, room: FloatArray) -> tuple[FloatArray, float] | None:
    """Centre and radius of a largest ball in sides @ z <= room; None: there is none."""
    from scipy.optimize import linprog  # seconds to import, seldom used

    if not sides.size:
        return None
    size = float(room.max())
    if not size > 0.0:
        return None
    lengths = np.linalg.norm(sides, axis=1)
    cost = np.zeros(sides.shape[1] + 1)
    cost[-1] = -1.0
    bounds = [(None, None)] * sides.shape[1] + [(0.0, None)]
    found = linprog(cost, np.column_stack([sides, lengths]), room / size, bounds=bounds)
    return (size * found.x[:-1], size * float(found.x[-1])) if found.status == 0 else None


def _centroid(sides: FloatArray, room: FloatArray, inside: FloatArray) -> FloatArray:
    """Centroid of a polytope, by simplices from a point inside to its facets' triangles."""
    from scipy.spatial import ConvexHull, HalfspaceIntersection

    if sides.shape[1] == 1:
        along = sides.ravel()
        upper, ends = along > 0.0, room / along
        return np.array([0.5 * (ends[upper].min() + ends[~upper].max())])
    corners = HalfspaceIntersection(np.column_stack([sides, -room]), inside).intersections
    simplices = corners[ConvexHull(corners).simplices]
    volumes = np.abs(np.linalg.det(simplices - inside))
    middles = (simplices.sum(axis=1) + inside) / (sides.shape[1] + 1.0)
    return np.asarray(volumes @ middles / volumes.sum(), dtype=np.float64)


def _barrier(sides: FloatArray, room: FloatArray, z: FloatArray) -> Terms:
    """-sum log of the distances from the limits."""
    left = room - sides @ z
    if not (left > 0.0).all():
        return math.inf, np.zeros(z.size), np.eye(z.size)
    scaled = sides / left[:, None]
    return -float(np.log(left).sum()), scaled.sum(axis=0), scaled.T @ scaled


def _descend(terms: Callable[[FloatArray], Terms], start: FloatArray) -> FloatArray:
    """Minimum of a convex function by Newton steps, each shortened until the function falls."""
    z = start
    value, gradient, hessian = terms(z)
    for _ in range(STEPS):
        step = -np.linalg.lstsq(hessian, gradient, rcond=None)[0]
        decrement = -float(gradient @ step)
        if not decrement > DECREMENT * max(abs(value), 1.0):
            break
        share = 1.0
        while share > 1e-12:
            following = terms(z + share * step)
            if following[0] <= value - 0.1 * share * decrement:
                break
            share *= 0.5
        else:
            break
        z = z + share * step
        value, gradient, hessian = following
    return z


def _least_norm_of_power(
    basis: FloatArray,
    tension: FloatArray,
    low: FloatArray,
    high: FloatArray,
    limits: tuple[FloatArray, FloatArray],
    start: FloatArray,
    exponent: float,
) -> FloatArray:
    """Least sum |d_i|^p within the limits, d_i from the middle of cable i's over half of them."""
    half = 0.5 * (high - low)
    counts = half > FIXED * np.abs([low, high]).max()
    stretched = basis[counts] / half[counts, None]
    offset = (tension[counts] - low[counts]) / half[counts] - 1.0

    def power(z: FloatArray) -> Terms:
        deviation = offset + stretched @ z
        size = np.abs(deviation)
        slope = exponent * size ** (exponent - 1.0) * np.sign(deviation)
        curve = exponent * (exponent - 1.0) * size ** (exponent - 2.0)
        hessian = (stretched.T * curve) @ stretched
        return float((size**exponent).sum()), stretched.T @ slope, hessian

    z = _descend(power, start)
    if (limits[0] @ z <= limits[1]).all():
        return z
    z, weight = start, 1.0
    while weight > LEAST_BARRIER:

        def both(at: FloatArray, weight: float = weight) -> Terms:
            wall = _barrier(*limits, at)
            if not wall[0] < math.inf:
                return wall
            norm = power(at)
            return (
                norm[0] + weight * wall[0],
                norm[1] + weight * wall[1],
                norm[2] + weight * wall[2],
            )

        z = _descend(both, z)
        weight *= BARRIER_FACTOR
    return z
