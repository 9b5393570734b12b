# SPDX-License-Identifier: Apache-2.0
"""Least-norm tensions among those that give the same, nearest wrench.

On the boundary of the feasible wrenches the cables whose gradient is not zero are pinned to
their limits. The others usually are independent, so that nothing is left to choose. Where they
are not (mirror-symmetric rigs at their reference pose), the freedom is a line or, rarely, more.
"""

from __future__ import annotations

import math

from cabols_control.checks import FloatArray

from .basis import complete_basis, orthonormal_rows
from .general import least_norm
from .plane import PARALLEL
from .static_size import compiled
from .work_array import at_basis, at_face, at_limits, at_scaled, at_vector

ACROSS = 1e-9
"""Null-space rows whose cross product is below this count as parallel."""
PINNED = 15
"""Scratch vector: 1 for pinned cables, else 0; filled by nearest.py."""


@compiled
def _free_direction(work: FloatArray, n: int) -> tuple[int, float, float]:
    """Direction in the plane that pinned cables leave: number of dimensions left, and itself."""
    pinned, nx, ny = at_vector(n, PINNED), at_basis(n) + 6 * n, at_basis(n) + 7 * n
    found, ax, ay = False, 0.0, 0.0
    for i in range(n):
        if work[pinned + i] == 0.0:
            continue
        x, y = work[nx + i], work[ny + i]
        if not found and x * x + y * y > ACROSS * ACROSS:
            found, ax, ay = True, x, y
        elif abs(ax * y - ay * x) > ACROSS:
            return 0, 0.0, 0.0
    if not found:
        return 2, 0.0, 0.0
    length = math.sqrt(ax * ax + ay * ay)
    return 1, -ay / length, ax / length


@compiled
def _slide(work: FloatArray, n: int, dx: float, dy: float, tension: FloatArray) -> None:
    """Least norm along one direction of the plane, from a point that keeps the limits."""
    limits, nx, ny = at_limits(n), at_basis(n) + 6 * n, at_basis(n) + 7 * n
    lower, upper, target = -math.inf, math.inf, 0.0
    for i in range(n):
        slope = work[nx + i] * dx + work[ny + i] * dy
        target -= slope * tension[i]
        if abs(slope) < PARALLEL or work[at_vector(n, PINNED) + i] != 0.0:
            continue
        start, end = (work[limits + i] - tension[i]), (work[limits + n + i] - tension[i])
        start, end = start / slope, end / slope
        lower, upper = max(lower, min(start, end)), min(upper, max(start, end))
    move = min(max(target, min(lower, 0.0)), max(upper, 0.0))
    for i in range(n):
        if work[at_vector(n, PINNED) + i] == 0.0:
            tension[i] += move * (work[nx + i] * dx + work[ny + i] * dy)


@compiled
def choose_on_line(work: FloatArray, n: int, tension: FloatArray) -> bool:
    """Least norm on a face of a rank-6 pose with two degrees of redundancy, in closed form.

    Args:
        work: work array of a pose that is ready; its vector PINNED says which cables must stay.
        n: number of cables, 8.
        tension: (n,) inside the limits, then the answer [N]; the wrench stays.

    Returns:
        False, and nothing done, if no cable is pinned in a way that matters, so that the whole
        plane is left: for `choose_on_face`.
    """
    left, dx, dy = _free_direction(work, n)
    if left == 1:
        _slide(work, n, dx, dy, tension)
    return left < 2


@compiled
def choose_on_face(work: FloatArray, n: int, tension: FloatArray) -> None:
    """Least norm on any face: null space of the columns that are not pinned, general solver.

    Args:
        work: work array that `prepare_pose` filled, of any rank; its vector PINNED says which
            cables must stay.
        n: number of cables.
        tension: (n,) inside the limits, then the answer [N]; the wrench stays.
    """
    pinned, basis, scaled = at_vector(n, PINNED), at_face(n), at_scaled(n)
    rows = basis + n * n
    for k in range(6):
        for i in range(n):
            free = 1.0 - work[pinned + i]
            work[rows + k * n + i] = free * work[scaled + k * n + i]
    count = orthonormal_rows(work, rows, basis, rows + 6 * n, n)
    for i in range(n):
        if work[pinned + i] != 0.0:
            for j in range(n):
                work[basis + count * n + j] = 0.0
            work[basis + count * n + i] = 1.0
            count += 1
    if count >= n:
        return
    complete_basis(work, basis, count, n)
    for k in range(count, n):
        dot = 0.0
        for i in range(n):
            dot += work[basis + k * n + i] * tension[i]
        for i in range(n):
            tension[i] -= dot * work[basis + k * n + i]
        work[at_vector(n, 7) + k] = dot
    if least_norm(work, n, basis + count * n, n - count, tension):
        return
    for k in range(count, n):  # nothing better found: back to where it came from
        for i in range(n):
            tension[i] += work[at_vector(n, 7) + k] * work[basis + k * n + i]
