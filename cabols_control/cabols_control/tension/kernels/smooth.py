# SPDX-License-Identifier: Apache-2.0
"""Tensions that change little with pose, wrench and limits, near the boundary and beyond it.

The least-norm tensions of a wrench on the boundary of the feasible set, and of the nearest wrench
beyond it, are not continuous in the pose: where several cables pull in nearly one hyperplane a
boundary wrench has a whole line of tensions, and a pose 1 um away has one end of it. So the wrench
is given up by a little where keeping it costs much tension. With B = diag(weights) A and
v = diag(weights) w,

    minimise |t|^2 / 2 + rho |B t - v|  inside the limits,  rho = SLOPE times the largest limit.

The penalty is exact: the least-norm tensions whose multiplier |lambda| is at most rho (tension
times change of tension per change of wrench) are the answer as they are, and only steeper ones
are replaced. The objective is strongly convex in t, so for data that change by dB and dv

    |dt| <= rho |dB| + sqrt(2 rho |dB t - dv|)                        (always, feasible or not)

and Lipschitz while the limits that are active stay the same. What is given up, in the weighted
metric, is at most |t|^2 / (2 rho) of the nearest wrench; `LOSS` in the work array says it.

The dual is a problem in six variables: t = clip(B^T lambda), |lambda| <= rho. Newton's method on
B clip(B^T lambda) + e lambda = v and |lambda| = rho, e |lambda| = |B t - v|: exact as soon as the
active limits are right. What it does not settle in JOINT_STEPS is left to a slower method that
cannot fail: Newton with a line search for fixed e, e in a bracket.

Source: exact penalties, Bertsekas, Nonlinear Programming, 4.3; semismooth Newton methods, Qi and
Sun 1993; the secular equation, Conn, Gould and Toint, Trust-Region Methods, 7.3.
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray

from .basis import SLOPE
from .static_size import Size, cables, compiled
from .work_array import (
    ITERATIONS,
    LOSS,
    SCALE,
    Six,
    at_factor,
    at_limits,
    at_scaled,
    at_vector,
)

JOINT_STEPS = 12
OUTER_STEPS, INNER_STEPS, MOST_STEPS = 25, 60, 360
"""Of the slower method; no further outer step begins after MOST_STEPS inner ones in all."""
SETTLED = 1e-12
"""Times the largest wrench, or what the largest limit can give: equations missed by less are
solved."""
_WORSE = 1e-9
"""Share by which the penalty may grow before the tensions that were there are kept."""
AT_LIMIT = 1e-9
"""Times the largest limit: a tension this near to a limit counts as on it."""
_LEAST_PIVOT = 1e-15
_LAMBDA, _MISS, _PULL, _STEP, _TURN, _TRY, _START = 0, 1, 2, 3, 4, 5, 8  # scratch vectors


@compiled
def _misses(
    work: FloatArray, size: Size, target: Six, at: int, e: float, tension: FloatArray
) -> float:
    """Fill _PULL with B^T lambda, lambda at `at`, tension with its clip, _MISS; largest miss."""
    n = cables(size)
    scaled, limits, pull, miss = (
        at_scaled(n),
        at_limits(n),
        at_vector(n, _PULL),
        at_vector(n, _MISS),
    )
    for i in range(n):
        value = 0.0
        for k in range(6):
            value += work[scaled + k * n + i] * work[at + k]
        work[pull + i] = value
        tension[i] = min(max(value, work[limits + i]), work[limits + n + i])
    largest = 0.0
    for k in range(6):
        value = e * work[at + k] - target[k]
        for i in range(n):
            value += work[scaled + k * n + i] * tension[i]
        work[miss + k] = value
        largest = max(largest, abs(value))
    return largest


@compiled
def _factor(work: FloatArray, size: Size, e: float, axis: float) -> None:
    """L D L^T of B_free B_free^T + e I + axis u u^T, u the direction of lambda; 1 / D on it."""
    n = cables(size)
    scaled, limits, pull = at_scaled(n), at_limits(n), at_vector(n, _PULL)
    h, at = at_factor(n), at_vector(n, _LAMBDA)
    square = 0.0
    for k in range(6):
        square += work[at + k] * work[at + k]
    share = axis / square if square > 0.0 else 0.0
    for a in range(6):
        for b in range(a + 1):
            value = share * work[at + a] * work[at + b]
            for i in range(n):
                inside = work[limits + i] < work[pull + i] < work[limits + n + i]
                part = work[scaled + a * n + i] * work[scaled + b * n + i]
                value += part if inside else 0.0
            work[h + 6 * a + b] = value + (e if a == b else 0.0)
    for a in range(6):
        for b in range(a):
            value = work[h + 6 * a + b]
            for c in range(b):
                value -= work[h + 6 * a + c] * work[h + 6 * b + c]
            work[h + 6 * a + b] = value * work[h + 7 * b]
        whole = work[h + 7 * a]
        pivot = whole
        for c in range(a):
            pivot -= work[h + 6 * a + c] * work[h + 6 * a + c]
        work[h + 7 * a] = 1.0 / math.sqrt(max(pivot, _LEAST_PIVOT * max(whole, 1.0)))


@compiled
def _substitute(work: FloatArray, size: Size, source: int, goal: int) -> None:
    """Solve with the factor: right side at `source`, answer at `goal`."""
    h = at_factor(cables(size))
    for a in range(6):
        value = work[source + a]
        for b in range(a):
            value -= work[h + 6 * a + b] * work[goal + b]
        work[goal + a] = value * work[h + 7 * a]
    for a in range(5, -1, -1):
        value = work[goal + a]
        for b in range(a + 1, 6):
            value -= work[h + 6 * b + a] * work[goal + b]
        work[goal + a] = value * work[h + 7 * a]


@compiled
def _dot(work: FloatArray, a: int, b: int) -> float:
    """Product of two vectors of six in the work array."""
    total = 0.0
    for k in range(6):
        total += work[a + k] * work[b + k]
    return total


@compiled
def _joint(
    work: FloatArray, size: Size, target: Six, rho: float, settled: float, e: float, t: FloatArray
) -> bool:
    """Newton on both equations at once, from the lambda at _LAMBDA and e; whether it settled."""
    n = cables(size)
    at, miss = at_vector(n, _LAMBDA), at_vector(n, _MISS)
    step, turn = at_vector(n, _STEP), at_vector(n, _TURN)
    for _ in range(JOINT_STEPS):
        largest = _misses(work, size, target, at, e, t)
        square = _dot(work, at, at)
        outside = 0.5 * (square - rho * rho)
        if largest <= settled and abs(outside) <= 1e-11 * rho * rho:
            return True
        _factor(work, size, e, 1.0)
        _substitute(work, size, miss, step)
        _substitute(work, size, at, turn)
        change = (outside - _dot(work, at, step)) / _dot(work, at, turn)
        for k in range(6):
            work[at + k] -= work[step + k] + change * work[turn + k]
        work[ITERATIONS] += 1
        e = max(e + change - outside / square, 0.0)
        if not e < 1e6:
            return False
    return False


@compiled
def _energy(work: FloatArray, size: Size, target: Six, at: int, e: float) -> float:
    """Dual objective for fixed e, whose gradient the misses are."""
    n = cables(size)
    scaled, limits = at_scaled(n), at_limits(n)
    total = 0.5 * e * _dot(work, at, at)
    for k in range(6):
        total -= target[k] * work[at + k]
    for i in range(n):
        value = 0.0
        for k in range(6):
            value += work[scaled + k * n + i] * work[at + k]
        t = min(max(value, work[limits + i]), work[limits + n + i])
        total += t * (value - 0.5 * t)
    return total


@compiled
def _settle(
    work: FloatArray, size: Size, target: Six, settled: float, e: float, t: FloatArray
) -> None:
    """Newton with a line search for fixed e > 0: convex, so it cannot leave."""
    n = cables(size)
    at, trial = at_vector(n, _LAMBDA), at_vector(n, _TRY)
    miss, step = at_vector(n, _MISS), at_vector(n, _STEP)
    for _ in range(INNER_STEPS):
        if _misses(work, size, target, at, e, t) <= settled:
            return
        _factor(work, size, e, 0.0)
        _substitute(work, size, miss, step)
        before, slope, part = _energy(work, size, target, at, e), _dot(work, miss, step), 1.0
        for _ in range(30):
            for k in range(6):
                work[trial + k] = work[at + k] - part * work[step + k]
            after = _energy(work, size, target, trial, e)
            if after <= before - 1e-4 * part * slope + 1e-14 * abs(before):
                break
            part *= 0.5
        for k in range(6):
            work[at + k] = work[trial + k]
        work[ITERATIONS] += 1


@compiled
def _bracketed(
    work: FloatArray, size: Size, target: Six, rho: float, settled: float, e: float, t: FloatArray
) -> bool:
    """Find e by bisection of |lambda(e)| = rho, sped up by the secular equation; False: e is 0."""
    n = cables(size)
    at, turn, low, high = at_vector(n, _LAMBDA), at_vector(n, _TURN), 0.0, math.inf
    if not e > 0.0:
        e = 1e-6
    last = work[ITERATIONS] + MOST_STEPS
    for _ in range(OUTER_STEPS):
        if work[ITERATIONS] > last:
            break
        _settle(work, size, target, settled, e, t)
        length = math.sqrt(_dot(work, at, at))
        if abs(length - rho) <= 1e-9 * rho:
            return True
        if length > rho:
            low = e
        else:
            high = e
        if high < 1e-12:
            return False
        _factor(work, size, e, 0.0)
        _substitute(work, size, at, turn)
        guess = e + (length * length / _dot(work, at, turn)) * (length - rho) / rho
        if not (low < guess < high):
            guess = math.sqrt(max(low, 1e-13) * high) if high < math.inf else 4.0 * e
        e = guess
    return True


@compiled
def steep(work: FloatArray, size: Size, tension: FloatArray) -> bool:
    """Whether least-norm tensions of rank-6 A have a multiplier beyond rho.

    Leaves the multiplier in _LAMBDA, for `soften`; where too few cables are free to tell, True.

    Args:
        work: work array of a prepared pose.
        size: number of cables.
        tension: (n,) the least-norm tensions [N].
    """
    n = cables(size)
    limits, scaled, pull = at_limits(n), at_scaled(n), at_vector(n, _PULL)
    at, miss, rho = at_vector(n, _LAMBDA), at_vector(n, _MISS), SLOPE * work[SCALE]
    near = AT_LIMIT * work[SCALE]
    for k in range(6):
        work[miss + k] = 0.0
        work[at + k] = 0.0
    for i in range(n):
        low, high = work[limits + i], work[limits + n + i]
        free = low + near < tension[i] < high - near
        work[pull + i] = tension[i] if free else low
        for k in range(6):
            work[miss + k] += work[scaled + k * n + i] * tension[i] if free else 0.0
    _factor(work, size, 0.0, 0.0)
    _substitute(work, size, miss, at)
    wrong = 0.0
    for i in range(n):
        value = 0.0
        for k in range(6):
            value += work[scaled + k * n + i] * work[at + k]
        free = work[limits + i] + near < tension[i] < work[limits + n + i] - near
        wrong = max(wrong, abs(value - tension[i]) if free else 0.0)
    return not (_dot(work, at, at) <= rho * rho and wrong <= 1e-6 * work[SCALE])


@compiled
def soften(
    work: FloatArray, size: Size, target: Six, reached: bool, saved: int, tension: FloatArray
) -> None:
    """Replace the least-norm or nearest wrench's tensions by those of the penalty.

    Args:
        work: work array of a prepared pose; after `steep` if the wrench is reached.
        size: number of cables.
        target: the wrench times the weights.
        reached: whether `tension` gives the wrench.
        saved: where in `work` n numbers may be kept.
        tension: (n,), replaced; kept if they are not steep after all.
    """
    n = cables(size)
    at, scaled = at_vector(n, _LAMBDA), at_scaled(n)
    rho = SLOPE * work[SCALE]
    largest = 0.0
    for k in range(6):
        largest = max(largest, abs(target[k]))
    whole = 1.0
    for k in range(6 * n):
        whole = max(whole, abs(work[scaled + k]))
    settled = SETTLED * (work[SCALE] * whole + largest)
    for i in range(n):
        work[saved + i] = tension[i]
    e, missed, start = 0.0, 0.0, at_vector(n, _START)
    if not reached:
        steep(work, size, tension)
        for k in range(6):
            value = target[k]
            for i in range(n):
                value -= work[scaled + k * n + i] * tension[i]
            work[start + k] = value
        missed = math.sqrt(_dot(work, start, start))
        e = missed / rho
        for k in range(6):
            work[at + k] += work[start + k] / e if e > 0.0 else 0.0
    length = math.sqrt(_dot(work, at, at))
    shrink = rho / length if length > 10.0 * rho else 1.0
    for k in range(6):
        work[at + k] *= shrink
        work[start + k] = work[at + k]
    done = _joint(work, size, target, rho, settled, e, tension)
    if not done:
        for k in range(6):
            work[at + k] = work[start + k]
        done = _bracketed(work, size, target, rho, settled, max(e, 1e-6), tension)
    if not done:
        for i in range(n):
            tension[i] = work[saved + i]
        return
    square, before, after = 0.0, 0.0, 0.0
    for k in range(6):
        value = -target[k]
        for i in range(n):
            value += work[scaled + k * n + i] * tension[i]
        square += value * value
    for i in range(n):
        before += 0.5 * work[saved + i] * work[saved + i]
        after += 0.5 * tension[i] * tension[i]
    before, after = before + rho * missed, after + rho * math.sqrt(square)
    # What did not settle is no answer if it is worse; written so that NaN is.
    if not after <= before * (1.0 + _WORSE):
        for i in range(n):
            tension[i] = work[saved + i]
        return
    work[LOSS] = max(math.sqrt(square) - missed, 0.0)
