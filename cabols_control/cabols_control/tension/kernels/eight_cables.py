# SPDX-License-Identifier: Apache-2.0
"""Straight code for the common case: eight cables, a feasible wrench, a pose far from singular.

The same exact solution as plane.py's, without its bookkeeping. Whatever is not plain (a wrench
that may be infeasible, a pose whose rows are nearly dependent) is not judged here: the functions
then say NOT_PLAIN and the caller takes the general way.

Slabs are taken in their order instead of the most violated first: up to 28 clips (n(n - 1)/2),
but each is a few multiplications and one division.
"""

from __future__ import annotations

import math

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit

from .basis import SLOPE
from .plane import PARALLEL, VIOLATION
from .smooth import AT_LIMIT
from .static_size import compiled
from .work_array import (
    EXACT,
    ITERATIONS,
    SCALE,
    STEEPEST,
    Six,
    at_basis,
    at_inverse,
    at_limits,
    at_scratch,
    at_structure,
    at_weights,
)

PLAIN, NOT_PLAIN = True, False
INDEPENDENT = 1e-3
"""A row of A that keeps less than this share of its square beyond the rows before is not plain:
the Gram matrix squares the condition, and tensions must be exact to 1e-9 N."""
WELL_PLACED = 0.01
"""The last two unit vectors must keep so much of their square in the null space."""

# Sums may be reordered for vector code; NaN and infinity keep their meaning.
vectorised = njit(
    cache=True, error_model="numpy", boundscheck=False, fastmath={"reassoc", "contract", "nsz"}
)

_N = 8
_INVERSE, _STRUCTURE = at_inverse(_N), at_structure(_N)
_LIMITS, _WEIGHTS = at_limits(_N), at_weights(_N)
_NULL = at_basis(_N) + 6 * _N
# Scratch of solve_pose_eight: factor (6, 6), inverse pivots, basis (2, 8), rows (6, 16).
_FACTOR = at_scratch(_N)
_PIVOT, _BASIS, _ROWS = _FACTOR + 36, _FACTOR + 42, _FACTOR + 58
_WIDE = 2 * _N
"""Length of a row: inv(L) A, then inv(L) (6) and nothing (2)."""


@compiled
def _plane_eight(work: FloatArray, null: int, steepest: float, tension: FloatArray) -> bool:
    """Least-norm tensions within the limits; `tension` is t0, then the answer.

    Args:
        work: work array of the pose.
        null: where the null space's orthonormal rows (2, 8) begin in it.
        steepest: multipliers of the limits beyond this are not plain (smooth.py) [N].
        tension: (8,) [N].
    """
    threshold = VIOLATION * work[SCALE]
    zx, zy, clips = 0.0, 0.0, 0
    ux, uy, foot, along = 1.0, 0.0, 0.0, 0.0
    for i in range(_N):
        ax, ay = work[null + i], work[null + _N + i]
        value = tension[i] + (ax * zx + ay * zy)
        if value < work[_LIMITS + i] - threshold:
            bound = work[_LIMITS + i]
        elif value > work[_LIMITS + _N + i] + threshold:
            bound = work[_LIMITS + _N + i]
        else:
            continue
        square = ax * ax + ay * ay
        if not square > PARALLEL:
            return NOT_PLAIN
        reach = (bound - tension[i]) / square
        fx, fy = reach * ax, reach * ay
        lower, upper = -math.inf, math.inf
        for j in range(i):
            bx, by = work[null + j], work[null + _N + j]
            slope = by * ax - bx * ay
            at_foot = tension[j] + (bx * fx + by * fy)
            low, high = work[_LIMITS + j] - at_foot, work[_LIMITS + _N + j] - at_foot
            if not abs(slope) > PARALLEL:
                if not (low <= threshold and high >= -threshold):
                    return NOT_PLAIN
                continue
            scale = 1.0 / slope
            start, end = low * scale, high * scale
            lower = max(lower, min(start, end))
            upper = min(upper, max(start, end))
        if not lower <= upper:
            return NOT_PLAIN
        clips += i
        s = min(max(0.0, lower), upper)
        zx, zy = fx - s * ay, fy + s * ax
        ux, uy, foot, along = ax, ay, reach, s
    work[ITERATIONS] = clips
    for i in range(_N):
        value = tension[i] + (work[null + i] * zx + work[null + _N + i] * zy)
        tension[i] = min(max(value, work[_LIMITS + i]), work[_LIMITS + _N + i])
    if along == 0.0:
        return abs(foot) <= steepest
    # A corner: the multiplier of the other limit grows as the two lines become parallel. It is
    # |along| square / least, and 1 / sqrt(square) of it as much again for this one.
    square, least, near = ux * ux + uy * uy, 2.0, AT_LIMIT * work[SCALE]
    for i in range(_N):
        slope = abs(work[null + _N + i] * ux - work[null + i] * uy)
        room = min(tension[i] - work[_LIMITS + i], work[_LIMITS + _N + i] - tension[i])
        least = slope if room <= near and PARALLEL < slope < least else least
    return abs(along) * (square + math.sqrt(square)) <= (steepest - abs(foot)) * least


@compiled
def solve_fixed_eight(work: FloatArray, wrench: FloatArray, tension: FloatArray) -> bool:
    """Tensions for one wrench at a pose that is ready.

    Args:
        work: work array that `prepare_pose` filled, in state READY.
        wrench: (6,) finite [N, N m], base axes.
        tension: (8,) filled [N]; of no use if NOT_PLAIN.

    Returns:
        PLAIN or NOT_PLAIN.
    """
    w0, w1 = wrench[0] * work[_WEIGHTS], wrench[1] * work[_WEIGHTS + 1]
    w2, w3 = wrench[2] * work[_WEIGHTS + 2], wrench[3] * work[_WEIGHTS + 3]
    w4, w5 = wrench[4] * work[_WEIGHTS + 4], wrench[5] * work[_WEIGHTS + 5]
    for i in range(_N):
        k = _INVERSE + i
        tension[i] = (
            (work[k] * w0 + work[k + 8] * w1) + (work[k + 16] * w2 + work[k + 24] * w3)
        ) + (work[k + 32] * w4 + work[k + 40] * w5)
    steepest = math.inf if work[EXACT] == 1.0 else work[STEEPEST]
    return bool(_plane_eight(work, _NULL, steepest, tension))


@vectorised
def _factor(work: FloatArray) -> bool:
    """L D L^T of A A^T from the structure matrix in `work`; False if rows are nearly dependent."""
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for c in range(_N):
                total += work[_STRUCTURE + 8 * i + c] * work[_STRUCTURE + 8 * j + c]
            work[_FACTOR + 6 * i + j] = total
    for j in range(6):
        square = work[_FACTOR + 7 * j]
        pivot = square
        for k in range(j):
            pivot -= work[_FACTOR + 6 * j + k] * work[_FACTOR + 6 * k + j]
        # Written so that NaN is not plain.
        if not pivot > INDEPENDENT * square:
            return NOT_PLAIN
        inverse = 1.0 / pivot
        work[_PIVOT + j] = inverse
        for i in range(j + 1, 6):
            value = work[_FACTOR + 6 * i + j]
            for k in range(j):
                value -= work[_FACTOR + 6 * i + k] * work[_FACTOR + 6 * k + j]
            # Above the diagonal D L^T, which the next columns need, below it L.
            work[_FACTOR + 6 * j + i] = value
            work[_FACTOR + 6 * i + j] = value * inverse
    return PLAIN


@vectorised
def _fill_rows(work: FloatArray) -> float:
    """Rows of inv(L) (A, 1): the former are orthogonal; Frobenius norm of pinv(diag(weights) A)."""
    for i in range(6):
        row = _ROWS + _WIDE * i
        for c in range(_N):
            work[row + c] = work[_STRUCTURE + 8 * i + c]
            work[row + _N + c] = 1.0 if c == i else 0.0
        for j in range(i):
            part = work[_FACTOR + 6 * i + j]
            for c in range(_WIDE):
                work[row + c] -= part * work[_ROWS + _WIDE * j + c]
    total = 0.0
    for k in range(6):
        square = 0.0
        for i in range(6):
            entry = work[_ROWS + _WIDE * i + _N + k]
            square += entry * entry * work[_PIVOT + i]
        total += square / (work[_WEIGHTS + k] * work[_WEIGHTS + k])
    return math.sqrt(total)


@vectorised
def _combine_rows(work: FloatArray, parts: Six, out: FloatArray, start: int) -> None:
    """Write A^T inv(L)^T inv(D) x, x the parts, to eight places of `out` from `start`."""
    x0, x1, x2 = parts[0] * work[_PIVOT], parts[1] * work[_PIVOT + 1], parts[2] * work[_PIVOT + 2]
    x3, x4 = parts[3] * work[_PIVOT + 3], parts[4] * work[_PIVOT + 4]
    x5 = parts[5] * work[_PIVOT + 5]
    for c in range(_N):
        k = _ROWS + c
        out[start + c] = (
            (work[k] * x0 + work[k + _WIDE] * x1)
            + (work[k + 2 * _WIDE] * x2 + work[k + 3 * _WIDE] * x3)
            + (work[k + 4 * _WIDE] * x4 + work[k + 5 * _WIDE] * x5)
        )


@vectorised
def _null_rows(work: FloatArray) -> bool:
    """Orthonormal rows (2, 8) of the null space, from the last two unit vectors."""
    x, y = _BASIS, _BASIS + _N
    for r in range(2):
        k = _ROWS + 6 + r
        column = (
            -work[k],
            -work[k + _WIDE],
            -work[k + 2 * _WIDE],
            -work[k + 3 * _WIDE],
            -work[k + 4 * _WIDE],
            -work[k + 5 * _WIDE],
        )
        _combine_rows(work, column, work, _BASIS + _N * r)
        work[_BASIS + _N * r + 6 + r] += 1.0
    xx, xy, yy = 0.0, 0.0, 0.0
    for c in range(_N):
        xx += work[x + c] * work[x + c]
        xy += work[x + c] * work[y + c]
    if not xx > WELL_PLACED:
        return NOT_PLAIN
    share = xy / xx
    for c in range(_N):
        work[y + c] -= share * work[x + c]
        yy += work[y + c] * work[y + c]
    if not yy > WELL_PLACED:
        return NOT_PLAIN
    sx, sy = 1.0 / math.sqrt(xx), 1.0 / math.sqrt(yy)
    for c in range(_N):
        work[x + c] *= sx
        work[y + c] *= sy
    return PLAIN


@vectorised
def _eliminated(work: FloatArray, wrench: FloatArray) -> Six:
    """inv(L) w."""
    w0, w1, w2 = wrench[0], wrench[1], wrench[2]
    w3, w4, w5 = wrench[3], wrench[4], wrench[5]
    k = _ROWS + _N
    a, b = k + _WIDE, k + 2 * _WIDE
    c, d, e = k + 3 * _WIDE, k + 4 * _WIDE, k + 5 * _WIDE
    return (
        w0,
        work[a] * w0 + w1,
        work[b] * w0 + work[b + 1] * w1 + w2,
        work[c] * w0 + work[c + 1] * w1 + work[c + 2] * w2 + w3,
        (work[d] * w0 + work[d + 1] * w1) + (work[d + 2] * w2 + work[d + 3] * w3) + w4,
        (work[e] * w0 + work[e + 1] * w1)
        + (work[e + 2] * w2 + work[e + 3] * w3)
        + (work[e + 4] * w4 + w5),
    )


@compiled
def solve_pose_eight(
    work: FloatArray,
    tension_min: FloatArray,
    tension_max: FloatArray,
    wrench: FloatArray,
    tension: FloatArray,
) -> bool:
    """Tensions for one wrench at a new pose, whose structure matrix stands in `work`.

    Nothing that outlives the call is prepared: for more wrenches at the pose use prepare_pose.
    About 700 multiplications.

    Args:
        work: work array with structure matrix, weights and EXACT in their places; limits, SCALE
            and scratch are overwritten.
        tension_min: (8,) lower limits [N].
        tension_max: (8,) upper limits, none below the lower [N].
        wrench: (6,) [N, N m], base axes.
        tension: (8,) filled [N]; of no use if NOT_PLAIN.

    Returns:
        PLAIN, or NOT_PLAIN, as where matrix or wrench are not finite.
    """
    if not _factor(work):
        return NOT_PLAIN
    inverse = _fill_rows(work)
    if not _null_rows(work):
        return NOT_PLAIN
    largest = 0.0
    for i in range(_N):
        work[_LIMITS + i], work[_LIMITS + _N + i] = tension_min[i], tension_max[i]
        largest = max(largest, abs(tension_min[i]), abs(tension_max[i]))
    work[SCALE] = largest
    total = 0.0
    for i in range(6):
        total += abs(wrench[i])
    if not (np.isfinite(total) and np.isfinite(largest)):
        return NOT_PLAIN
    _combine_rows(work, _eliminated(work, wrench), tension, 0)
    # As prepare_pose has it.
    steep = (SLOPE / inverse - math.sqrt(float(_N))) * largest
    steepest = math.inf if work[EXACT] == 1.0 else steep
    return bool(_plane_eight(work, _BASIS, steepest, tension))
