# SPDX-License-Identifier: Apache-2.0
"""Distance between two line segments, in closed form. Points are tuples (x, y, z) [m]."""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray
from cabols_control.tension.kernels.static_size import compiled

Point = tuple[float, float, float]
SMALL = 1e-24
"""Square of a length [m^2] below which a segment counts as a point."""


@compiled
def row(points: FloatArray, i: int) -> Point:
    """One of many points.

    Args:
        points: (n, 3) [m].
        i: which, from 0.
    """
    return points[i, 0], points[i, 1], points[i, 2]


@compiled
def minus(a: Point, b: Point) -> Point:
    """Vector from b to a.

    Args:
        a: where it ends [m].
        b: where it begins [m].
    """
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def dot(a: Point, b: Point) -> float:
    """Scalar product [m^2].

    Args:
        a: vector [m].
        b: vector [m].
    """
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def towards(a: Point, b: Point, share: float) -> Point:
    """Point on the way from one point to another.

    Args:
        a: where the way begins [m].
        b: where it ends [m].
        share: of the way, 0 at a, 1 at b.
    """
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])


@compiled
def _clamp(value: float) -> float:
    return min(max(value, 0.0), 1.0)


@compiled
def segment_distance(p: Point, q: Point, r: Point, s: Point) -> float:
    """Least distance between two segments [m]; exact, no iteration.

    The closest points of the two lines, clamped to the segments one after the other (Ericson,
    Real-Time Collision Detection, 2005, 5.1.9); parallel and point-like segments included.

    Args:
        p: one end of the first segment [m].
        q: its other end [m].
        r: one end of the second [m].
        s: its other end [m].
    """
    d, e, w = minus(q, p), minus(s, r), minus(p, r)
    dd, ee, de = dot(d, d), dot(e, e), dot(d, e)
    dw, ew = dot(d, w), dot(e, w)
    along, across = 0.0, 0.0
    if dd > SMALL and ee > SMALL:
        slant = dd * ee - de * de
        if slant > 1e-14 * dd * ee:
            along = _clamp((de * ew - dw * ee) / slant)
        across = (de * along + ew) / ee
        if across < 0.0:
            across, along = 0.0, _clamp(-dw / dd)
        elif across > 1.0:
            across, along = 1.0, _clamp((de - dw) / dd)
    elif dd > SMALL:
        along = _clamp(-dw / dd)
    elif ee > SMALL:
        across = _clamp(ew / ee)
    apart = minus(towards(p, q, along), towards(r, s, across))
    return math.sqrt(dot(apart, apart))
