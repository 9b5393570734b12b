# SPDX-License-Identifier: Apache-2.0
"""The polygon of all feasible tensions at two degrees of redundancy: clipping and centroid.

With t = t0 + N z the limits are slabs in the plane of z. Their intersection is a convex polygon
of at most 2 n edges, found by clipping a square that surely holds it, edge by edge (Sutherland
and Hodgman 1974). Points lie in the caller's scratch as x, y pairs.
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray

from .static_size import compiled
from .work_array import SCALE, at_basis, at_limits

FLAT = 1e-12
"""Area over the square of the largest limit, below which a polygon counts as a segment or point."""


@compiled
def max_corners(n: int) -> int:
    """Corners that the polygon of n cables may have, the square's four included."""
    return 2 * n + 4


@compiled
def _clip(
    points: FloatArray, count: int, ax: float, ay: float, bound: float, out: FloatArray
) -> int:
    """Keep the part with ax x + ay y <= bound; the number of corners of what is left."""
    kept = 0
    for k in range(count):
        last = count - 1 if k == 0 else k - 1
        px, py = points[2 * last], points[2 * last + 1]
        x, y = points[2 * k], points[2 * k + 1]
        before, here = ax * px + ay * py - bound, ax * x + ay * y - bound
        if (before <= 0.0) != (here <= 0.0):
            share = before / (before - here)
            out[2 * kept] = px + share * (x - px)
            out[2 * kept + 1] = py + share * (y - py)
            kept += 1
        if here <= 0.0:
            out[2 * kept], out[2 * kept + 1] = x, y
            kept += 1
    return kept


@compiled
def feasible_polygon(
    work: FloatArray,
    n: int,
    tension: FloatArray,
    tolerance: float,
    points: FloatArray,
    other: FloatArray,
) -> int:
    """Corners of the polygon of z with tension + N z inside the limits.

    Args:
        work: work array of a pose that is ready, n = rank + 2.
        n: number of cables.
        tension: (n,) the tensions at z = 0 [N].
        tolerance: by which the limits are widened, against rounding [N].
        points: (2 max_corners(n),) receives the corners, counter-clockwise.
        other: (2 max_corners(n),) scratch.

    Returns:
        How many; 0 if nothing is left. At most 2 n clips of at most 2 n + 4 corners.
    """
    low, nx = at_limits(n), at_basis(n) + (n - 2) * n
    high, ny = low + n, nx + n
    reach = 0.0
    for i in range(n):
        reach += max(abs(work[low + i]), abs(work[high + i])) + abs(tension[i])
    points[0], points[1], points[2], points[3] = -reach, -reach, reach, -reach
    points[4], points[5], points[6], points[7] = reach, reach, -reach, reach
    count = 4
    for i in range(n):
        ax, ay = work[nx + i], work[ny + i]
        count = _clip(points, count, ax, ay, work[high + i] - tension[i] + tolerance, other)
        count = _clip(other, count, -ax, -ay, tension[i] - work[low + i] + tolerance, points)
    return count


@compiled
def flat_ends(points: FloatArray, count: int) -> tuple[float, float, float, float]:
    """Ends x, y, x, y of a polygon without area: a segment, or twice a point.

    Args:
        points: x, y of its corners [N].
        count: how many, at least 1.
    """
    # The corner farthest from any corner is one end; the other is farthest from it.
    ends_x, ends_y = (points[0], points[0]), (points[1], points[1])
    for _ in range(2):
        far, ox, oy = -1.0, ends_x[1], ends_y[1]
        ex, ey = ox, oy
        for k in range(count):
            dx, dy = points[2 * k] - ox, points[2 * k + 1] - oy
            if dx * dx + dy * dy > far:
                far, ex, ey = dx * dx + dy * dy, points[2 * k], points[2 * k + 1]
        ends_x, ends_y = (ox, ex), (oy, ey)
    return ends_x[0], ends_y[0], ends_x[1], ends_y[1]


@compiled
def half_width(points: FloatArray, count: int, area: float) -> float:
    """Twice the area over the perimeter: between inradius and half the least width.

    Args:
        points: (2 count,) corners in order, x and y in turn.
        count: number of corners.
        area: twice the polygon's area, in squares of the points' unit.
    """
    length = 0.0
    for k in range(count):
        j = k + 1 if k + 1 < count else 0
        dx, dy = points[2 * j] - points[2 * k], points[2 * j + 1] - points[2 * k + 1]
        length += math.sqrt(dx * dx + dy * dy)
    return area / length if length > 0.0 else 0.0


@compiled
def centroid(work: FloatArray, points: FloatArray, count: int) -> tuple[float, float, float]:
    """Centroid of a polygon.

    Args:
        work: work array of the pose, for the largest limit.
        points: x, y of its corners, counter-clockwise [N].
        count: how many, at least 1.

    Returns:
        x, y [N] and twice the area [N^2], which is 0 if it is flat: then the middle of its ends.
    """
    ox, oy = points[0], points[1]
    area, sx, sy = 0.0, 0.0, 0.0
    for k in range(1, count - 1):
        ax, ay = points[2 * k] - ox, points[2 * k + 1] - oy
        bx, by = points[2 * k + 2] - ox, points[2 * k + 3] - oy
        part = ax * by - ay * bx
        area += part
        sx += part * (ax + bx)
        sy += part * (ay + by)
    if area > FLAT * work[SCALE] * work[SCALE]:
        return ox + sx / (3.0 * area), oy + sy / (3.0 * area), area
    ax, ay, bx, by = flat_ends(points, count)
    return 0.5 * (ax + bx), 0.5 * (ay + by), 0.0
