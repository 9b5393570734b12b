"""Minimum-norm tensions for any degree of redundancy: the dual method of Goldfarb and Idnani.

In the coordinates z of the null space, minimise |z| subject to the 2 n limits. From z = 0 the
worst violated limit is made active, with multipliers kept non-negative by dropping limits on
the way (Goldfarb and Idnani 1983). The dual objective rises with every limit that is made
active, so no active set comes back: the method ends, usually after a few limits. The cap is a
safety net; at the cap the caller goes on with the nearest wrench, whose answer is safe.
"""

from __future__ import annotations

import math

from cabols_control.tension.solution import FloatArray

from .static_size import compiled
from .work_array import ITERATIONS, SCALE, TOLERANCE, at_factor, at_limits, at_triangle, at_vector

STEPS_PER_CABLE = 20
DEPENDENT = 1e-20
"""A limit's normal that keeps less than this part of its square is dependent on the active."""
_VIOLATION = 4e-16
# Scratch vectors 8 to 14 (nearest.py uses lower ones).
_Z, _ACTIVE, _ACTIVE_SIDE, _MULTIPLIER, _STEP, _DIRECTION, _TAKEN = 8, 9, 10, 11, 12, 13, 14


@compiled
def _value(
    pack: FloatArray, n: int, basis: int, nullity: int, tension: FloatArray, i: int
) -> float:
    """Tension of cable i at the current z."""
    z = at_vector(n, _Z)
    value: float = tension[i]
    for k in range(nullity):
        value += pack[basis + k * n + i] * pack[z + k]
    return value


@compiled
def _worst_limit(
    pack: FloatArray, n: int, basis: int, nullity: int, tension: FloatArray
) -> tuple[float, int, float]:
    """The most violated limit that is not active: violation, cable (-1: none), side."""
    limits, taken = at_limits(n), at_vector(n, _TAKEN)
    worst, cable, side = _VIOLATION * pack[SCALE], -1, 0.0
    for i in range(n):
        if pack[taken + i] != 0.0:
            continue
        value = _value(pack, n, basis, nullity, tension, i)
        low, high = pack[limits + i] - value, value - pack[limits + n + i]
        if low > worst:
            worst, cable, side = low, i, 1.0
        if high > worst:
            worst, cable, side = high, i, -1.0
    return worst, cable, side


@compiled
def _dual_step(
    pack: FloatArray, n: int, basis: int, nullity: int, count: int, cable: int, side: float
) -> tuple[float, float]:
    """Least-squares part of a limit's normal in the active ones, and what is left of it.

    Modified Gram-Schmidt of the active normals (count <= nullity of them) with the triangle
    solved backwards. Returns the squares of what is left and of the whole normal.
    """
    active, sides = at_vector(n, _ACTIVE), at_vector(n, _ACTIVE_SIDE)
    step, direction, rows = at_vector(n, _STEP), at_vector(n, _DIRECTION), at_factor(n)
    whole = 0.0
    for k in range(nullity):
        value = side * pack[basis + k * n + cable]
        pack[direction + k] = value
        whole += value * value
    triangle = at_triangle(n)
    for a in range(count):
        row = rows + a * n
        for k in range(nullity):
            pack[row + k] = pack[sides + a] * pack[basis + k * n + int(pack[active + a])]
        for b in range(a):
            dot = 0.0
            for k in range(nullity):
                dot += pack[row + k] * pack[rows + b * n + k]
            pack[triangle + b * nullity + a] = dot
            for k in range(nullity):
                pack[row + k] -= dot * pack[rows + b * n + k]
        length = 0.0
        for k in range(nullity):
            length += pack[row + k] * pack[row + k]
        length = math.sqrt(length)
        pack[triangle + a * nullity + a] = length
        dot = 0.0
        for k in range(nullity):
            pack[row + k] /= length
            dot += pack[row + k] * pack[direction + k]
        pack[step + a] = dot
        for k in range(nullity):
            pack[direction + k] -= dot * pack[row + k]
    for a in range(count - 1, -1, -1):
        for b in range(a + 1, count):
            pack[step + a] -= pack[triangle + a * nullity + b] * pack[step + b]
        pack[step + a] /= pack[triangle + a * nullity + a]
    left = 0.0
    for k in range(nullity):
        left += pack[direction + k] * pack[direction + k]
    return left, whole


@compiled
def _drop(pack: FloatArray, n: int, count: int, place: int) -> None:
    """Make the active limit at `place` inactive; the others keep their order."""
    active, sides = at_vector(n, _ACTIVE), at_vector(n, _ACTIVE_SIDE)
    multiplier = at_vector(n, _MULTIPLIER)
    pack[at_vector(n, _TAKEN) + int(pack[active + place])] = 0.0
    for a in range(place, count - 1):
        pack[active + a] = pack[active + a + 1]
        pack[sides + a] = pack[sides + a + 1]
        pack[multiplier + a] = pack[multiplier + a + 1]


@compiled
def _activate(
    pack: FloatArray,
    n: int,
    basis: int,
    nullity: int,
    tension: FloatArray,
    count: int,
    cable: int,
    side: float,
) -> int:
    """Make one violated limit active; returns the new count, or -1 if that is impossible.

    At most count + 1 rounds: each drops a limit or ends.
    """
    multiplier, step = at_vector(n, _MULTIPLIER), at_vector(n, _STEP)
    z, direction = at_vector(n, _Z), at_vector(n, _DIRECTION)
    bound = pack[at_limits(n) + cable] if side > 0.0 else pack[at_limits(n) + n + cable]
    own = 0.0
    for _ in range(n + 1):
        left, whole = _dual_step(pack, n, basis, nullity, count, cable, side)
        movable = count < nullity and left > DEPENDENT * whole
        length, place = math.inf, -1
        for a in range(count):
            if pack[step + a] > 0.0 and pack[multiplier + a] < length * pack[step + a]:
                length, place = pack[multiplier + a] / pack[step + a], a
        if movable:
            miss = side * (bound - _value(pack, n, basis, nullity, tension, cable))
            full = max(miss, 0.0) / left
            if full <= length:
                length, place = full, -1
            for k in range(nullity):
                pack[z + k] += length * pack[direction + k]
        elif place < 0:
            return -1
        for a in range(count):
            pack[multiplier + a] -= length * pack[step + a]
        own += length
        if place < 0:
            pack[at_vector(n, _ACTIVE) + count] = cable
            pack[at_vector(n, _ACTIVE_SIDE) + count] = side
            pack[multiplier + count] = own
            pack[at_vector(n, _TAKEN) + cable] = 1.0
            return count + 1
        _drop(pack, n, count, place)
        count -= 1
    return -1


@compiled
def least_norm(pack: FloatArray, n: int, basis: int, nullity: int, tension: FloatArray) -> bool:
    """Any redundancy; `tension` is a point orthogonal to the null space, then the answer.

    `basis` is where `nullity` orthonormal rows of n start in `pack`. Returns True if feasible;
    if not, `tension` is unchanged. At most STEPS_PER_CABLE * n limits are made active.
    """
    z, taken = at_vector(n, _Z), at_vector(n, _TAKEN)
    for i in range(n):
        pack[z + i] = 0.0
        pack[taken + i] = 0.0
    count = 0
    for step in range(STEPS_PER_CABLE * n):
        worst, cable, side = _worst_limit(pack, n, basis, nullity, tension)
        pack[ITERATIONS] = step
        if cable < 0:
            for i in range(n):
                tension[i] = _value(pack, n, basis, nullity, tension, i)
            return True
        grown = _activate(pack, n, basis, nullity, tension, count, cable, side)
        if grown >= 0:
            count = grown
        elif worst <= pack[TOLERANCE]:
            pack[taken + cable] = 2.0
        else:
            return False
    return False
