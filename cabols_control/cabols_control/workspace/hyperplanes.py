# SPDX-License-Identifier: Apache-2.0
"""The cables' wrenches as hyperplanes: exact tests of a pose, compiled.

The wrenches A t, tension_min <= t <= tension_max, form a zonotope. For a rank-m matrix each of
its facets is spanned by m - 1 independent columns, so its normals c are found by going through
the sets of m - 1 columns: the hyperplane-shifting method (Bouchard, Gosselin and Moore 2010;
Gouttefarde and Krut 2010). With y = A^T c the zonotope reaches sum_i max(y_i low_i, y_i high_i)
along c; a convex set lies inside if and only if it reaches no farther along any c and -c.
A normal that rounding has turned is still a valid direction of that test, so it never makes a
feasible pose infeasible by more than its rounding.

For six to eight cables in space no set of columns is solved for: y lies in the row space of A,
so it is orthogonal to the null space, and it is zero on the m - 1 spanning columns. For eight
cables that leaves y on three cables only, as the cross product of their null-space coordinates,
and c = pinv(A)^T y: a few dozen multiplications for each of the 56 pairs of facets.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.tension import prepare_pose
from cabols_control.tension.kernels.static_size import compiled
from cabols_control.tension.kernels.work_array import (
    CABLES,
    SCALE,
    TOLERANCE,
    at_basis,
    at_inverse,
    at_limits,
)

from .facet_result import finish_result, start_result, take_facet, worst_result

DEPENDENT = 1e-9
"""Columns that leave less than this of a unit direction count as dependent: no facet is lost."""
WELL_CONDITIONED = 1e-9
"""Tolerance of a pose over its largest limit, 4 eps cond: above, the normals are solved for."""
NOT_FINITE = 2
"""Answer of `prepare_pose` to a matrix that is not finite."""


@compiled
def project_set(
    work: FloatArray, n: int, points: FloatArray, generators: FloatArray, products: FloatArray
) -> None:
    """Products of the pseudo-inverse with the required set, and with itself.

    Args:
        work: work array of a pose that is ready.
        n: number of cables.
        points: (q, 6) of the required set, times the weights.
        generators: (p, 6) of it, times the weights.
        products: (n, q + p + n) filled: rows of pinv(A), weighted, times the set's vectors; then
            pinv(A) pinv(A)^T, which gives the length of a normal from its y.
    """
    inverse, q, p = at_inverse(n), points.shape[0], generators.shape[0]
    products[:, :] = 0.0
    for k in range(6):
        row = inverse + k * n
        for j in range(n):
            value = work[row + j]
            for v in range(q):
                products[j, v] += value * points[v, k]
            for v in range(p):
                products[j, q + v] += value * generators[v, k]
            for i in range(n):
                products[j, q + p + i] += value * work[row + i]


@compiled
def _facet(
    work: FloatArray,
    n: int,
    chosen: tuple[int, int, int],
    y: tuple[float, float, float],
    points: int,
    products: FloatArray,
    out: FloatArray,
) -> None:
    """One pair of facets of a rank-6 pose, y given on the three cables where it is not zero."""
    i, j, k = chosen
    yi, yj, yk = y
    if not yi * yi + yj * yj + yk * yk > DEPENDENT * DEPENDENT:
        return
    last = products.shape[1] - n
    square = yi * (yi * products[i, last + i] + 2.0 * yj * products[i, last + j])
    square += yj * (yj * products[j, last + j] + 2.0 * yk * products[j, last + k])
    square += yk * (yk * products[k, last + k] + 2.0 * yi * products[k, last + i])
    up = down = ahead = behind = 0.0
    low, high = at_limits(n), at_limits(n) + n
    for c_index in range(3):
        cable = chosen[c_index]
        value = y[c_index]
        at_low, at_high = value * work[low + cable], value * work[high + cable]
        up += max(at_low, at_high)
        down -= min(at_low, at_high)
        ahead += max(value, 0.0)
        behind -= min(value, 0.0)
    need_up, need_down, spread = -math.inf, -math.inf, 0.0
    for v in range(points):
        value = yi * products[i, v] + yj * products[j, v] + yk * products[k, v]
        need_up, need_down = max(need_up, value), max(need_down, -value)
    for v in range(points, last):
        spread += abs(yi * products[i, v] + yj * products[j, v] + yk * products[k, v])
    take_facet(
        math.sqrt(square), up, down, need_up + spread, need_down + spread, ahead, behind, out
    )


@compiled
def capacity_of_prepared(
    work: FloatArray,
    points: FloatArray,
    generators: FloatArray,
    products: FloatArray,
    out: FloatArray,
) -> None:
    """Result for a pose that `prepare_pose` made ready, six to eight cables.

    Args:
        work: work array of the pose.
        points: (q, 6) of the required set, times the weights in `work`.
        generators: (p, 6) of it, times the weights.
        products: (n, q + p + n) scratch.
        out: (RESULTS,) filled; see `capacity_at`.
    """
    n, q = int(work[CABLES]), points.shape[0]
    project_set(work, n, points, generators, products)
    start_result(out)
    nx = at_basis(n) + 6 * n
    ny = nx + n
    if n == 6:
        for i in range(n):
            _facet(work, n, (i, i, i), (1.0, 0.0, 0.0), q, products, out)
    elif n == 7:
        for i in range(n):
            for j in range(i):
                y = (-work[nx + j], work[nx + i], 0.0)
                _facet(work, n, (i, j, j), y, q, products, out)
    else:
        for i in range(n):
            ax, ay = work[nx + i], work[ny + i]
            for j in range(i):
                bx, by = work[nx + j], work[ny + j]
                cross = ax * by - ay * bx
                for k in range(j):
                    cx, cy = work[nx + k], work[ny + k]
                    y = (bx * cy - by * cx, cx * ay - cy * ax, cross)
                    _facet(work, n, (i, j, k), y, q, products, out)
    finish_result(out)


@compiled
def _orthogonalise(rows: FloatArray, count: int, vector: FloatArray) -> float:
    """Take `count` orthonormal rows out of a vector, twice; its length after that."""
    m = vector.shape[0]
    for _ in range(2):
        for k in range(count):
            dot = 0.0
            for i in range(m):
                dot += rows[k, i] * vector[i]
            for i in range(m):
                vector[i] -= dot * rows[k, i]
    total = 0.0
    for i in range(m):
        total += vector[i] * vector[i]
    return math.sqrt(total)


@compiled
def _complement(rows: FloatArray, count: int, normal: FloatArray) -> None:
    """Write a unit vector orthogonal to `count` < m orthonormal rows into normal."""
    m = normal.shape[0]
    best, pick = -1.0, 0
    for i in range(m):
        left = 1.0
        for k in range(count):
            left -= rows[k, i] * rows[k, i]
        if left > best:
            best, pick = left, i
    normal[:] = 0.0
    normal[pick] = 1.0
    length = _orthogonalise(rows, count, normal)
    for i in range(m):
        normal[i] /= length


@compiled
def _span(matrix: FloatArray, chosen: FloatArray, size: int, rows: FloatArray) -> int:
    """Orthonormal rows that span the chosen columns; how many are independent."""
    m, rank = matrix.shape[0], 0
    for s in range(size):
        column = int(chosen[s])
        before = 0.0
        for i in range(m):
            rows[rank, i] = matrix[i, column]
            before += matrix[i, column] * matrix[i, column]
        after = _orthogonalise(rows, rank, rows[rank])
        if not after > DEPENDENT * math.sqrt(before):
            continue
        for i in range(m):
            rows[rank, i] /= after
        rank += 1
        if rank == m:
            break
    return rank


@compiled
def facet_normals(matrix: FloatArray, normals: FloatArray) -> int:
    """Unit normals of the zonotope's pairs of facets, for any matrix (m, n), n >= m - 1.

    Args:
        matrix: (m, n) structure matrix.
        normals: (at least C(n, m - 1), m) filled from the top.

    Returns:
        How many; 0 if the matrix has not rank m: the zonotope is flat.
    """
    m, n = matrix.shape
    rows, chosen = np.empty((m + 1, m)), np.empty(n)
    for i in range(n):
        chosen[i] = i
    if n < m or _span(matrix, chosen, n, rows) < m:
        return 0
    size, count = m - 1, 0
    while True:
        if _span(matrix, chosen, size, rows) == size:
            _complement(rows, size, normals[count])
            count += 1
        place = size - 1
        while place >= 0 and int(chosen[place]) == n - size + place:
            place -= 1
        if place < 0:
            return count
        chosen[place] += 1
        for s in range(place + 1, size):
            chosen[s] = chosen[s - 1] + 1


@compiled
def capacity_of_matrix(
    matrix: FloatArray,
    low: FloatArray,
    high: FloatArray,
    held: FloatArray,
    points: FloatArray,
    generators: FloatArray,
    normals: FloatArray,
    out: FloatArray,
) -> None:
    """Result for any structure matrix: every normal is solved for.

    A matrix without rank m carries no set in all directions: margin -inf, the rest zero.

    Args:
        matrix: (m, n), its rows times the weights.
        low: (n,) lower limits [N].
        high: (n,) upper limits [N].
        held: (m,) constant part of the required set, weighted.
        points: (q, m) of the set, weighted.
        generators: (p, m) of it, weighted.
        normals: (C(n, m - 1), m) scratch.
        out: (RESULTS,) filled; see `capacity_at`.
    """
    m, n = matrix.shape
    start_result(out)
    count = facet_normals(matrix, normals)
    for h in range(count):
        up = down = ahead = behind = 0.0
        for i in range(n):
            y = 0.0
            for k in range(m):
                y += normals[h, k] * matrix[k, i]
            up += max(y * low[i], y * high[i])
            down -= min(y * low[i], y * high[i])
            ahead += max(y, 0.0)
            behind -= min(y, 0.0)
        for k in range(m):
            up -= normals[h, k] * held[k]
            down += normals[h, k] * held[k]
        need_up, need_down, spread = -math.inf, -math.inf, 0.0
        for v in range(points.shape[0]):
            value = 0.0
            for k in range(m):
                value += normals[h, k] * points[v, k]
            need_up, need_down = max(need_up, value), max(need_down, -value)
        for v in range(generators.shape[0]):
            value = 0.0
            for k in range(m):
                value += normals[h, k] * generators[v, k]
            spread += abs(value)
        take_facet(1.0, up, down, need_up + spread, need_down + spread, ahead, behind, out)
    finish_result(out)


@compiled
def _hold(work: FloatArray, n: int, held: FloatArray) -> None:
    """Move the limits by the tensions pinv(A) held: what is left is for the rest of the set."""
    inverse, low, high = at_inverse(n), at_limits(n), at_limits(n) + n
    for i in range(n):
        value = 0.0
        for k in range(6):
            value += work[inverse + k * n + i] * held[k]
        work[low + i] -= value
        work[high + i] -= value


@compiled
def capacity_at(
    task: Any,
    matrix: FloatArray,
    work: FloatArray,
    products: FloatArray,
    normals: FloatArray,
    scaled: FloatArray,
    held: FloatArray,
    out: FloatArray,
) -> None:
    """Result for one pose of a rig in space: the fast way where it applies, else the general.

    Args:
        task: CapacityTask: limits low and high (n,) of the tensions [N], weights (6,) of the
            wrench components; points (q, 6) and generators (p, 6) of the required set, times the
            weights.
        matrix: (6, n) structure matrix.
        work: (work_size(n),) scratch.
        products: (n, q + p + n) scratch.
        normals: (C(n, 5), 6) scratch.
        scaled: (6, n) scratch.
        held: (6,) constant part of the required set, times the weights.
        out: (RESULTS,) filled: MARGIN, least distance from the required set to a facet of the
            available one, weighted, negative outside [N]; FACTOR, largest multiple of the
            required set that fits beside the held part, see `finish_result`; CLOSURE, radius of
            the ball of weighted wrenches that tensions of 0 to 1 can give; LOWEST and HIGHEST,
            the interval of multiples that fit, NaN where none does. A pose with a cable without
            length has the worst of each.
    """
    n = matrix.shape[1]
    state = prepare_pose(matrix, task.low, task.high, task.weights, work)
    if state == NOT_FINITE:
        worst_result(out)
        return
    if state == 0 and n <= 8 and work[TOLERANCE] <= WELL_CONDITIONED * work[SCALE]:
        if task.holds:
            _hold(work, n, held)
        capacity_of_prepared(work, task.points, task.generators, products, out)
        return
    for k in range(6):
        for i in range(n):
            scaled[k, i] = task.weights[k] * matrix[k, i]
    capacity_of_matrix(
        scaled, task.low, task.high, held, task.points, task.generators, normals, out
    )
