# SPDX-License-Identifier: Apache-2.0
"""The nearest feasible wrench: min over the limits of |diag(weights) (A t - w)|.

With B = diag(weights) A, v = diag(weights) w, the optimum has a gradient g = B^T (B t - v) that
is 0 for free tensions, >= 0 at lower and <= 0 at upper limits.

1. The plane solver's proof of infeasibility names two or three limits that contradict each
   other: they span a supporting hyperplane of the set of feasible wrenches. Projecting on it
   is a closed form, and if the other tensions keep their limits it is the answer.
2. Else exchanges of whole blocks from there (Kunisch and Rendl 2003), at most PIVOT_CAP: solve
   for the free tensions, pin what leaves the limits, free what has a gradient of wrong sign.
3. Else bounded-variable least squares (Stark and Parker 1995): the objective falls with every
   step and no set of free cables comes back, so it ends; STEPS_PER_CABLE is a safety net. Its
   iterate keeps the limits at all times: what it holds at the cap is safe to use.

One step of refinement removes the squared condition number of the Gram matrix. At last, where
the nearest wrench has several tensions, the least norm among them (faces.py).
"""

from __future__ import annotations

from cabols_control.checks import FloatArray

from .basis import fill_gram
from .faces import PINNED
from .facet import KEEPS, SIDE, pin, project_on_facet
from .static_size import Size, cables, compiled
from .work_array import (
    CONFLICT,
    GRAM_MAX,
    ITERATIONS,
    READY,
    SCALE,
    STATE,
    Six,
    at_factor,
    at_gram,
    at_limits,
    at_scaled,
    at_vector,
)

PIVOT_CAP = 10
"""Block exchanges before bounded-variable least squares takes over."""
STEPS_PER_CABLE = 20
"""Times n: steps of bounded-variable least squares, a safety net."""
INDEPENDENT = 1e-11
"""A column that keeps less than this part of its square after projection counts as dependent."""
GRADIENT = 1e-12
"""A gradient below this, relative to its terms, counts as zero."""

# What is left to do after a step.
NOTHING = 0
CHOOSE = 1
DESCEND = 2

# Scratch vectors.
_GRADIENT, _LINEAR, _RHS, _BANNED = 3, 4, 6, 7


@compiled
def _factor(work: FloatArray, size: Size) -> int:
    """L D L^T of the Gram matrix with the rows and columns of pinned cables taken out.

    Below the diagonal L, above it (L D)^T, on it 1 / D, which is 0 for pinned cables: so all
    loops run over all cables, which costs less than lists of the free ones. Returns the first
    cable that depends on those before it, or -1. n**3 / 6 multiplications.
    """
    n = cables(size)
    gram, factor, side = at_gram(n), at_factor(n), at_vector(n, SIDE)
    for a in range(n):
        whole = work[gram + a * n + a]
        pivot, free = whole, work[side + a] == 0.0
        for b in range(a):
            value = work[gram + a * n + b]
            for c in range(b):
                value -= work[factor + c * n + a] * work[factor + b * n + c]
            scaled = value * work[factor + b * n + b]
            work[factor + b * n + a] = value
            work[factor + a * n + b] = scaled
            pivot -= value * scaled
        if free and not pivot > INDEPENDENT * whole:
            return a
        work[factor + a * n + a] = 1.0 / pivot if free else 0.0
    return -1


@compiled
def _substitute(work: FloatArray, size: Size) -> None:
    """Solve with the factor, right side and answer in scratch vector _RHS, 0 for the pinned."""
    n = cables(size)
    factor, rhs = at_factor(n), at_vector(n, _RHS)
    for a in range(n):
        value = work[rhs + a]
        for b in range(a):
            value -= work[factor + a * n + b] * work[rhs + b]
        work[rhs + a] = value
    for a in range(n - 1, -1, -1):
        pivot = work[factor + a * n + a]
        value = work[rhs + a] * pivot
        if pivot != 0.0:
            for b in range(a + 1, n):
                value -= work[factor + b * n + a] * work[rhs + b]
        work[rhs + a] = value


@compiled
def _factor_free(work: FloatArray, size: Size, tension: FloatArray) -> None:
    """Factor for the free cables; dependent ones are pinned to their nearest limit instead."""
    n = cables(size)
    limits = at_limits(n)
    for _ in range(n):
        i = _factor(work, size)
        if i < 0:
            return
        middle = 0.5 * (work[limits + i] + work[limits + n + i])
        pin(work, size, i, -1.0 if tension[i] < middle else 1.0, tension)


@compiled
def _solve_free(work: FloatArray, size: Size, tension: FloatArray) -> None:
    """Tensions of the free cables that make their gradient zero, into scratch vector _RHS."""
    n = cables(size)
    gram, linear, side = at_gram(n), at_vector(n, _LINEAR), at_vector(n, SIDE)
    rhs = at_vector(n, _RHS)
    for i in range(n):
        work[rhs + i] = work[linear + i]
    for j in range(n):
        held = tension[j] if work[side + j] != 0.0 else 0.0
        for i in range(n):
            work[rhs + i] -= work[gram + j * n + i] * held
    _substitute(work, size)


@compiled
def _fill_gradient(work: FloatArray, size: Size, target: Six, tension: FloatArray) -> None:
    """Gradient B^T (B t - v), from the residual: as accurate as the residual is."""
    n = cables(size)
    scaled, gradient = at_scaled(n), at_vector(n, _GRADIENT)
    for i in range(n):
        work[gradient + i] = 0.0
    for k in range(6):
        miss = -target[k]
        for i in range(n):
            miss += work[scaled + k * n + i] * tension[i]
        for i in range(n):
            work[gradient + i] += work[scaled + k * n + i] * miss


@compiled
def _fill_linear(work: FloatArray, size: Size, target: Six) -> float:
    """Linear term q = B^T v; returns what counts as a zero gradient."""
    n = cables(size)
    scaled, linear = at_scaled(n), at_vector(n, _LINEAR)
    largest = 0.0
    fill_gram(work, size)
    for i in range(n):
        value = 0.0
        for k in range(6):
            value += work[scaled + k * n + i] * target[k]
        work[linear + i] = value
        largest = max(largest, abs(value))
    zero: float = GRADIENT * (largest + work[GRAM_MAX] * work[SCALE])
    return zero


@compiled
def _finish(work: FloatArray, size: Size, tension: FloatArray, zero: float) -> int:
    """Refine the free tensions, keep the limits; CHOOSE if the least norm is open."""
    n = cables(size)
    limits, side, gradient = at_limits(n), at_vector(n, SIDE), at_vector(n, _GRADIENT)
    rhs, pinned, choice = at_vector(n, _RHS), at_vector(n, PINNED), False
    for i in range(n):
        low, high = work[limits + i], work[limits + n + i]
        work[rhs + i] = -work[gradient + i]
        if work[side + i] == 0.0:
            work[pinned + i] = 1.0 if low == high else 0.0
        elif abs(work[gradient + i]) > zero or low == high:
            work[pinned + i] = 1.0
        else:
            work[pinned + i] = 0.0
            choice = True
    _substitute(work, size)
    for i in range(n):
        moved = tension[i] + work[rhs + i]
        tension[i] = min(max(moved, work[limits + i]), work[limits + n + i])
    return CHOOSE if choice else NOTHING


@compiled
def exchange_blocks(work: FloatArray, size: Size, target: Six, tension: FloatArray) -> int:
    """Exchange whole blocks until none is wrong.

    Args:
        work: work array that `prepare_pose` filled, with the sides in its vector SIDE; updated.
        size: number of cables, see static_size.py.
        target: six floats, the wrench times the weights.
        tension: (n,) inside the limits and as the sides say, at the start and at the end [N].

    Returns:
        What is left to do: NOTHING, CHOOSE the least norm, or DESCEND if that did not settle.
    """
    n = cables(size)
    limits, side, gradient = at_limits(n), at_vector(n, SIDE), at_vector(n, _GRADIENT)
    rhs, margin = at_vector(n, _RHS), KEEPS * work[SCALE]
    fewest, patience, zero = n + 1, 3, _fill_linear(work, size, target)
    for _ in range(PIVOT_CAP):
        _factor_free(work, size, tension)
        _solve_free(work, size, tension)
        for i in range(n):
            if work[side + i] == 0.0:
                tension[i] = work[rhs + i]
        _fill_gradient(work, size, target, tension)
        work[ITERATIONS] += 1
        wrong = 0
        for i in range(n):
            low, high, which = work[limits + i], work[limits + n + i], work[side + i]
            if which == 0.0:
                if not tension[i] >= low - margin:
                    pin(work, size, i, -1.0, tension)
                    wrong += 1
                elif not tension[i] <= high + margin:
                    pin(work, size, i, 1.0, tension)
                    wrong += 1
            elif which * work[gradient + i] > zero and low < high:
                work[side + i] = 0.0
                wrong += 1
        if wrong == 0:
            return _finish(work, size, tension, zero)
        patience = 3 if wrong < fewest else patience - 1
        fewest = min(fewest, wrong)
        if patience < 0:
            break
    return DESCEND


@compiled
def _step_inside(work: FloatArray, size: Size, tension: FloatArray) -> tuple[float, int]:
    """Go towards scratch vector _RHS until the first limit, which is pinned.

    Returns the part of the way gone and the cable that stopped it, -1 if none.
    """
    n = cables(size)
    limits, side, rhs = at_limits(n), at_vector(n, SIDE), at_vector(n, _RHS)
    part, stopper, which, margin = 1.0, -1, 0.0, KEEPS * work[SCALE]
    for i in range(n):
        if work[side + i] != 0.0:
            continue
        goal, low, high = work[rhs + i], work[limits + i], work[limits + n + i]
        if goal < low - margin:
            reach = (tension[i] - low) / (tension[i] - goal)
            if reach < part:
                part, stopper, which = max(reach, 0.0), i, -1.0
        elif goal > high + margin:
            reach = (high - tension[i]) / (goal - tension[i])
            if reach < part:
                part, stopper, which = max(reach, 0.0), i, 1.0
    for i in range(n):
        if work[side + i] == 0.0:
            value = tension[i] + part * (work[rhs + i] - tension[i])
            tension[i] = min(max(value, work[limits + i]), work[limits + n + i])
    if stopper >= 0:
        pin(work, size, stopper, which, tension)
    return part, stopper


@compiled
def descend(work: FloatArray, size: Size, target: Six, tension: FloatArray) -> int:
    """Bounded-variable least squares from a point that keeps the limits.

    Args:
        work: work array that `prepare_pose` filled, with the sides in its vector SIDE; updated.
        size: number of cables, see static_size.py.
        target: six floats, the wrench times the weights.
        tension: (n,) inside the limits and as the sides say, then the answer [N].

    Returns:
        What is left to do: NOTHING, or CHOOSE the least norm.
    """
    n = cables(size)
    limits, side, gradient = at_limits(n), at_vector(n, SIDE), at_vector(n, _GRADIENT)
    banned, fresh, zero = at_vector(n, _BANNED), -1, _fill_linear(work, size, target)
    for i in range(n):
        work[banned + i] = 0.0
    for _ in range(STEPS_PER_CABLE * n):
        _factor_free(work, size, tension)
        _solve_free(work, size, tension)
        part, stopper = _step_inside(work, size, tension)
        work[ITERATIONS] += 1
        # A cable that is freed and cannot move has a zero gradient but for rounding.
        if fresh >= 0 and work[side + fresh] != 0.0 and (stopper < 0 or part == 0.0):
            work[banned + fresh] = 1.0
        elif part > 0.0 and stopper >= 0:
            for i in range(n):
                work[banned + i] = 0.0
        fresh = -1
        if stopper >= 0:
            continue
        _fill_gradient(work, size, target, tension)
        worst = zero
        for i in range(n):
            wrong = work[side + i] * work[gradient + i]
            if (
                wrong > worst
                and work[banned + i] == 0.0
                and work[limits + i] < work[limits + n + i]
            ):
                worst, fresh = wrong, i
        if fresh < 0:
            break
        work[side + fresh] = 0.0
    return _finish(work, size, tension, zero)


@compiled
def start_from_limits(work: FloatArray, size: Size, tension: FloatArray) -> None:
    """Sides from the tensions without limits, or all at the lower limit for a deficient A.

    Args:
        work: work array that `prepare_pose` filled; its vector SIDE is written.
        size: number of cables, see static_size.py.
        tension: (n,) pseudo-inverse tensions, then inside the limits [N].
    """
    n = cables(size)
    limits, side = at_limits(n), at_vector(n, SIDE)
    for i in range(n):
        work[side + i] = 0.0
        if work[STATE] != READY or not tension[i] > work[limits + i]:
            pin(work, size, i, -1.0, tension)
        elif not tension[i] < work[limits + n + i]:
            pin(work, size, i, 1.0, tension)


@compiled
def nearest_from_conflict(work: FloatArray, size: Size, target: Six, tension: FloatArray) -> int:
    """Tensions of the nearest feasible wrench, from the plane solver's conflict.

    Args:
        work: work array that `prepare_pose` filled, with the conflict in its header.
        size: number of cables, see static_size.py.
        target: six floats, the wrench times the weights.
        tension: (n,) pseudo-inverse tensions, overwritten by the answer, inside the limits.

    Returns:
        What is left to do: NOTHING, CHOOSE the least norm, or DESCEND.
    """
    n = cables(size)
    limits, pinned = at_limits(n), at_vector(n, PINNED)
    if not project_on_facet(work, size, target, tension):
        return exchange_blocks(work, size, target, tension)
    if work[CONFLICT + 2] >= 0.0:
        return NOTHING
    for i in range(n):
        work[pinned + i] = 1.0 if work[limits + i] == work[limits + n + i] else 0.0
    for k in range(2):
        if work[CONFLICT + k] >= 0.0:
            work[pinned + int(work[CONFLICT + k])] = 1.0
    return CHOOSE
