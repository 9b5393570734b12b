# SPDX-License-Identifier: Apache-2.0
"""Minimum-norm tensions for any degree of redundancy: the dual method of Goldfarb and Idnani.

In the coordinates z of the null space, minimise |z| subject to the 2 n limits. From z = 0 the
worst violated limit is made active, with multipliers kept non-negative by dropping limits on
the way (Goldfarb and Idnani 1983). The dual objective rises with every limit that is made
active, so no active set comes back: the method ends, usually after a few limits. The cap is a
safety net; at the cap the caller goes on with the nearest wrench, whose answer is safe.
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray

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
    work: FloatArray, n: int, basis: int, nullity: int, tension: FloatArray, i: int
) -> float:
    """Tension of cable i at the current z."""
    z = at_vector(n, _Z)
    value: float = tension[i]
    for k in range(nullity):
        value += work[basis + k * n + i] * work[z + k]
    return value


@compiled
def _worst_limit(
    work: FloatArray, n: int, basis: int, nullity: int, tension: FloatArray
) -> tuple[float, int, float]:
    """The most violated limit that is not active: violation, cable (-1: none), side."""
    limits, taken = at_limits(n), at_vector(n, _TAKEN)
    worst, cable, side = _VIOLATION * work[SCALE], -1, 0.0
    for i in range(n):
        if work[taken + i] != 0.0:
            continue
        value = _value(work, n, basis, nullity, tension, i)
        low, high = work[limits + i] - value, value - work[limits + n + i]
        if low > worst:
            worst, cable, side = low, i, 1.0
        if high > worst:
            worst, cable, side = high, i, -1.0
    return worst, cable, side


@compiled
def _dual_step(
    work: FloatArray, n: int, basis: int, nullity: int, count: int, cable: int, side: float
) -> tuple[float, float]:
    """Least-squares part of a limit's normal in the active ones, and what is left of it.

    Modified Gram-Schmidt of the active normals (count <= nullity of them) with the triangle
    solved backwards. Returns the squares of what is left and of the whole normal.
    """
    active, sides = at_vector(n, _ACTIVE), at_vector(n, _ACTIVE_SIDE)
    step, direction, rows = at_vector(n, _STEP), at_vector(n, _DIRECTION), at_factor(n)
    whole = 0.0
    for k in range(nullity):
        value = side * work[basis + k * n + cable]
        work[direction + k] = value
        whole += value * value
    triangle = at_triangle(n)
    for a in range(count):
        row = rows + a * n
        for k in range(nullity):
            work[row + k] = work[sides + a] * work[basis + k * n + int(work[active + a])]
        for b in range(a):
            dot = 0.0
            for k in range(nullity):
                dot += work[row + k] * work[rows + b * n + k]
            work[triangle + b * nullity + a] = dot
            for k in range(nullity):
                work[row + k] -= dot * work[rows + b * n + k]
        length = 0.0
        for k in range(nullity):
            length += work[row + k] * work[row + k]
        length = math.sqrt(length)
        work[triangle + a * nullity + a] = length
        dot = 0.0
        for k in range(nullity):
            work[row + k] /= length
            dot += work[row + k] * work[direction + k]
        work[step + a] = dot
        for k in range(nullity):
            work[direction + k] -= dot * work[row + k]
    for a in range(count - 1, -1, -1):
        for b in range(a + 1, count):
            work[step + a] -= work[triangle + a * nullity + b] * work[step + b]
        work[step + a] /= work[triangle + a * nullity + a]
    left = 0.0
    for k in range(nullity):
        left += work[direction + k] * work[direction + k]
    return left, whole


@compiled
def _drop(work: FloatArray, n: int, count: int, place: int) -> None:
    """Make the active limit at `place` inactive; the others keep their order."""
    active, sides = at_vector(n, _ACTIVE), at_vector(n, _ACTIVE_SIDE)
    multiplier = at_vector(n, _MULTIPLIER)
    work[at_vector(n, _TAKEN) + int(work[active + place])] = 0.0
    for a in range(place, count - 1):
        work[active + a] = work[active + a + 1]
        work[sides + a] = work[sides + a + 1]
        work[multiplier + a] = work[multiplier + a + 1]


@compiled
def _activate(
    work: FloatArray,
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
    bound = work[at_limits(n) + cable] if side > 0.0 else work[at_limits(n) + n + cable]
    own = 0.0
    for _ in range(n + 1):
        left, whole = _dual_step(work, n, basis, nullity, count, cable, side)
        movable = count < nullity and left > DEPENDENT * whole
        length, place = math.inf, -1
        for a in range(count):
            if work[step + a] > 0.0 and work[multiplier + a] < length * work[step + a]:
                length, place = work[multiplier + a] / work[step + a], a
        if movable:
            miss = side * (bound - _value(work, n, basis, nullity, tension, cable))
            full = max(miss, 0.0) / left
            if full <= length:
                length, place = full, -1
            for k in range(nullity):
                work[z + k] += length * work[direction + k]
        elif place < 0:
            return -1
        for a in range(count):
            work[multiplier + a] -= length * work[step + a]
        own += length
        if place < 0:
            work[at_vector(n, _ACTIVE) + count] = cable
            work[at_vector(n, _ACTIVE_SIDE) + count] = side
            work[multiplier + count] = own
            work[at_vector(n, _TAKEN) + cable] = 1.0
            return count + 1
        _drop(work, n, count, place)
        count -= 1
    return -1


@compiled
def least_norm(work: FloatArray, n: int, basis: int, nullity: int, tension: FloatArray) -> bool:
    """Least norm inside the limits for any redundancy.

    Args:
        work: work array of the pose.
        n: number of cables.
        basis: where orthonormal rows start in it along which the tensions may move: those of the
            null space, or of a face.
        nullity: how many they are.
        tension: (n,) a point orthogonal to them, then the answer [N]; unchanged if there is none.

    Returns:
        Whether one was found; if not, there is none, or STEPS_PER_CABLE * n steps were not enough.
    """
    z, taken = at_vector(n, _Z), at_vector(n, _TAKEN)
    for i in range(n):
        work[z + i] = 0.0
        work[taken + i] = 0.0
    count = 0
    for step in range(STEPS_PER_CABLE * n):
        worst, cable, side = _worst_limit(work, n, basis, nullity, tension)
        work[ITERATIONS] = step
        if cable < 0:
            for i in range(n):
                tension[i] = _value(work, n, basis, nullity, tension, i)
            return True
        grown = _activate(work, n, basis, nullity, tension, count, cable, side)
        if grown >= 0:
            count = grown
        elif worst <= work[TOLERANCE]:
            work[taken + cable] = 2.0
        else:
            return False
    return False
