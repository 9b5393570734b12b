# SPDX-License-Identifier: Apache-2.0
"""The orthonormal basis of a pose: row space and null space of the structure matrix.

With B = diag(weights) A (6, n) and its rows orthonormalised, B = L Q, the tensions that give a
scaled wrench v are t = pinv(B) v + N z, pinv(B) = Q^T inv(L), N the rows that complete Q.
Weights scale rows only: they change neither the null space nor the exact solution.
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray

from .static_size import EIGHT, Size, cables, compiled
from .work_array import (
    BROKEN,
    CABLES,
    DEFICIENT,
    GRAM_MAX,
    READY,
    SCALE,
    STATE,
    STEEPEST,
    TOLERANCE,
    at_basis,
    at_gram,
    at_inverse,
    at_limits,
    at_scaled,
    at_scratch,
    at_structure,
    at_vector,
    at_weights,
)

RANK_TOLERANCE = 1e-10
"""A row that keeps less than this part of its length after projection counts as dependent."""
FEASIBILITY_TOLERANCE = 1e-12
"""Limits may be missed by this times the largest limit before a wrench counts as infeasible."""
NOT_YET = -1.0
SLOPE = 100.0
"""Times the largest limit: largest multiplier of least-norm tensions [1 / weighted N]."""
ROUNDING = 2.220446049250313e-16


@compiled
def orthogonalise(work: FloatArray, rows: int, count: int, row: int, size: Size) -> None:
    """Take orthonormal rows out of another, twice, so that nothing but rounding is left.

    Twice is enough (Kahan and Parlett): 4 n count multiplications, always.

    Args:
        work: work array.
        rows: where the orthonormal rows, n each, start in it.
        count: how many of them are taken out.
        row: where the row to treat starts; updated.
        size: number of cables n, see static_size.py.
    """
    n = cables(size)
    for _ in range(2):
        for k in range(count):
            dot = 0.0
            for i in range(n):
                dot += work[rows + k * n + i] * work[row + i]
            for i in range(n):
                work[row + i] -= dot * work[rows + k * n + i]


@compiled
def complete_basis(work: FloatArray, rows: int, count: int, size: Size) -> None:
    """Add orthonormal rows to given ones until there are n: the null space's basis.

    Each is the unit vector that is farthest from the rows so far, projected; its length is at
    least sqrt((n - count) / n), so nothing is lost. At most 4 n**2 multiplications a row.

    Args:
        work: work array.
        rows: where the (n, n) rows start in it; those after the given ones are filled.
        count: how many are given.
        size: number of cables n, see static_size.py.
    """
    n = cables(size)
    for k in range(count, n):
        best, pick = -1.0, 0
        for i in range(n):
            left = 1.0
            for j in range(k):
                left -= work[rows + j * n + i] * work[rows + j * n + i]
            if left > best:
                best, pick = left, i
        row = rows + k * n
        for i in range(n):
            work[row + i] = 0.0
        work[row + pick] = 1.0
        orthogonalise(work, rows, k, row, size)
        total = 0.0
        for i in range(n):
            total += work[row + i] * work[row + i]
        factor = 1.0 / math.sqrt(total)
        for i in range(n):
            work[row + i] *= factor


@compiled
def orthonormal_rows(work: FloatArray, source: int, rows: int, factor: int, size: Size) -> int:
    """Gram-Schmidt on six rows; at most 120 n multiplications.

    Args:
        work: work array.
        source: where the given rows (6, n) start in it.
        rows: where the orthonormal ones go; a dependent row is left out.
        factor: where the coefficients L (6, 6) go: source = L rows, if no row is dependent.
        size: number of cables n, see static_size.py.

    Returns:
        How many rows are independent.
    """
    n = cables(size)
    rank = 0
    for k in range(6):
        row = rows + rank * n
        before = 0.0
        for i in range(n):
            value = work[source + k * n + i]
            work[row + i] = value
            before += value * value
        orthogonalise(work, rows, rank, row, size)
        after = 0.0
        for i in range(n):
            after += work[row + i] * work[row + i]
        if not after > RANK_TOLERANCE * RANK_TOLERANCE * before:
            continue
        length = math.sqrt(after)
        scale = 1.0 / length
        for i in range(n):
            work[row + i] *= scale
        for j in range(rank):
            dot = 0.0
            for i in range(n):
                dot += work[source + k * n + i] * work[rows + j * n + i]
            work[factor + 6 * k + j] = dot
        work[factor + 6 * k + rank] = length
        rank += 1
    return rank


@compiled
def _reflect_rows(work: FloatArray, size: Size) -> tuple[bool, float]:
    """Householder reflections that make diag(weights) A lower triangular.

    Works on a copy of the rows at `at_gram` (scratch until the Gram matrix is asked for). The
    directions go to scratch vectors 8 on, zero before place k: whole rows cost less than parts
    of them. The triangle (6, 6) goes to the scratch vectors 0 on. Returns False if a row is
    dependent, and the matrix's sum of squares. At most 80 n multiplications.
    """
    n = cables(size)
    rows, scaled, triangle, total = at_gram(n), at_scaled(n), at_scratch(n), 0.0
    for i in range(6 * n):
        work[rows + i] = work[scaled + i]
    for k in range(6):
        row, direction, passed, square = rows + k * n, at_vector(n, 8 + k), 0.0, 0.0
        for i in range(n):
            value = work[row + i]
            work[direction + i] = 0.0 if i < k else value
            passed += value * value if i < k else 0.0
            square += 0.0 if i < k else value * value
        for i in range(k):
            work[triangle + 6 * k + i] = work[row + i]
        total += square + passed
        if not square > RANK_TOLERANCE * RANK_TOLERANCE * (square + passed):
            return False, total
        length, head = math.sqrt(square), work[row + k]
        signed = length if head > 0.0 else -length
        work[triangle + 7 * k] = -signed
        work[direction + k] = head + signed
        # Scaled to length sqrt(2), so that the reflection is I - v v^T.
        scale = 1.0 / math.sqrt(length * (length + abs(head)))
        for i in range(n):
            work[direction + i] *= scale
        for j in range(k + 1, 6):
            _reflect(work, direction, rows + j * n, size)
    return True, total


@compiled
def _reflect(work: FloatArray, direction: int, row: int, size: Size) -> None:
    """Take (I - v v^T) of a row: 2 n multiplications."""
    n = cables(size)
    even, odd = 0.0, 0.0
    for i in range(n // 2):
        even += work[direction + 2 * i] * work[row + 2 * i]
        odd += work[direction + 2 * i + 1] * work[row + 2 * i + 1]
    if n % 2 == 1:
        even += work[direction + n - 1] * work[row + n - 1]
    dot = even + odd
    for i in range(n):
        work[row + i] -= dot * work[direction + i]


@compiled
def _fill_basis(work: FloatArray, size: Size) -> None:
    """All n orthonormal rows, from the reflections: at most 12 n**2 multiplications."""
    n = cables(size)
    basis = at_basis(n)
    for j in range(n):
        for i in range(n):
            work[basis + j * n + i] = 1.0 if i == j else 0.0
    for k in range(5, -1, -1):
        for j in range(k, n):
            _reflect(work, at_vector(n, 8 + k), basis + j * n, size)


@compiled
def _fill_inverse(work: FloatArray, size: Size) -> float:
    """Transposed pseudo-inverse inv(L)^T Q by back substitution; returns its Frobenius norm."""
    n = cables(size)
    inverse, basis, factor = at_inverse(n), at_basis(n), at_scratch(n)
    total = 0.0
    for k in range(5, -1, -1):
        scale = 1.0 / work[factor + 7 * k]
        for i in range(n):
            work[inverse + k * n + i] = work[basis + k * n + i]
        for j in range(k + 1, 6):
            part = work[factor + 6 * j + k]
            for i in range(n):
                work[inverse + k * n + i] -= part * work[inverse + j * n + i]
        for i in range(n):
            work[inverse + k * n + i] *= scale
            total += work[inverse + k * n + i] * work[inverse + k * n + i]
    return math.sqrt(total)


@compiled
def fill_gram(work: FloatArray, size: Size) -> None:
    """Gram matrix of the scaled columns, once per pose, when the first wrench asks for it.

    Args:
        work: work array that `prepare_pose` filled; matrix and GRAM_MAX are written.
        size: number of cables, see static_size.py.
    """
    n = cables(size)
    scaled, gram = at_scaled(n), at_gram(n)
    if work[GRAM_MAX] >= 0.0:
        return
    for i in range(n):
        for j in range(n):
            work[gram + i * n + j] = 0.0
        for k in range(6):
            part = work[scaled + k * n + i]
            for j in range(n):
                work[gram + i * n + j] += part * work[scaled + k * n + j]
    largest = 0.0
    for i in range(n):
        largest = max(largest, work[gram + i * n + i])
    work[GRAM_MAX] = largest


@compiled
def _copy_inputs(
    work: FloatArray,
    size: Size,
    A: FloatArray,
    tension_min: FloatArray,
    tension_max: FloatArray,
    weights: FloatArray,
) -> bool:
    """Copy the inputs and scale the matrix; False if something is not finite or min > max."""
    n = cables(size)
    structure, limits, scaled = at_structure(n), at_limits(n), at_scaled(n)
    zero, ordered, scale = 0.0, True, 0.0
    for i in range(n):
        low, high = tension_min[i], tension_max[i]
        zero += 0.0 * low + 0.0 * high
        ordered = ordered and low <= high
        work[limits + i] = low
        work[limits + n + i] = high
        scale = max(scale, abs(low), abs(high))
    for k in range(6):
        weight = weights[k]
        work[at_weights(n) + k] = weight
        zero += 0.0 * weight
        ordered = ordered and weight > 0.0
        for i in range(n):
            value = A[k, i]
            zero += 0.0 * value
            work[structure + k * n + i] = value
            work[scaled + k * n + i] = weight * value
    work[SCALE] = scale
    # 0 * x is 0 for every finite x and NaN otherwise, so one comparison finds them all.
    return ordered and zero == 0.0


@compiled
def _prepare(
    work: FloatArray,
    size: Size,
    A: FloatArray,
    tension_min: FloatArray,
    tension_max: FloatArray,
    weights: FloatArray,
) -> int:
    """Do what `prepare_pose` promises."""
    n = cables(size)
    work[CABLES] = n
    work[STATE] = BROKEN
    if not _copy_inputs(work, size, A, tension_min, tension_max, weights):
        return 2
    work[GRAM_MAX] = NOT_YET
    work[STATE] = DEFICIENT
    work[TOLERANCE] = FEASIBILITY_TOLERANCE * work[SCALE]
    full, square = _reflect_rows(work, size)
    if not full:
        return 1
    _fill_basis(work, size)
    inverse = _fill_inverse(work, size)
    condition = math.sqrt(square) * inverse
    # |lambda| <= |pinv(B)| (|t| + |mu|), mu the multipliers of the limits.
    work[STEEPEST] = (SLOPE / inverse - math.sqrt(n)) * work[SCALE]
    if not condition * RANK_TOLERANCE < 1.0:
        return 1
    work[TOLERANCE] = max(FEASIBILITY_TOLERANCE, 4.0 * ROUNDING * condition) * work[SCALE]
    work[STATE] = READY
    return 0


@compiled
def prepare_pose(
    A: FloatArray,
    tension_min: FloatArray,
    tension_max: FloatArray,
    weights: FloatArray,
    work: FloatArray,
) -> int:
    """Prepare everything that depends on the pose and the limits only.

    Args:
        A: (6, n) structure matrix, W = A @ tension, base axes [1; m].
        tension_min: (n,) lower limits [N].
        tension_max: (n,) upper limits [N].
        weights: (6,) positive weights of the wrench components in the nearest wrench.
        work: (work_size(n),) work array, overwritten.

    Returns:
        0 if ready, 1 if A is (nearly) rank-deficient (solved all the same, as a nearest wrench),
        2 if something is not finite, min > max or a weight is not positive: `solve_prepared`
        then answers 2. About 1200 multiplications for n = 8, whatever the numbers.
    """
    if A.shape[1] == 8:
        return _prepare(work, EIGHT, A, tension_min, tension_max, weights)
    return _prepare(work, A.shape[1], A, tension_min, tension_max, weights)
