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

from cabols_control.tension.solution import FloatArray, Six

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
def _factor(pack: FloatArray, size: Size) -> int:
    """L D L^T of the Gram matrix with the rows and columns of pinned cables taken out.

    Below the diagonal L, above it (L D)^T, on it 1 / D, which is 0 for pinned cables: so all
    loops run over all cables, which costs less than lists of the free ones. Returns the first
    cable that depends on those before it, or -1. n**3 / 6 multiplications.
    """
    n = cables(size)
    gram, factor, side = at_gram(n), at_factor(n), at_vector(n, SIDE)
    for a in range(n):
        whole = pack[gram + a * n + a]
        pivot, free = whole, pack[side + a] == 0.0
        for b in range(a):
            value = pack[gram + a * n + b]
            for c in range(b):
                value -= pack[factor + c * n + a] * pack[factor + b * n + c]
            scaled = value * pack[factor + b * n + b]
            pack[factor + b * n + a] = value
            pack[factor + a * n + b] = scaled
            pivot -= value * scaled
        if free and not pivot > INDEPENDENT * whole:
            return a
        pack[factor + a * n + a] = 1.0 / pivot if free else 0.0
    return -1


@compiled
def _substitute(pack: FloatArray, size: Size) -> None:
    """Solve with the factor, right side and answer in scratch vector _RHS, 0 for the pinned."""
    n = cables(size)
    factor, rhs = at_factor(n), at_vector(n, _RHS)
    for a in range(n):
        value = pack[rhs + a]
        for b in range(a):
            value -= pack[factor + a * n + b] * pack[rhs + b]
        pack[rhs + a] = value
    for a in range(n - 1, -1, -1):
        pivot = pack[factor + a * n + a]
        value = pack[rhs + a] * pivot
        if pivot != 0.0:
            for b in range(a + 1, n):
                value -= pack[factor + b * n + a] * pack[rhs + b]
        pack[rhs + a] = value


@compiled
def _factor_free(pack: FloatArray, size: Size, tension: FloatArray) -> None:
    """Factor for the free cables; dependent ones are pinned to their nearest limit instead."""
    n = cables(size)
    limits = at_limits(n)
    for _ in range(n):
        i = _factor(pack, size)
        if i < 0:
            return
        middle = 0.5 * (pack[limits + i] + pack[limits + n + i])
        pin(pack, size, i, -1.0 if tension[i] < middle else 1.0, tension)


@compiled
def _solve_free(pack: FloatArray, size: Size, tension: FloatArray) -> None:
    """Tensions of the free cables that make their gradient zero, into scratch vector _RHS."""
    n = cables(size)
    gram, linear, side = at_gram(n), at_vector(n, _LINEAR), at_vector(n, SIDE)
    rhs = at_vector(n, _RHS)
    for i in range(n):
        pack[rhs + i] = pack[linear + i]
    for j in range(n):
        held = tension[j] if pack[side + j] != 0.0 else 0.0
        for i in range(n):
            pack[rhs + i] -= pack[gram + j * n + i] * held
    _substitute(pack, size)


@compiled
def _fill_gradient(pack: FloatArray, size: Size, target: Six, tension: FloatArray) -> None:
    """Gradient B^T (B t - v), from the residual: as accurate as the residual is."""
    n = cables(size)
    scaled, gradient = at_scaled(n), at_vector(n, _GRADIENT)
    for i in range(n):
        pack[gradient + i] = 0.0
    for k in range(6):
        miss = -target[k]
        for i in range(n):
            miss += pack[scaled + k * n + i] * tension[i]
        for i in range(n):
            pack[gradient + i] += pack[scaled + k * n + i] * miss


@compiled
def _fill_linear(pack: FloatArray, size: Size, target: Six) -> float:
    """Linear term q = B^T v; returns what counts as a zero gradient."""
    n = cables(size)
    scaled, linear = at_scaled(n), at_vector(n, _LINEAR)
    largest = 0.0
    fill_gram(pack, size)
    for i in range(n):
        value = 0.0
        for k in range(6):
            value += pack[scaled + k * n + i] * target[k]
        pack[linear + i] = value
        largest = max(largest, abs(value))
    zero: float = GRADIENT * (largest + pack[GRAM_MAX] * pack[SCALE])
    return zero


@compiled
def _finish(pack: FloatArray, size: Size, tension: FloatArray, zero: float) -> int:
    """Refine the free tensions, keep the limits; CHOOSE if the least norm is open."""
    n = cables(size)
    limits, side, gradient = at_limits(n), at_vector(n, SIDE), at_vector(n, _GRADIENT)
    rhs, pinned, choice = at_vector(n, _RHS), at_vector(n, PINNED), False
    for i in range(n):
        low, high = pack[limits + i], pack[limits + n + i]
        pack[rhs + i] = -pack[gradient + i]
        if pack[side + i] == 0.0:
            pack[pinned + i] = 1.0 if low == high else 0.0
        elif abs(pack[gradient + i]) > zero or low == high:
            pack[pinned + i] = 1.0
        else:
            pack[pinned + i] = 0.0
            choice = True
    _substitute(pack, size)
    for i in range(n):
        moved = tension[i] + pack[rhs + i]
        tension[i] = min(max(moved, pack[limits + i]), pack[limits + n + i])
    return CHOOSE if choice else NOTHING


@compiled
def exchange_blocks(pack: FloatArray, size: Size, target: Six, tension: FloatArray) -> int:
    """Exchange whole blocks until none is wrong; DESCEND if that does not settle.

    `tension` keeps the limits and agrees with the sides at the start and, if unsettled, at the end.
    """
    n = cables(size)
    limits, side, gradient = at_limits(n), at_vector(n, SIDE), at_vector(n, _GRADIENT)
    rhs, margin = at_vector(n, _RHS), KEEPS * pack[SCALE]
    fewest, patience, zero = n + 1, 3, _fill_linear(pack, size, target)
    for _ in range(PIVOT_CAP):
        _factor_free(pack, size, tension)
        _solve_free(pack, size, tension)
        for i in range(n):
            if pack[side + i] == 0.0:
                tension[i] = pack[rhs + i]
        _fill_gradient(pack, size, target, tension)
        pack[ITERATIONS] += 1
        wrong = 0
        for i in range(n):
            low, high, which = pack[limits + i], pack[limits + n + i], pack[side + i]
            if which == 0.0:
                if not tension[i] >= low - margin:
                    pin(pack, size, i, -1.0, tension)
                    wrong += 1
                elif not tension[i] <= high + margin:
                    pin(pack, size, i, 1.0, tension)
                    wrong += 1
            elif which * pack[gradient + i] > zero and low < high:
                pack[side + i] = 0.0
                wrong += 1
        if wrong == 0:
            return _finish(pack, size, tension, zero)
        patience = 3 if wrong < fewest else patience - 1
        fewest = min(fewest, wrong)
        if patience < 0:
            break
    return DESCEND


@compiled
def _step_inside(pack: FloatArray, size: Size, tension: FloatArray) -> tuple[float, int]:
    """Go towards scratch vector _RHS until the first limit, which is pinned.

    Returns the part of the way gone and the cable that stopped it, -1 if none.
    """
    n = cables(size)
    limits, side, rhs = at_limits(n), at_vector(n, SIDE), at_vector(n, _RHS)
    part, stopper, which, margin = 1.0, -1, 0.0, KEEPS * pack[SCALE]
    for i in range(n):
        if pack[side + i] != 0.0:
            continue
        goal, low, high = pack[rhs + i], pack[limits + i], pack[limits + n + i]
        if goal < low - margin:
            reach = (tension[i] - low) / (tension[i] - goal)
            if reach < part:
                part, stopper, which = max(reach, 0.0), i, -1.0
        elif goal > high + margin:
            reach = (high - tension[i]) / (goal - tension[i])
            if reach < part:
                part, stopper, which = max(reach, 0.0), i, 1.0
    for i in range(n):
        if pack[side + i] == 0.0:
            value = tension[i] + part * (pack[rhs + i] - tension[i])
            tension[i] = min(max(value, pack[limits + i]), pack[limits + n + i])
    if stopper >= 0:
        pin(pack, size, stopper, which, tension)
    return part, stopper


@compiled
def descend(pack: FloatArray, size: Size, target: Six, tension: FloatArray) -> int:
    """Bounded-variable least squares from a point that keeps the limits."""
    n = cables(size)
    limits, side, gradient = at_limits(n), at_vector(n, SIDE), at_vector(n, _GRADIENT)
    banned, fresh, zero = at_vector(n, _BANNED), -1, _fill_linear(pack, size, target)
    for i in range(n):
        pack[banned + i] = 0.0
    for _ in range(STEPS_PER_CABLE * n):
        _factor_free(pack, size, tension)
        _solve_free(pack, size, tension)
        part, stopper = _step_inside(pack, size, tension)
        pack[ITERATIONS] += 1
        # A cable that is freed and cannot move has a zero gradient but for rounding.
        if fresh >= 0 and pack[side + fresh] != 0.0 and (stopper < 0 or part == 0.0):
            pack[banned + fresh] = 1.0
        elif part > 0.0 and stopper >= 0:
            for i in range(n):
                pack[banned + i] = 0.0
        fresh = -1
        if stopper >= 0:
            continue
        _fill_gradient(pack, size, target, tension)
        worst = zero
        for i in range(n):
            wrong = pack[side + i] * pack[gradient + i]
            if (
                wrong > worst
                and pack[banned + i] == 0.0
                and pack[limits + i] < pack[limits + n + i]
            ):
                worst, fresh = wrong, i
        if fresh < 0:
            break
        pack[side + fresh] = 0.0
    return _finish(pack, size, tension, zero)


@compiled
def start_from_limits(pack: FloatArray, size: Size, tension: FloatArray) -> None:
    """Sides from the tensions without limits, or all at the lower limit for a deficient A."""
    n = cables(size)
    limits, side = at_limits(n), at_vector(n, SIDE)
    for i in range(n):
        pack[side + i] = 0.0
        if pack[STATE] != READY or not tension[i] > pack[limits + i]:
            pin(pack, size, i, -1.0, tension)
        elif not tension[i] < pack[limits + n + i]:
            pin(pack, size, i, 1.0, tension)


@compiled
def nearest_from_conflict(pack: FloatArray, size: Size, target: Six, tension: FloatArray) -> int:
    """Tensions of the nearest feasible wrench, from the plane solver's conflict.

    Args:
        pack: work array that `pack_pose` filled, with the conflict in its header.
        size: number of cables, as in sizes.py.
        target: six floats, the wrench times the weights.
        tension: (n,) pseudo-inverse tensions, overwritten by the answer, inside the limits.

    Returns:
        What is left to do: NOTHING, CHOOSE the least norm, or DESCEND.
    """
    n = cables(size)
    limits, pinned = at_limits(n), at_vector(n, PINNED)
    if not project_on_facet(pack, size, target, tension):
        return exchange_blocks(pack, size, target, tension)
    if pack[CONFLICT + 2] >= 0.0:
        return NOTHING
    for i in range(n):
        pack[pinned + i] = 1.0 if pack[limits + i] == pack[limits + n + i] else 0.0
    for k in range(2):
        if pack[CONFLICT + k] >= 0.0:
            pack[pinned + int(pack[CONFLICT + k])] = 1.0
    return CHOOSE
