# SPDX-License-Identifier: Apache-2.0
"""First try for the nearest wrench: project on the hyperplane that a conflict names."""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray

from .plane import PARALLEL, pseudo_inverse_tension
from .static_size import Size, cables, compiled
from .work_array import (
    CONFLICT,
    CONFLICT_SIDE,
    SCALE,
    Six,
    at_basis,
    at_inverse,
    at_limits,
    at_vector,
)

KEEPS = 1e-13
"""Times the largest limit: free tensions may leave the limits by this before they are clipped."""
SIDE = 2
"""Scratch vector: 0 for free cables, -1 at the lower, +1 at the upper limit."""


@compiled
def pin(work: FloatArray, size: Size, i: int, side: float, tension: FloatArray) -> None:
    """Put a cable on one of its limits.

    Args:
        work: work array of the pose; its vector SIDE is written.
        size: number of cables, see static_size.py.
        i: the cable, from 0.
        side: -1 for the lower limit, +1 for the upper.
        tension: (n,) [N]; its entry is set.
    """
    n = cables(size)
    limits = at_limits(n)
    work[at_vector(n, SIDE) + i] = side
    tension[i] = work[limits + i] if side < 0.0 else work[limits + n + i]


@compiled
def _combine(
    work: FloatArray, row: int, ma: float, a: int, mb: float, b: int, mc: float, c: int
) -> float:
    """Combination of three entries of one row."""
    entry: float = ma * work[row + a] + mb * work[row + b] + mc * work[row + c]
    return entry


@compiled
def _multipliers(
    work: FloatArray, size: Size, tension: FloatArray
) -> tuple[int, int, float, float, float, float, float, float]:
    """Cables b, c of the conflict, limits of a and b, multipliers m of all three, and their gap.

    sum m_i N_i = 0, and sum m_i (t_i - limit_i) is what no tension can change.
    """
    n = cables(size)
    limits, nx, ny = at_limits(n), at_basis(n) + 6 * n, at_basis(n) + 7 * n
    a, b, c = int(work[CONFLICT]), int(work[CONFLICT + 1]), int(work[CONFLICT + 2])
    b = max(b, 0)
    ax, ay, bx, by = work[nx + a], work[ny + a], work[nx + b], work[ny + b]
    at_a = work[limits + a] if work[CONFLICT_SIDE] < 0.0 else work[limits + n + a]
    at_b = work[limits + b] if work[CONFLICT_SIDE + 1] < 0.0 else work[limits + n + b]
    if c >= 0:
        cx, cy = work[nx + c], work[ny + c]
        at_c = work[limits + c] if work[CONFLICT_SIDE + 2] < 0.0 else work[limits + n + c]
        ma, mb, mc = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
    else:
        c, at_c, mc = a, at_a, 0.0
        ma, mb = bx * bx + by * by, -(ax * bx + ay * by)
    if ma == 0.0:  # a cable whose tension the wrench alone decides
        ma = 1.0
    gap = ma * (tension[a] - at_a) + mb * (tension[b] - at_b) + mc * (tension[c] - at_c)
    return b, c, at_a, at_b, ma, mb, mc, gap


@compiled
def facet_distance(work: FloatArray, size: Size, tension: FloatArray) -> float:
    """How far the wrench is beyond the hyperplane that the conflict names, weighted metric.

    Args:
        work: work array with the plane solver's conflict in its header.
        size: number of cables.
        tension: (n,) pseudo-inverse tensions [N].
    """
    n = cables(size)
    inverse = at_inverse(n)
    b, c, _, _, ma, mb, mc, gap = _multipliers(work, size, tension)
    a = int(work[CONFLICT])
    square = 0.0
    for k in range(6):
        y = _combine(work, inverse + k * n, ma, a, mb, b, mc, c)
        square += y * y
    return abs(gap) / math.sqrt(square)


@compiled
def project_on_facet(work: FloatArray, size: Size, target: Six, tension: FloatArray) -> bool:
    """Project the wrench on the hyperplane that the conflict names; sides from what results.

    With multipliers m, sum m_i N_i = 0 over the conflict, y = pinv(B)^T m is the normal:
    y . (B t) = m . t for every t.

    Args:
        work: work array with the plane solver's conflict in its header; its vector SIDE is written.
        size: number of cables, 8, see static_size.py.
        target: six floats, the wrench times the weights.
        tension: (n,) pseudo-inverse tensions, then inside the limits but for KEEPS [N].

    Returns:
        Whether the other tensions keep their limits, which makes the projection the nearest wrench
        (up to the least norm on its face).
    """
    n = cables(size)
    limits, inverse = at_limits(n), at_inverse(n)
    nx, ny, side = at_basis(n) + 6 * n, at_basis(n) + 7 * n, at_vector(n, SIDE)
    b, c, at_a, at_b, ma, mb, mc, gap = _multipliers(work, size, tension)
    a = int(work[CONFLICT])
    ax, ay, bx, by = work[nx + a], work[ny + a], work[nx + b], work[ny + b]
    y0 = _combine(work, inverse, ma, a, mb, b, mc, c)
    y1 = _combine(work, inverse + n, ma, a, mb, b, mc, c)
    y2 = _combine(work, inverse + 2 * n, ma, a, mb, b, mc, c)
    y3 = _combine(work, inverse + 3 * n, ma, a, mb, b, mc, c)
    y4 = _combine(work, inverse + 4 * n, ma, a, mb, b, mc, c)
    y5 = _combine(work, inverse + 5 * n, ma, a, mb, b, mc, c)
    step = gap / ((y0 * y0 + y1 * y1) + (y2 * y2 + y3 * y3) + (y4 * y4 + y5 * y5))
    v0, v1, v2, v3, v4, v5 = target
    facet = (
        v0 - step * y0,
        v1 - step * y1,
        v2 - step * y2,
        v3 - step * y3,
        v4 - step * y4,
        v5 - step * y5,
    )
    pseudo_inverse_tension(work, size, facet, tension)
    zx, zy, square = 0.0, 0.0, ax * ax + ay * ay
    if mc != 0.0:
        scale = 1.0 / mc
        ra, rb = (at_a - tension[a]) * scale, (at_b - tension[b]) * scale
        zx, zy = ra * by - rb * ay, rb * ax - ra * bx
    elif square > PARALLEL * PARALLEL:
        reach = (at_a - tension[a]) / square
        zx, zy = reach * ax, reach * ay
    good, margin = True, KEEPS * work[SCALE]
    for i in range(n):
        value = tension[i] + (work[nx + i] * zx + work[ny + i] * zy)
        low, high = work[limits + i], work[limits + n + i]
        if value < low - margin:
            work[side + i], value, good = -1.0, low, False
        elif value > high + margin:
            work[side + i], value, good = 1.0, high, False
        else:
            work[side + i] = 0.0
        tension[i] = value
    for k in range(3):
        if work[CONFLICT + k] >= 0.0:
            pin(work, size, int(work[CONFLICT + k]), work[CONFLICT_SIDE + k], tension)
    return good
