"""First try for the nearest wrench: project on the hyperplane that a conflict names."""

from __future__ import annotations

from cabols_control.tension.solution import FloatArray, Six

from .plane import PARALLEL, pseudo_inverse_tension
from .static_size import Size, cables, compiled
from .work_array import CONFLICT, CONFLICT_SIDE, SCALE, at_basis, at_inverse, at_limits, at_vector

KEEPS = 1e-13
"""Times the largest limit: free tensions may leave the limits by this before they are clipped."""
SIDE = 2
"""Scratch vector: 0 for free cables, -1 at the lower, +1 at the upper limit."""


@compiled
def pin(pack: FloatArray, size: Size, i: int, side: float, tension: FloatArray) -> None:
    """Put cable i on a limit."""
    n = cables(size)
    limits = at_limits(n)
    pack[at_vector(n, SIDE) + i] = side
    tension[i] = pack[limits + i] if side < 0.0 else pack[limits + n + i]


@compiled
def _combine(
    pack: FloatArray, row: int, ma: float, a: int, mb: float, b: int, mc: float, c: int
) -> float:
    """Combination of three entries of one row."""
    entry: float = ma * pack[row + a] + mb * pack[row + b] + mc * pack[row + c]
    return entry


@compiled
def project_on_facet(pack: FloatArray, size: Size, target: Six, tension: FloatArray) -> bool:
    """Project the wrench on the hyperplane that the conflict names; sides from what results.

    With multipliers m, sum m_i N_i = 0 over the conflict, y = pinv(B)^T m is the normal:
    y . (B t) = m . t for every t. Returns True if the other tensions keep their limits, which
    makes the projection the nearest wrench (up to the least norm on its face).
    """
    n = cables(size)
    limits, inverse = at_limits(n), at_inverse(n)
    nx, ny, side = at_basis(n) + 6 * n, at_basis(n) + 7 * n, at_vector(n, SIDE)
    a, b, c = int(pack[CONFLICT]), int(pack[CONFLICT + 1]), int(pack[CONFLICT + 2])
    b = max(b, 0)
    ax, ay, bx, by = pack[nx + a], pack[ny + a], pack[nx + b], pack[ny + b]
    at_a = pack[limits + a] if pack[CONFLICT_SIDE] < 0.0 else pack[limits + n + a]
    at_b = pack[limits + b] if pack[CONFLICT_SIDE + 1] < 0.0 else pack[limits + n + b]
    if c >= 0:
        cx, cy = pack[nx + c], pack[ny + c]
        at_c = pack[limits + c] if pack[CONFLICT_SIDE + 2] < 0.0 else pack[limits + n + c]
        ma, mb, mc = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
    else:
        c, at_c, mc = a, at_a, 0.0
        ma, mb = bx * bx + by * by, -(ax * bx + ay * by)
    if ma == 0.0:  # a cable whose tension the wrench alone decides
        ma = 1.0
    gap = ma * (tension[a] - at_a) + mb * (tension[b] - at_b) + mc * (tension[c] - at_c)
    y0 = _combine(pack, inverse, ma, a, mb, b, mc, c)
    y1 = _combine(pack, inverse + n, ma, a, mb, b, mc, c)
    y2 = _combine(pack, inverse + 2 * n, ma, a, mb, b, mc, c)
    y3 = _combine(pack, inverse + 3 * n, ma, a, mb, b, mc, c)
    y4 = _combine(pack, inverse + 4 * n, ma, a, mb, b, mc, c)
    y5 = _combine(pack, inverse + 5 * n, ma, a, mb, b, mc, c)
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
    pseudo_inverse_tension(pack, size, facet, tension)
    zx, zy, square = 0.0, 0.0, ax * ax + ay * ay
    if mc != 0.0:
        scale = 1.0 / mc
        ra, rb = (at_a - tension[a]) * scale, (at_b - tension[b]) * scale
        zx, zy = ra * by - rb * ay, rb * ax - ra * bx
    elif square > PARALLEL * PARALLEL:
        reach = (at_a - tension[a]) / square
        zx, zy = reach * ax, reach * ay
    good, margin = True, KEEPS * pack[SCALE]
    for i in range(n):
        value = tension[i] + (pack[nx + i] * zx + pack[ny + i] * zy)
        low, high = pack[limits + i], pack[limits + n + i]
        if value < low - margin:
            pack[side + i], value, good = -1.0, low, False
        elif value > high + margin:
            pack[side + i], value, good = 1.0, high, False
        else:
            pack[side + i] = 0.0
        tension[i] = value
    for k in range(3):
        if pack[CONFLICT + k] >= 0.0:
            pin(pack, size, int(pack[CONFLICT + k]), pack[CONFLICT_SIDE + k], tension)
    return good
