# SPDX-License-Identifier: Apache-2.0
"""Tensions away from their limits: analytic centre and p-norm, by Newton steps in z.

t = t0 + N z with one or two columns N. Both objectives are convex and smooth in z:
analytic centre, minimise -sum_i log(t_i - low_i) + log(high_i - t_i) (Boyd and Vandenberghe 2004,
8.5.3); p-norm, minimise sum_i |d_i|^p within the limits, d_i the deviation of t_i from the middle
of its limits over half their distance (after Gosselin and Grenier 2011, who take p = 4): p = 2 is
the point nearest to the middle, a large p keeps the worst cable away from its limits. Where the
p-norm's minimum lies on the polygon's boundary, it is the one point of an edge, or the one
corner, from which the objective falls outwards only: gradients at the corners tell which edge,
and one root on it is left to find.
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray

from .static_size import compiled
from .work_array import SCALE, at_basis, at_limits

STEPS = 60
"""Newton steps at most; five to fifteen are needed."""
DERIVATIVES = 5
"""Gradient (2) and Hessian (xx, xy, yy)."""
_CLOSE = 1e-10
"""Square of the Newton decrement after which one more step reaches rounding."""
_HALVINGS = 30
NARROW = 1e-9
"""Times the largest limit: limits closer than this leave nothing to choose."""
PINNED = 1e-4
"""A tension that changes by less than this part of the segment's length is the same all along."""


@compiled
def move(work: FloatArray, n: int, nullity: int, x: float, y: float, tension: FloatArray) -> None:
    """Add N (x, y) to the tensions.

    Args:
        work: work array of a pose that is ready.
        n: number of cables.
        nullity: n minus rank, 1 or 2.
        x: along the null space's first row [N].
        y: along its second [N]; not looked at if there is one only.
        tension: (n,) [N], updated.
    """
    rows = at_basis(n) + (n - nullity) * n
    for i in range(n):
        tension[i] += work[rows + i] * x
        if nullity == 2:
            tension[i] += work[rows + n + i] * y


@compiled
def _add_terms(
    work: FloatArray,
    n: int,
    nullity: int,
    i: int,
    slope: float,
    curve: float,
    derivatives: FloatArray,
) -> None:
    """Add one cable's first and second derivative over its tension."""
    rows = at_basis(n) + (n - nullity) * n
    ax = work[rows + i]
    ay = work[rows + n + i] if nullity == 2 else 0.0
    derivatives[0] += slope * ax
    derivatives[1] += slope * ay
    derivatives[2] += curve * ax * ax
    derivatives[3] += curve * ax * ay
    derivatives[4] += curve * ay * ay


@compiled
def _newton_step(nullity: int, derivatives: FloatArray) -> tuple[float, float, float]:
    """Newton step and the square of its decrement; zeros where the Hessian is singular."""
    g, h = derivatives[0], derivatives[1]
    a, b, c = derivatives[2], derivatives[3], derivatives[4]
    if nullity == 1:
        if not a > 0.0:
            return 0.0, 0.0, 0.0
        return -g / a, 0.0, g * g / a
    determinant = a * c - b * b
    if not determinant > 1e-15 * a * c:
        return 0.0, 0.0, 0.0
    x, y = (b * h - c * g) / determinant, (b * g - a * h) / determinant
    return x, y, -(g * x + h * y)


@compiled
def _log_terms(
    work: FloatArray, n: int, nullity: int, tension: FloatArray, derivatives: FloatArray
) -> bool:
    """Fill the barrier's derivatives; False if a tension is on its limit."""
    low = at_limits(n)
    derivatives[:] = 0.0
    for i in range(n):
        below, above = tension[i] - work[low + i], work[low + n + i] - tension[i]
        if not (below > 0.0 and above > 0.0):
            return False
        below, above = 1.0 / below, 1.0 / above
        _add_terms(work, n, nullity, i, above - below, above * above + below * below, derivatives)
    return True


@compiled
def analytic_centre(
    work: FloatArray, n: int, nullity: int, tension: FloatArray, derivatives: FloatArray
) -> int:
    """Go from tensions strictly inside the limits to the analytic centre.

    A step is damped by 1 / (1 + decrement) until the decrement is below a quarter: so it stays
    inside and the self-concordant barrier falls (Nesterov and Nemirovskii 1994).

    Args:
        work: work array of a pose that is ready.
        n: number of cables.
        nullity: n minus rank, 1 or 2.
        tension: (n,) start, then the centre [N].
        derivatives: (DERIVATIVES,) scratch.

    Returns:
        Steps taken.
    """
    for step in range(STEPS):
        if not _log_terms(work, n, nullity, tension, derivatives):
            return step
        x, y, square = _newton_step(nullity, derivatives)
        share = 1.0 if square < 0.0625 else 1.0 / (1.0 + math.sqrt(square))
        move(work, n, nullity, share * x, share * y, tension)
        if not square > _CLOSE:
            return step + 1
    return STEPS


@compiled
def analytic_on_segment(
    work: FloatArray,
    n: int,
    start: tuple[float, float],
    end: tuple[float, float],
    tension: FloatArray,
) -> int:
    """Move the tensions to the analytic centre of a segment in z; steps taken.

    Only cables whose tension changes along the segment count: the others, pinned where the
    feasible tensions shrink to the segment, are the same all along it. So this is where the
    centre of a polygon goes as it grows flat.

    Args:
        work: work array of a pose that is ready.
        n: number of cables, rank + 2.
        start: z of one end [N].
        end: z of the other [N].
        tension: (n,) at z = 0, then at the centre [N].
    """
    dx, dy = end[0] - start[0], end[1] - start[1]
    pinned = PINNED * math.sqrt(dx * dx + dy * dy)
    low, nx = at_limits(n), at_basis(n) + (n - 2) * n
    move(work, n, 2, 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]), tension)
    for step in range(STEPS):
        first, second = 0.0, 0.0
        for i in range(n):
            slope = work[nx + i] * dx + work[nx + n + i] * dy
            if abs(slope) < pinned:
                continue
            below = slope / max(tension[i] - work[low + i], 1e-300)
            above = slope / max(work[low + n + i] - tension[i], 1e-300)
            first += above - below
            second += above * above + below * below
        if not second > 0.0:
            return step
        square = first * first / second
        share = 1.0 if square < 0.0625 else 1.0 / (1.0 + math.sqrt(square))
        change = -share * first / second
        move(work, n, 2, change * dx, change * dy, tension)
        if not square > _CLOSE:
            return step + 1
    return STEPS


@compiled
def power_terms(
    work: FloatArray,
    n: int,
    nullity: int,
    tension: FloatArray,
    x: float,
    y: float,
    exponent: float,
    derivatives: FloatArray,
) -> None:
    """Fill the derivatives of sum |d_i|^p t_max^2 / p at tension + N (x, y).

    d_i is cable i's deviation from the middle of its limits over half their distance. A cable
    whose limits nearly meet has nothing to choose and is left out.

    Args:
        work: work array of a pose that is ready.
        n: number of cables.
        nullity: n minus rank, 1 or 2.
        tension: (n,) at z = 0 [N].
        x: first component of z [N].
        y: second, if there are two [N].
        exponent: p, at least 2.
        derivatives: (DERIVATIVES,) filled: gradient [N], Hessian [-].
    """
    rows, low, scale = at_basis(n) + (n - nullity) * n, at_limits(n), work[SCALE]
    derivatives[:] = 0.0
    for i in range(n):
        value = tension[i] + work[rows + i] * x
        if nullity == 2:
            value += work[rows + n + i] * y
        half = 0.5 * (work[low + n + i] - work[low + i])
        if not half > NARROW * scale:
            continue
        stretch = scale / half
        deviation = (value - work[low + i]) / half - 1.0
        power = deviation * deviation
        if exponent != 4.0:
            power = abs(deviation) ** (exponent - 2.0)
        slope, curve = power * deviation * scale * stretch, power * stretch * stretch
        _add_terms(work, n, nullity, i, slope, (exponent - 1.0) * curve, derivatives)


@compiled
def least_on_segment(
    work: FloatArray,
    n: int,
    nullity: int,
    tension: FloatArray,
    start: tuple[float, float],
    end: tuple[float, float],
    exponent: float,
    derivatives: FloatArray,
) -> tuple[float, float]:
    """Point of a segment in z with the least p-norm; leaves the derivatives there.

    Newton steps on the slope, which rises along the segment; bisection where one leaves the
    bracket. At most STEPS. The arguments are those of `power_terms`, but for the two ends.

    Args:
        work: work array of a pose that is ready.
        n: number of cables.
        nullity: n minus rank, 1 or 2.
        tension: (n,) at z = 0 [N].
        start: z of one end [N].
        end: z of the other [N].
        exponent: p, at least 2.
        derivatives: (DERIVATIVES,) filled.
    """
    dx, dy = end[0] - start[0], end[1] - start[1]
    lower, upper, s = 0.0, 1.0, 0.5
    for _ in range(STEPS):
        power_terms(
            work, n, nullity, tension, start[0] + s * dx, start[1] + s * dy, exponent, derivatives
        )
        slope = derivatives[0] * dx + derivatives[1] * dy
        curve = derivatives[2] * dx * dx + 2.0 * derivatives[3] * dx * dy + derivatives[4] * dy * dy
        if slope > 0.0:
            upper = s
        else:
            lower = s
        following = s - slope / curve if curve > 0.0 else 0.5 * (lower + upper)
        if not lower <= following <= upper:
            following = 0.5 * (lower + upper)
        change = abs(following - s)
        s = following
        if change < 1e-15:
            break
    return start[0] + s * dx, start[1] + s * dy


@compiled
def least_on_boundary(
    work: FloatArray,
    n: int,
    tension: FloatArray,
    points: FloatArray,
    count: int,
    exponent: float,
    gradients: FloatArray,
    derivatives: FloatArray,
) -> tuple[bool, float, float]:
    """Where on the polygon's boundary the p-norm is least, if it is least there.

    Args:
        work: work array of a pose that is ready.
        n: number of cables, rank + 2.
        tension: (n,) at z = 0 [N].
        points: corners, counter-clockwise.
        count: how many, at least 3.
        exponent: p, at least 2.
        gradients: (2 count,) scratch.
        derivatives: (DERIVATIVES,) scratch.

    Returns:
        Whether the minimum lies on the boundary, and the point; else it lies inside.
    """
    for k in range(count):
        x, y = points[2 * k], points[2 * k + 1]
        power_terms(work, n, 2, tension, x, y, exponent, derivatives)
        gradients[2 * k], gradients[2 * k + 1] = derivatives[0], derivatives[1]
    for k in range(count):
        following, before = (k + 1) % count, (k - 1) % count
        x, y = points[2 * k], points[2 * k + 1]
        dx, dy = points[2 * following] - x, points[2 * following + 1] - y
        ex, ey = x - points[2 * before], y - points[2 * before + 1]
        g, h = gradients[2 * k], gradients[2 * k + 1]
        ahead = g * dx + h * dy
        # A corner from which every way into the polygon leads upwards.
        if ahead >= 0.0 and g * ex + h * ey <= 0.0:
            return True, x, y
        if ahead < 0.0 and gradients[2 * following] * dx + gradients[2 * following + 1] * dy > 0.0:
            end = (points[2 * following], points[2 * following + 1])
            found = least_on_segment(work, n, 2, tension, (x, y), end, exponent, derivatives)
            # Outwards of a counter-clockwise edge is (dy, -dx): there the norm must fall.
            if derivatives[0] * dy - derivatives[1] * dx <= 0.0:
                return True, found[0], found[1]
    return False, 0.0, 0.0


@compiled
def least_inside(
    work: FloatArray,
    n: int,
    nullity: int,
    tension: FloatArray,
    start: tuple[float, float],
    exponent: float,
    derivatives: FloatArray,
) -> tuple[float, float]:
    """Point z of the least p-norm, limits ignored, by damped Newton steps.

    Args:
        work: work array of a pose that is ready.
        n: number of cables.
        nullity: n minus rank, 1 or 2.
        tension: (n,) at z = 0 [N].
        start: z to begin from [N].
        exponent: p, at least 2.
        derivatives: (DERIVATIVES,) scratch.
    """
    zx, zy = start
    power_terms(work, n, nullity, tension, zx, zy, exponent, derivatives)
    for _ in range(STEPS):
        x, y, square = _newton_step(nullity, derivatives)
        before, share = derivatives[0] * x + derivatives[1] * y, 1.0
        for _ in range(_HALVINGS):
            power_terms(
                work, n, nullity, tension, zx + share * x, zy + share * y, exponent, derivatives
            )
            # The slope rises along the step: steep at its end, the step went far too far.
            if derivatives[0] * x + derivatives[1] * y <= -0.9 * before:
                break
            share *= 0.5
        zx, zy = zx + share * x, zy + share * y
        if not square > 1e-24 * work[SCALE] * work[SCALE]:
            break
    return zx, zy


@compiled
def holds(work: FloatArray, n: int, nullity: int, tension: FloatArray, x: float, y: float) -> bool:
    """Whether tension + N (x, y) keeps the limits.

    Args:
        work: work array of a pose that is ready.
        n: number of cables.
        nullity: n minus rank, 1 or 2.
        tension: (n,) at z = 0 [N].
        x: first component of z [N].
        y: second, if there are two [N].
    """
    rows, low, inside = at_basis(n) + (n - nullity) * n, at_limits(n), True
    for i in range(n):
        value = tension[i] + work[rows + i] * x
        if nullity == 2:
            value += work[rows + n + i] * y
        inside = inside and work[low + i] <= value <= work[low + n + i]
    return inside
