# SPDX-License-Identifier: Apache-2.0
"""Tensions that change little beyond the boundary, in one go: Newton from the conflict's facet.

The problem is smooth.py's, for a wrench that no tension reaches. There the multiplier lies on its
bound, so with e = |B t - v| / rho the answer minimises |B t - v|^2 + e |t|^2 inside the limits:

1. The conflict that proves infeasibility names two or three cables that stand on their limits, and
   how far the wrench is beyond their facet, which e follows from but for a millionth.
2. For the free cables, usually five, (B^T B + e I) t = B^T (v - B t_held). The cable that is most
   wrong is exchanged, held if it left its limits, freed if it is pulled inside them: usually at
   most four times. Exchanging all that are wrong goes round in circles in a tenth of the cases.
3. With the right cables held, Newton's method in t and e with that factor: one to three steps.

The objective is strictly convex: that no cable is on the wrong side proves the answer. Where this
does not settle, the caller goes the long way (nearest.py, smooth.py) to the same answer.

Source: Hintermueller, Ito and Kunisch 2002, primal-dual active sets as a semismooth Newton method.
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray

from .basis import SLOPE, fill_gram
from .facet import SIDE, facet_distance, pin
from .static_size import FIVE, FOUR, SIX, Size, cables, compiled
from .work_array import (
    CONFLICT,
    CONFLICT_SIDE,
    ITERATIONS,
    LOSS,
    SCALE,
    Six,
    at_factor,
    at_gram,
    at_limits,
    at_scaled,
    at_vector,
)

EXCHANGES = 16
"""Largest number that was seen on the reference rig: 9."""
POLISHES = 6
NEAR = 0.02
"""Share of e: nearer to the right one, Newton starts; else the free cables are solved for anew."""
LEAST_SHARE = 1e-7
"""Least e: below it the factor loses too many digits where free cables are dependent."""
KEEPS = 1e-12
"""Times the largest limit: a tension may be beyond a limit by this, or a pull inside it."""
SETTLED = 1e-13
"""Times the largest limit: the last step's largest change of a tension."""
LOSS_SETTLED = 1e-9
"""Times the largest limit: how far the nearest wrench's tensions may be beyond a limit."""
MOST_INVERSE = 1e8
"""Largest inverse pivot of a Gram matrix whose cables are independent."""
DONE, NO_LOSS, UNSETTLED, _AGAIN = 0, 1, 2, 3
_FREE, _RHS, _TURN, _STEP, _MISS, _PULL, _LINEAR = 9, 10, 11, 12, 13, 14, 15  # scratch vectors


@compiled
def start_from_conflict(work: FloatArray, size: Size, tension: FloatArray) -> float:
    """Hold the conflict's cables and free the others; e of its facet.

    Args:
        work: work array with the plane solver's conflict in its header.
        size: number of cables.
        tension: (n,) pseudo-inverse tensions [N]; the held ones are put on their limits.
    """
    n = cables(size)
    distance, side = facet_distance(work, size, tension), at_vector(n, SIDE)
    for i in range(n):
        work[side + i] = 0.0
    for k in range(3):
        if work[CONFLICT + k] >= 0.0:
            pin(work, size, int(work[CONFLICT + k]), work[CONFLICT_SIDE + k], tension)
    e: float = distance / (SLOPE * work[SCALE])
    return e


@compiled
def _list_free(work: FloatArray, size: Size) -> int:
    """Write which cables are free; their number."""
    n = cables(size)
    count, side, free = 0, at_vector(n, SIDE), at_vector(n, _FREE)
    for i in range(n):
        if work[side + i] == 0.0:
            work[free + count] = i
            count += 1
    return count


@compiled
def _factor(work: FloatArray, size: Size, count: Size, e: float) -> None:
    """L D L^T of the free cables' Gram matrix plus e: L below, D L^T above, 1 / D between."""
    n, f = cables(size), cables(count)
    gram, free, h = at_gram(n), at_vector(n, _FREE), at_factor(n)
    for a in range(f):
        row = gram + n * int(work[free + a])
        for b in range(a + 1):
            value = work[row + int(work[free + b])]
            if a == b:
                value += e
            for c in range(b):
                value -= work[h + f * a + c] * work[h + f * c + b]
            if a == b:
                work[h + f * a + a] = 1.0 / value
            else:
                work[h + f * b + a] = value
                work[h + f * a + b] = value * work[h + f * b + b]


@compiled
def _substitute(work: FloatArray, size: Size, count: Size, at: int) -> None:
    """Solve with the factor in place."""
    f, h = cables(count), at_factor(cables(size))
    for a in range(1, f):
        value = work[at + a]
        for b in range(a):
            value -= work[h + f * a + b] * work[at + b]
        work[at + a] = value
    for a in range(f):
        work[at + a] *= work[h + f * a + a]
    for a in range(f - 2, -1, -1):
        value = work[at + a]
        for b in range(a + 1, f):
            value -= work[h + f * b + a] * work[at + b]
        work[at + a] = value


@compiled
def _solve_free(work: FloatArray, size: Size, count: Size, e: float, tension: FloatArray) -> None:
    """Tensions of the free cables for e and the held ones."""
    n, f = cables(size), cables(count)
    gram, linear, rhs = at_gram(n), at_vector(n, _LINEAR), at_vector(n, _RHS)
    free, side, held = at_vector(n, _FREE), at_vector(n, SIDE), at_vector(n, _PULL)
    for i in range(n):
        work[held + i] = tension[i] if work[side + i] != 0.0 else 0.0
    for a in range(f):
        i = int(work[free + a])
        value = work[linear + i]
        for j in range(n):
            value -= work[gram + n * i + j] * work[held + j]
        work[rhs + a] = value
    _factor(work, size, count, e)
    _substitute(work, size, count, rhs)
    for a in range(f):
        tension[int(work[free + a])] = work[rhs + a]


@compiled
def _pull(work: FloatArray, size: Size, target: Six, tension: FloatArray) -> float:
    """Write v - B t and B^T (v - B t); the square of the former's length."""
    n = cables(size)
    scaled, miss, pull = at_scaled(n), at_vector(n, _MISS), at_vector(n, _PULL)
    square = 0.0
    for k in range(6):
        value = target[k]
        for i in range(n):
            value -= work[scaled + k * n + i] * tension[i]
        work[miss + k] = value
        square += value * value
    for i in range(n):
        work[pull + i] = 0.0
    for k in range(6):
        for i in range(n):
            work[pull + i] += work[scaled + k * n + i] * work[miss + k]
    return square


@compiled
def miss_length(work: FloatArray, size: Size, target: Six, tension: FloatArray) -> float:
    """Length of the wrench that is missed, in the weighted metric.

    Args:
        work: work array of a prepared pose.
        size: number of cables.
        target: six floats, the wrench times the weights.
        tension: (n,) [N].
    """
    return math.sqrt(_pull(work, size, target, tension))


@compiled
def _exchange(work: FloatArray, size: Size, e: float, tension: FloatArray) -> bool:
    """Hold the cable that left its limits most, or free the one pulled inside most; if any."""
    n = cables(size)
    limits, side, pull = at_limits(n), at_vector(n, SIDE), at_vector(n, _PULL)
    keeps = KEEPS * work[SCALE]
    worst, cable, which = 0.0, -1, 0.0
    for i in range(n):
        low, high, held = work[limits + i], work[limits + n + i], work[side + i]
        if held == 0.0:
            below, above = low - tension[i], tension[i] - high
            if below > keeps and below > worst:
                worst, cable, which = below, i, -1.0
            if above > keeps and above > worst:
                worst, cable, which = above, i, 1.0
        elif low < high:
            inward = held * (e * (low if held < 0.0 else high) - work[pull + i])
            # Over e it is in the tension's newtons, with ten times the rounding.
            if inward > 10.0 * keeps * e and inward > worst:
                worst, cable, which = inward, i, 0.0
    if cable < 0:
        return False
    if which == 0.0:
        work[side + cable] = 0.0
    else:
        pin(work, size, cable, which, tension)
    return True


@compiled
def _polish(
    work: FloatArray, size: Size, count: Size, target: Six, e: float, tension: FloatArray
) -> float:
    """Newton in the free tensions and e, from a solution for this e; the new e, -1 if unsettled.

    With r = B^T (v - B t) - e t on the free cables and H the factor of _solve_free:
    H dt + de t = r and |v - B t|^2 = rho^2 e^2.
    """
    n, f = cables(size), cables(count)
    free, pull = at_vector(n, _FREE), at_vector(n, _PULL)
    step, turn = at_vector(n, _RHS), at_vector(n, _TURN)
    rho, factored = SLOPE * work[SCALE], e
    settled, softest = SETTLED * work[SCALE], 0.0
    for a in range(f):
        work[turn + a] = tension[int(work[free + a])]
        softest = max(softest, work[at_factor(n) + f * a + a])
    _substitute(work, size, count, turn)
    miss, square = at_vector(n, _MISS), 0.0
    for k in range(6):
        square += work[miss + k] * work[miss + k]
    for _ in range(POLISHES):
        for a in range(f):
            i = int(work[free + a])
            work[step + a] = work[pull + i] - e * tension[i]
        _substitute(work, size, count, step)
        along, across = 0.0, 0.0
        for a in range(f):
            pulled = work[pull + int(work[free + a])]
            along += pulled * work[step + a]
            across += pulled * work[turn + a]
        slope = 2.0 * (rho * rho * e - across)
        if not slope > 0.0:
            return -1.0
        change = (square - rho * rho * e * e - 2.0 * along) / slope
        largest = 0.0
        for a in range(f):
            move = work[step + a] - change * work[turn + a]
            tension[int(work[free + a])] += move
            largest = max(largest, abs(move))
        e += change
        if not e > LEAST_SHARE:
            return -1.0
        square = _pull(work, size, target, tension)
        # The next step: this one times what e, which the factor is not for, changed.
        if largest <= settled or largest * abs(e - factored) * (1.0 / e + softest) <= settled:
            return e
    return -1.0


@compiled
def _loss(work: FloatArray, size: Size, count: Size, tension: FloatArray) -> float:
    """By how much the miss is longer than the nearest wrench's; -1 where others are held there.

    With x = inv(B^T B) B^T (v - B t) over the free cables, t + x are the nearest wrench's tensions,
    if they keep their limits and the held cables still pull outwards.
    """
    n, f = cables(size), cables(count)
    limits, side, pull = at_limits(n), at_vector(n, SIDE), at_vector(n, _PULL)
    free = at_vector(n, _FREE)
    scaled, miss, moved = at_scaled(n), at_vector(n, _MISS), at_vector(n, _LINEAR)
    step, inside, shorter = at_vector(n, _STEP), True, 0.0
    _factor(work, size, count, 0.0)
    for a in range(f):
        i = int(work[free + a])
        # 1 / D beyond this, or below zero, is of dependent cables; NaN is not inside.
        inside = inside and 0.0 < work[at_factor(n) + f * a + a] < MOST_INVERSE
        work[step + a] = work[pull + i]
    _substitute(work, size, count, step)
    keeps = LOSS_SETTLED * work[SCALE]
    for a in range(f):
        i, x = int(work[free + a]), work[step + a]
        shorter += 2.0 * x * work[pull + i]
        reached = tension[i] + x
        inside = inside and work[limits + i] - keeps <= reached <= work[limits + n + i] + keeps
    square, left = 0.0, 0.0
    for k in range(6):
        value = 0.0
        for a in range(f):
            value += work[scaled + k * n + int(work[free + a])] * work[step + a]
        work[moved + k] = value
        shorter -= value * value
        rest = work[miss + k] - value
        left += rest * rest
        square += work[miss + k] * work[miss + k]
    inward = 0.0
    for i in range(n):
        value = work[pull + i]
        for k in range(6):
            value -= work[scaled + k * n + i] * work[moved + k]
        inward += max(-work[side + i] * value, 0.0) * (work[limits + n + i] - work[limits + i])
    # No wrench is nearer than the distance to the plane across `rest`, less what is inward.
    inside = inside and inward <= LOSS_SETTLED * work[SCALE] * math.sqrt(left)
    return shorter / (math.sqrt(square) + math.sqrt(left)) if inside else -1.0


@compiled
def _attempt(
    work: FloatArray, size: Size, count: Size, target: Six, e: float, tension: FloatArray
) -> tuple[int, float]:
    """Solve for the free cables, and if they are the right ones for all that is asked for.

    Returns what came of it, and the e to go on with; where it is _AGAIN, one cable may be exchanged
    and the free tensions are of no use.
    """
    work[ITERATIONS] += 1
    _solve_free(work, size, count, e, tension)
    square = _pull(work, size, target, tension)
    if _exchange(work, size, e, tension):
        return _AGAIN, e
    reached = math.sqrt(square) / (SLOPE * work[SCALE])
    if not abs(reached - e) <= NEAR * e:
        return _AGAIN, reached
    e = _polish(work, size, count, target, e, tension)
    if e < 0.0:
        return UNSETTLED, e
    if _exchange(work, size, e, tension):
        return _AGAIN, e
    loss = _loss(work, size, count, tension)
    work[LOSS] = max(loss, 0.0)
    return (DONE if loss >= 0.0 else NO_LOSS), e


@compiled
def soften_nearest(work: FloatArray, size: Size, target: Six, e: float, tension: FloatArray) -> int:
    """Tensions of the penalty for a wrench that is not feasible, rank 6.

    Args:
        work: work array of a prepared pose, with a side for every cable.
        size: number of cables.
        target: six floats, the wrench times the weights.
        e: a first value of |B t - v| / rho.
        tension: (n,) [N], held cables on their limits; overwritten.

    Returns:
        DONE, NO_LOSS (done, but `LOSS` is not known) or UNSETTLED (`tension` is of no use).
    """
    n = cables(size)
    scaled, linear = at_scaled(n), at_vector(n, _LINEAR)
    fill_gram(work, size)
    for i in range(n):
        work[linear + i] = 0.0
    for k in range(6):
        for i in range(n):
            work[linear + i] += work[scaled + k * n + i] * target[k]
    outcome = _AGAIN
    for _ in range(EXCHANGES):
        if outcome != _AGAIN:
            break
        if not LEAST_SHARE < e < 1e6:
            return UNSETTLED
        count = _list_free(work, size)
        # Loops of constant length for the common cases.
        if count == len(FIVE):
            outcome, e = _attempt(work, size, FIVE, target, e, tension)
        elif count == len(FOUR):
            outcome, e = _attempt(work, size, FOUR, target, e, tension)
        elif count == len(SIX):
            outcome, e = _attempt(work, size, SIX, target, e, tension)
        else:
            outcome, e = _attempt(work, size, count, target, e, tension)
    return UNSETTLED if outcome == _AGAIN else outcome
