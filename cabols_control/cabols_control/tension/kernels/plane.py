# SPDX-License-Identifier: Apache-2.0
"""Exact minimum-norm tensions for at most two degrees of redundancy.

The tensions that give a wrench are t0 + N z, t0 = pinv(A) w orthogonal to N: minimising their
norm is minimising |z| in the intersection of n slabs, tension_min <= t0 + N z <= tension_max
(Taghirad and Bedoustani 2011; thesis (3.5)-(3.7), with upper limits added). In the plane, the
slabs are taken in turn: if the best point so far violates one, the new best point lies on that
limit's line (the objective is convex), where an interval is clipped by the slabs taken before.
An empty interval proves infeasibility. Every slab is taken at most once: at most n(n - 1)/2
clips, 28 for n = 8, no cycling. The slab taken next is the one that is violated most, so that
two or three of the eight are usually enough.

These functions work on one pose's work array; see work_array.py.
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray

from .static_size import Size, cables, compiled
from .work_array import (
    CONFLICT,
    CONFLICT_SIDE,
    ITERATIONS,
    SCALE,
    TOLERANCE,
    Six,
    at_basis,
    at_inverse,
    at_limits,
    at_scratch,
)

PARALLEL = 1e-13
"""A slab whose tension changes by less than this per unit along a line is constant on it."""
VIOLATION = 1e-15
"""Times the largest limit: what counts as violated while the best point is still moving."""


@compiled
def pseudo_inverse_tension(work: FloatArray, size: Size, wrench: Six, out: FloatArray) -> None:
    """Write the least-norm tensions t0, limits ignored.

    Args:
        work: work array of a pose that is ready.
        size: number of cables n, see static_size.py.
        wrench: six floats, times the weights.
        out: (n,) filled [N].
    """
    n = cables(size)
    inverse = at_inverse(n)
    w0, w1, w2, w3, w4, w5 = wrench
    for i in range(n):
        out[i] = (
            (work[inverse + i] * w0 + work[inverse + n + i] * w1)
            + (work[inverse + 2 * n + i] * w2 + work[inverse + 3 * n + i] * w3)
        ) + (work[inverse + 4 * n + i] * w4 + work[inverse + 5 * n + i] * w5)


@compiled
def set_conflict(
    work: FloatArray,
    first: int,
    first_side: float,
    second: int,
    second_side: float,
    third: int,
    third_side: float,
) -> None:
    """Note in the header which limits contradict each other.

    Args:
        work: work array of the pose.
        first: cable, from 0.
        first_side: its limit: -1 lower, +1 upper.
        second: cable, -1 if there is none.
        second_side: its limit.
        third: cable, -1 if there is none.
        third_side: its limit.
    """
    work[CONFLICT] = first
    work[CONFLICT_SIDE] = first_side
    work[CONFLICT + 1] = second
    work[CONFLICT_SIDE + 1] = second_side
    work[CONFLICT + 2] = third
    work[CONFLICT_SIDE + 2] = third_side


@compiled
def meeting_point(
    lower: float, lower_slope: float, upper: float, upper_slope: float, tolerance: float
) -> tuple[float, bool]:
    """Where an empty interval's ends are missed least.

    The limit at `lower` has a tension changing by `lower_slope` > 0 per unit, and so on: moving
    to s misses them by (lower - s) * lower_slope and (s - upper) * upper_slope; s makes the two
    equal.

    Args:
        lower: the interval's lower end, above the upper.
        lower_slope: positive, of the tension whose limit it is [N per unit].
        upper: the upper end.
        upper_slope: as lower_slope.
        tolerance: miss that is put up with [N].

    Returns:
        s, and whether the miss is tolerable.
    """
    total = lower_slope + upper_slope
    miss = (lower - upper) * (lower_slope * upper_slope / total)
    return (lower * lower_slope + upper * upper_slope) / total, miss <= tolerance


@compiled
def nearest_to_zero(lower: float, upper: float) -> float:
    """Point of an interval that is nearest to zero.

    Args:
        lower: its lower end.
        upper: its upper end, not below.
    """
    return min(max(0.0, lower), upper)


@compiled
def solve_point(work: FloatArray, size: Size, tension: FloatArray) -> bool:
    """No redundancy: whether the only solution keeps the limits.

    Args:
        work: work array of a pose that is ready, six cables.
        size: number of cables, see static_size.py.
        tension: (6,) t0 [N].
    """
    n = cables(size)
    limits, tolerance = at_limits(n), work[TOLERANCE]
    work[ITERATIONS] = n
    for i in range(n):
        low, high = work[limits + i] - tolerance, work[limits + n + i] + tolerance
        if not low <= tension[i] <= high:
            return False
    return True


@compiled
def solve_line(work: FloatArray, size: Size, tension: FloatArray) -> bool:
    """One degree of redundancy: n clips of one interval.

    Args:
        work: work array of a pose that is ready, seven cables.
        size: number of cables, see static_size.py.
        tension: (7,) t0, then the answer [N]; left at t0 if there is none.

    Returns:
        Whether it is feasible.
    """
    n = cables(size)
    limits, basis, tolerance = at_limits(n), at_basis(n) + 6 * n, work[TOLERANCE]
    lower, lower_slope, upper, upper_slope = -math.inf, 1.0, math.inf, 1.0
    work[ITERATIONS] = n
    for i in range(n):
        slope, low, high = work[basis + i], work[limits + i], work[limits + n + i]
        if abs(slope) < PARALLEL:
            if tension[i] < low - tolerance or tension[i] > high + tolerance:
                return False
            continue
        start, end = (low - tension[i]) / slope, (high - tension[i]) / slope
        if slope < 0.0:
            start, end, slope = end, start, -slope
        if start > lower:
            lower, lower_slope = start, slope
        if end < upper:
            upper, upper_slope = end, slope
    if lower > upper:
        z, fits = meeting_point(lower, lower_slope, upper, upper_slope, tolerance)
        if not fits:
            return False
    else:
        z = nearest_to_zero(lower, upper)
    for i in range(n):
        tension[i] += work[basis + i] * z
    return True


@compiled
def _clip_line(
    work: FloatArray,
    size: Size,
    tension: FloatArray,
    order: int,
    taken: int,
    active: int,
    side: float,
) -> tuple[float, float, bool]:
    """Best point on the line of limit `side` of cable `active`, inside the slabs taken before.

    Returns z and whether the slabs leave something of the line; if not, notes the conflict and
    returns the point of the line that misses the two contradicting limits equally.
    """
    n = cables(size)
    limits, nx, ny = at_limits(n), at_basis(n) + 6 * n, at_basis(n) + 7 * n
    tolerance = work[TOLERANCE]
    ax, ay = work[nx + active], work[ny + active]
    bound = work[limits + active] if side < 0.0 else work[limits + n + active]
    square = ax * ax + ay * ay
    reach = (bound - tension[active]) / square
    # Foot of the perpendicular from the origin, and the line's direction, as long as (ax, ay).
    fx, fy, dx, dy = reach * ax, reach * ay, -ay, ax
    parallel = PARALLEL * PARALLEL * square
    lower, lower_slope, lower_at, lower_side = -math.inf, 1.0, -1, -1.0
    upper, upper_slope, upper_at, upper_side = math.inf, 1.0, -1, 1.0
    for k in range(taken):
        j = int(work[order + k])
        slope = work[nx + j] * dx + work[ny + j] * dy
        value = tension[j] + work[nx + j] * fx + work[ny + j] * fy
        low, high = work[limits + j] - value, work[limits + n + j] - value
        if slope * slope < parallel:
            if low > tolerance or high < -tolerance:
                which = -1.0 if low > tolerance else 1.0
                set_conflict(work, active, side, j, which, -1, 0.0)
                return fx, fy, False
            continue
        scale = 1.0 / slope
        start, end, start_side = low * scale, high * scale, -1.0
        if slope < 0.0:
            start, end, start_side, slope = end, start, 1.0, -slope
        if start > lower:
            lower, lower_slope, lower_at, lower_side = start, slope, j, start_side
        if end < upper:
            upper, upper_slope, upper_at, upper_side = end, slope, j, -start_side
    s, fits = nearest_to_zero(lower, upper), True
    if lower > upper:
        s, fits = meeting_point(lower, lower_slope, upper, upper_slope, tolerance)
        if not fits:
            set_conflict(work, active, side, lower_at, lower_side, upper_at, upper_side)
    return fx + s * dx, fy + s * dy, fits


@compiled
def solve_plane(work: FloatArray, size: Size, tension: FloatArray) -> bool:
    """Two degrees of redundancy: at most n(n - 1)/2 clips.

    Args:
        work: work array of a pose that is ready, eight cables; if infeasible, its header receives
            the one to three limits that prove it, see set_conflict.
        size: number of cables, see static_size.py.
        tension: (8,) t0, then the answer [N]; left at t0 if there is none.

    Returns:
        Whether it is feasible.
    """
    n = cables(size)
    limits, nx, ny = at_limits(n), at_basis(n) + 6 * n, at_basis(n) + 7 * n
    order = at_scratch(n)
    pending = order + n
    threshold, tolerance = VIOLATION * work[SCALE], work[TOLERANCE]
    for i in range(n):
        work[pending + i] = 1.0
    zx, zy, clips, taken = 0.0, 0.0, 0, 0
    for _ in range(n):
        worst, active, side = threshold, -1, 0.0
        for i in range(n):
            value = tension[i] + (work[nx + i] * zx + work[ny + i] * zy)
            miss_low, miss_high = work[limits + i] - value, value - work[limits + n + i]
            miss = max(miss_low, miss_high) * work[pending + i]
            if miss > worst:
                worst, active, side = miss, i, (-1.0 if miss_low > miss_high else 1.0)
        if active < 0:
            break
        if max(abs(work[nx + active]), abs(work[ny + active])) < PARALLEL:
            if worst > tolerance:
                set_conflict(work, active, side, -1, 0.0, -1, 0.0)
                return False
            work[pending + active] = 0.0
            continue
        zx, zy, fits = _clip_line(work, size, tension, order, taken, active, side)
        clips += taken
        work[ITERATIONS] = clips
        if not fits:
            return False
        work[order + taken] = active
        work[pending + active] = 0.0
        taken += 1
    work[ITERATIONS] = clips
    for i in range(n):
        tension[i] += work[nx + i] * zx + work[ny + i] * zy
    return True
