# SPDX-License-Identifier: Apache-2.0
"""Which of the feasible tensions: minimum norm, p-norm, barycentre or analytic centre.

All start from the minimum norm, which also decides feasibility. A wrench that is not feasible gets
tensions of its nearest feasible wrench: where several give that, the method chooses among them,
so that tensions stay continuous across the boundary. With one degree of redundancy the feasible
tensions are an interval, with two a polygon; without any there is nothing to choose. The others
than the minimum norm are compiled for these: for more, `set_method` refuses, and `distribute` finds
them in milliseconds (many_cables.py).

The method stands in the work array, so that compiled loops take it without another argument. A
share below 1 stays nearer the minimum norm in proportion: every mixture of two feasible tensions is
feasible, so that a controller can fade from one to the other.
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError

from .kernels.centres import (
    DERIVATIVES,
    analytic_centre,
    analytic_on_segment,
    holds,
    least_inside,
    least_on_boundary,
    least_on_segment,
    move,
)
from .kernels.dispatch import solve_prepared
from .kernels.polygon import centroid, feasible_polygon, flat_ends, half_width, max_corners
from .kernels.residual import clip_and_subtract
from .kernels.static_size import EIGHT, compiled
from .kernels.work_array import (
    CABLES,
    EXACT,
    EXPONENT,
    FEASIBLE,
    INVALID,
    ITERATIONS,
    LOSS,
    METHOD,
    READY,
    SCALE,
    SHARE,
    STATE,
    WIDTH,
    at_basis,
    at_limits,
    at_scratch,
)

MIN_NORM, P_NORM, BARYCENTRE, ANALYTIC_CENTRE = 0, 1, 2, 3
CHOICES = {
    "min_norm": MIN_NORM,
    "p_norm": P_NORM,
    "barycentre": BARYCENTRE,
    "analytic_centre": ANALYTIC_CENTRE,
}
"""Methods of the compiled loops by name."""
DEFAULT_EXPONENT = 4.0
EXPONENTS = (2.0, 32.0)
"""Least and largest p: 2 is nearest to the middle of the limits, 32 nearly the largest slack."""
MIN_CABLES = 6
MAX_REDUNDANCY = 2
NARROW = 0.02
"""Times the largest limit: where the polygon's area over half its perimeter is less, the method's
tensions fade into the least norm's, as the corners of a narrow polygon run fast."""
SLENDER = 1e-6
"""Twice the area over the square of its length below which a polygon's centre is sought on the
segment between its ends: the Hessian across is then a trillion times that along."""
_ROUNDING, _NEAREST_ROUNDING = 2e-13, 1e-11
"""Times the largest limit: how inexact the tensions may be that feasible wrenches start from, and
those of nearest wrenches."""


def check_method(cables: int, method: str, exponent: float = DEFAULT_EXPONENT) -> None:
    """Refuse a method that `choose_prepared` cannot give.

    Args:
        cables: number of cables n.
        method: a key of CHOICES.
        exponent: p of the p-norm, within EXPONENTS; checked for every method.

    Raises:
        CabolsError: if the method is unknown or made for fewer cables, or the exponent out of
            range.
    """
    if method not in CHOICES:
        raise CabolsError(f"method: expected one of {', '.join(CHOICES)}, got {method!r}")
    if method != "min_norm" and cables > MIN_CABLES + MAX_REDUNDANCY:
        raise CabolsError(
            f'method: expected "min_norm" for {cables} cables, got "{method}", which the control '
            f"cycle has for {MAX_REDUNDANCY} degrees of redundancy at most; `distribute` takes more"
        )
    if not EXPONENTS[0] <= exponent <= EXPONENTS[1]:
        raise CabolsError(
            f"exponent: expected {EXPONENTS[0]:g} to {EXPONENTS[1]:g}, got {exponent!r}"
        )


def set_method(
    work: FloatArray,
    cables: int,
    method: str,
    exponent: float = DEFAULT_EXPONENT,
    share: float = 1.0,
) -> None:
    """Write the method into a work array; `prepare_pose` leaves it there.

    Args:
        work: (work_size(cables),) work array.
        cables: number n of cables.
        method: key of CHOICES.
        exponent: p of "p_norm", 2 to 32.
        share: 1 for the method's tensions, 0 for the minimum norm's, between for a mixture.

    Raises:
        CabolsError: as `check_method`, or if the share is out of range.
    """
    check_method(cables, method, exponent)
    if not 0.0 <= share <= 1.0:
        raise CabolsError(f"share: expected 0 to 1, got {share!r}")
    work[METHOD], work[EXPONENT], work[SHARE] = CHOICES[method], exponent, share


@compiled
def _interval(work: FloatArray, n: int, tension: FloatArray) -> tuple[float, float]:
    """Range of z that keeps the limits with one degree of redundancy; it holds 0."""
    low, row = at_limits(n), at_basis(n) + (n - 1) * n
    start, end = -math.inf, math.inf
    for i in range(n):
        slope = work[row + i]
        if abs(slope) < 1e-13:
            continue
        first = (work[low + i] - tension[i]) / slope
        second = (work[low + n + i] - tension[i]) / slope
        start, end = max(start, min(first, second)), min(end, max(first, second))
    return min(start, 0.0), max(end, 0.0)


@compiled
def _choose_on_line(work: FloatArray, n: int, method: int, tension: FloatArray) -> int:
    """One degree of redundancy: from the least norm to the method's tensions; steps taken."""
    derivatives = work[at_scratch(n) : at_scratch(n) + DERIVATIVES]
    start, end = _interval(work, n, tension)
    if method == P_NORM:
        s, _ = least_on_segment(
            work, n, 1, tension, (start, 0.0), (end, 0.0), work[EXPONENT], derivatives
        )
        move(work, n, 1, s, 0.0, tension)
        return 1
    move(work, n, 1, 0.5 * (start + end), 0.0, tension)
    if method == ANALYTIC_CENTRE:
        return analytic_centre(work, n, 1, tension, derivatives)
    return 0


@compiled
def _choose_in_plane(
    work: FloatArray, n: int, method: int, tolerance: float, tension: FloatArray
) -> int:
    """Two degrees of redundancy: from the least norm to the method's tensions; steps taken."""
    size, start = 2 * max_corners(n), at_scratch(n)
    points, other = work[start : start + size], work[start + size : start + 2 * size]
    derivatives = work[start + 2 * size : start + 2 * size + DERIVATIVES]
    count = feasible_polygon(work, n, tension, tolerance, points, other)
    if count < 1:
        return 0
    x, y, area = centroid(work, points, count)
    if work[EXACT] != 1.0:
        work[WIDTH] = min(half_width(points, count, area) / (NARROW * work[SCALE]), 1.0)
    if method == P_NORM:
        if area == 0.0:
            ax, ay, bx, by = flat_ends(points, count)
            px, py = least_on_segment(
                work, n, 2, tension, (ax, ay), (bx, by), work[EXPONENT], derivatives
            )
            move(work, n, 2, px, py, tension)
            return 1
        px, py = least_inside(work, n, 2, tension, (x, y), work[EXPONENT], derivatives)
        if not holds(work, n, 2, tension, px, py):
            found, ex, ey = least_on_boundary(
                work, n, tension, points, count, work[EXPONENT], other, derivatives
            )
            # Not found: the minimum is inside after all, on a limit by rounding.
            px, py = (ex, ey) if found else (px, py)
        move(work, n, 2, px, py, tension)
        return 1
    if method == ANALYTIC_CENTRE:
        ax, ay, bx, by = flat_ends(points, count)
        if area <= SLENDER * ((bx - ax) ** 2 + (by - ay) ** 2):
            return analytic_on_segment(work, n, (ax, ay), (bx, by), tension)
    move(work, n, 2, x, y, tension)
    if method == ANALYTIC_CENTRE:
        return analytic_centre(work, n, 2, tension, derivatives)
    return 0


@compiled
def _keep_if_outside(work: FloatArray, n: int, saved: int, tension: FloatArray) -> None:
    """Go back to the least norm if rounding has left the limits: clipping would cost the wrench.

    Written so that NaN goes back, too.
    """
    low, allowed = at_limits(n), 2.0 * _NEAREST_ROUNDING * work[SCALE]
    inside = True
    for i in range(n):
        above = tension[i] - work[low + i] >= -allowed
        inside = inside and above and tension[i] - work[low + n + i] <= allowed
    if not inside:
        for i in range(n):
            tension[i] = work[saved + i]


@compiled
def choose_prepared(
    work: FloatArray, wrench: FloatArray, tension_out: FloatArray, residual_out: FloatArray
) -> int:
    """Tensions for one wrench by the method in `work`.

    Without allocation; what it does beyond `solve_prepared` is bounded by 2 n clips of a polygon
    and 60 Newton steps.

    Args:
        work: (work_size(n),) work array that `set_method` and `prepare_pose` filled; its scratch is
            overwritten.
        wrench: (6,) force [N] then torque [N m] on the platform, base axes.
        tension_out: (n,) filled, inside the limits [N].
        residual_out: (6,) filled: A @ tension_out - wrench [N, N m].

    Returns:
        Status as `solve_prepared`.
    """
    status = solve_prepared(work, wrench, tension_out, residual_out)
    n, method = int(work[CABLES]), int(work[METHOD])
    nullity = n - 6
    if method == MIN_NORM or status == INVALID or work[STATE] != READY or work[SHARE] == 0.0:
        return status
    if nullity < 1 or nullity > MAX_REDUNDANCY:
        return status
    # Behind the polygon's two lists and the derivatives.
    saved = at_scratch(n) + 4 * max_corners(n) + DERIVATIVES
    for i in range(n):
        work[saved + i] = tension_out[i]
    work[WIDTH] = 1.0
    if nullity == 1:
        work[ITERATIONS] += _choose_on_line(work, n, method, tension_out)
    else:
        inexact = _ROUNDING if status == FEASIBLE and work[LOSS] == 0.0 else _NEAREST_ROUNDING
        tolerance = inexact * work[SCALE]
        work[ITERATIONS] += _choose_in_plane(work, n, method, tolerance, tension_out)
    _keep_if_outside(work, n, saved, tension_out)
    share = work[SHARE] * work[WIDTH]
    if share < 1.0:
        for i in range(n):
            tension_out[i] = work[saved + i] + share * (tension_out[i] - work[saved + i])
    if n == 8:
        clip_and_subtract(work, EIGHT, wrench, tension_out, residual_out)
    else:
        clip_and_subtract(work, n, wrench, tension_out, residual_out)
    return status
