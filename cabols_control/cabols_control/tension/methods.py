"""Which of the feasible tensions: minimum norm, p-norm, barycentre or analytic centre.

All start from the minimum norm, which also decides feasibility. A wrench that is not feasible gets
tensions of its nearest feasible wrench: where several give that, the method chooses among them,
so that tensions stay continuous across the boundary. With one degree of redundancy the feasible
tensions are an interval, with two a polygon; without any there is nothing to choose. The others
than the minimum norm are made for these: for more, `set_method` refuses.

The method stands in the work array, so that compiled loops take it without another argument. A
share below 1 stays so much nearer the minimum norm: every mixture of two feasible tensions is
feasible, so that a controller can fade from one to the other.
"""

from __future__ import annotations

import math

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
from .kernels.dispatch import clip_and_subtract, solve_packed
from .kernels.polygon import centroid, feasible_polygon, flat_ends, max_corners
from .kernels.static_size import EIGHT, compiled
from .kernels.work_array import (
    CABLES,
    EXPONENT,
    ITERATIONS,
    METHOD,
    READY,
    SCALE,
    SHARE,
    STATE,
    at_basis,
    at_limits,
    at_scratch,
)
from .solution import FEASIBLE, INVALID, FloatArray

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
MAX_REDUNDANCY = 2
SLENDER = 1e-6
"""Twice the area over the square of its length below which a polygon's centre is sought on the
segment between its ends: the Hessian across is then a trillion times that along."""
_ROUNDING, _NEAREST_ROUNDING = 2e-13, 1e-11
"""Times the largest limit: how inexact the tensions may be that feasible wrenches start from, and
those of nearest wrenches."""


def check_method(cables: int, method: str, exponent: float = DEFAULT_EXPONENT) -> None:
    """Refuse a method that `choose_packed` cannot give.

    Raises:
        CabolsError: if the method is unknown or made for fewer cables, or the exponent out of
            range.
    """
    if method not in CHOICES:
        raise CabolsError(f"method: expected one of {', '.join(CHOICES)}, got {method!r}")
    if method != "min_norm" and cables > 6 + MAX_REDUNDANCY:
        raise CabolsError(
            f'method: expected "min_norm" for {cables} cables, got "{method}", which is made for '
            f"{MAX_REDUNDANCY} degrees of redundancy at most"
        )
    if not EXPONENTS[0] <= exponent <= EXPONENTS[1]:
        raise CabolsError(
            f"exponent: expected {EXPONENTS[0]:g} to {EXPONENTS[1]:g}, got {exponent!r}"
        )


def set_method(
    pack: FloatArray,
    cables: int,
    method: str,
    exponent: float = DEFAULT_EXPONENT,
    share: float = 1.0,
) -> None:
    """Write the method into a work array; `pack_pose` leaves it there.

    Args:
        pack: (pack_size(cables),) work array.
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
    pack[METHOD], pack[EXPONENT], pack[SHARE] = CHOICES[method], exponent, share


@compiled
def _interval(pack: FloatArray, n: int, tension: FloatArray) -> tuple[float, float]:
    """Range of z that keeps the limits with one degree of redundancy; it holds 0."""
    low, row = at_limits(n), at_basis(n) + (n - 1) * n
    start, end = -math.inf, math.inf
    for i in range(n):
        slope = pack[row + i]
        if abs(slope) < 1e-13:
            continue
        first = (pack[low + i] - tension[i]) / slope
        second = (pack[low + n + i] - tension[i]) / slope
        start, end = max(start, min(first, second)), min(end, max(first, second))
    return min(start, 0.0), max(end, 0.0)


@compiled
def _choose_on_line(pack: FloatArray, n: int, method: int, tension: FloatArray) -> int:
    """One degree of redundancy: from the least norm to the method's tensions; steps taken."""
    derivatives = pack[at_scratch(n) : at_scratch(n) + DERIVATIVES]
    start, end = _interval(pack, n, tension)
    if method == P_NORM:
        s, _ = least_on_segment(
            pack, n, 1, tension, (start, 0.0), (end, 0.0), pack[EXPONENT], derivatives
        )
        move(pack, n, 1, s, 0.0, tension)
        return 1
    move(pack, n, 1, 0.5 * (start + end), 0.0, tension)
    if method == ANALYTIC_CENTRE:
        return analytic_centre(pack, n, 1, tension, derivatives)
    return 0


@compiled
def _choose_in_plane(
    pack: FloatArray, n: int, method: int, tolerance: float, tension: FloatArray
) -> int:
    """Two degrees of redundancy: from the least norm to the method's tensions; steps taken."""
    size, start = 2 * max_corners(n), at_scratch(n)
    points, other = pack[start : start + size], pack[start + size : start + 2 * size]
    derivatives = pack[start + 2 * size : start + 2 * size + DERIVATIVES]
    count = feasible_polygon(pack, n, tension, tolerance, points, other)
    if count < 1:
        return 0
    x, y, area = centroid(pack, points, count)
    if method == P_NORM:
        if area == 0.0:
            ax, ay, bx, by = flat_ends(points, count)
            px, py = least_on_segment(
                pack, n, 2, tension, (ax, ay), (bx, by), pack[EXPONENT], derivatives
            )
            move(pack, n, 2, px, py, tension)
            return 1
        px, py = least_inside(pack, n, 2, tension, (x, y), pack[EXPONENT], derivatives)
        if not holds(pack, n, 2, tension, px, py):
            found, ex, ey = least_on_boundary(
                pack, n, tension, points, count, pack[EXPONENT], other, derivatives
            )
            # Not found: the minimum is inside after all, on a limit by rounding.
            px, py = (ex, ey) if found else (px, py)
        move(pack, n, 2, px, py, tension)
        return 1
    if method == ANALYTIC_CENTRE:
        ax, ay, bx, by = flat_ends(points, count)
        if area <= SLENDER * ((bx - ax) ** 2 + (by - ay) ** 2):
            return analytic_on_segment(pack, n, (ax, ay), (bx, by), tension)
    move(pack, n, 2, x, y, tension)
    if method == ANALYTIC_CENTRE:
        return analytic_centre(pack, n, 2, tension, derivatives)
    return 0


@compiled
def _keep_if_outside(pack: FloatArray, n: int, saved: int, tension: FloatArray) -> None:
    """Go back to the least norm if rounding has left the limits: clipping would cost the wrench.

    Written so that NaN goes back, too.
    """
    low, allowed = at_limits(n), 2.0 * _NEAREST_ROUNDING * pack[SCALE]
    inside = True
    for i in range(n):
        above = tension[i] - pack[low + i] >= -allowed
        inside = inside and above and tension[i] - pack[low + n + i] <= allowed
    if not inside:
        for i in range(n):
            tension[i] = pack[saved + i]


@compiled
def choose_packed(
    pack: FloatArray, wrench: FloatArray, tension_out: FloatArray, residual_out: FloatArray
) -> int:
    """Tensions for one wrench by the method in `pack`; arguments and result as `solve_packed`.

    Without allocation; what it does beyond `solve_packed` is bounded by 2 n clips of a polygon
    and 60 Newton steps.
    """
    status = solve_packed(pack, wrench, tension_out, residual_out)
    n, method = int(pack[CABLES]), int(pack[METHOD])
    nullity = n - 6
    if method == MIN_NORM or status == INVALID or pack[STATE] != READY or pack[SHARE] == 0.0:
        return status
    if nullity < 1 or nullity > MAX_REDUNDANCY:
        return status
    # Behind the polygon's two lists and the derivatives.
    saved = at_scratch(n) + 4 * max_corners(n) + DERIVATIVES
    for i in range(n):
        pack[saved + i] = tension_out[i]
    if nullity == 1:
        pack[ITERATIONS] += _choose_on_line(pack, n, method, tension_out)
    else:
        inexact = _ROUNDING if status == FEASIBLE else _NEAREST_ROUNDING
        tolerance = inexact * pack[SCALE]
        pack[ITERATIONS] += _choose_in_plane(pack, n, method, tolerance, tension_out)
    _keep_if_outside(pack, n, saved, tension_out)
    share = pack[SHARE]
    if share < 1.0:
        for i in range(n):
            tension_out[i] = pack[saved + i] + share * (tension_out[i] - pack[saved + i])
    if n == 8:
        clip_and_subtract(pack, EIGHT, wrench, tension_out, residual_out)
    else:
        clip_and_subtract(pack, n, wrench, tension_out, residual_out)
    return status
