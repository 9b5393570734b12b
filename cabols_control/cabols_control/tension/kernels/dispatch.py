# SPDX-License-Identifier: Apache-2.0
"""Compiled entries: one wrench, many wrenches, many poses. No allocation, no exception."""

from __future__ import annotations

from typing import Any

from cabols_control.cable_kernels import CABLE, CABLE_FLOATS, structure_matrix_into
from cabols_control.checks import FloatArray, IntArray

from .basis import prepare_pose
from .eight_cables import solve_fixed_eight, solve_pose_eight
from .faces import choose_on_face, choose_on_line
from .general import least_norm
from .nearest import (
    CHOOSE,
    DESCEND,
    descend,
    exchange_blocks,
    nearest_from_conflict,
    start_from_limits,
)
from .plane import pseudo_inverse_tension, solve_line, solve_plane, solve_point
from .residual import clip_and_subtract
from .smooth import soften, steep
from .softened import NO_LOSS, UNSETTLED, miss_length, soften_nearest, start_from_conflict
from .static_size import EIGHT, Size, cables, compiled, inlined
from .work_array import (
    CABLES,
    DEFICIENT,
    EXACT,
    FEASIBLE,
    GRAM_MAX,
    INFEASIBLE,
    INVALID,
    ITERATIONS,
    LOSS,
    READY,
    SCALE,
    STATE,
    Six,
    at_basis,
    at_limits,
    at_structure,
    at_vector,
    at_weights,
    work_size,
)

LARGEST_WRENCH = 1e100
"""Components beyond this count as not finite: their squares would overflow."""
DEFICIENT_TOLERANCE = 1e-11
"""Rank-deficient A: the wrench is reached if the weighted residual is below this, relative."""
_TO_DO = -1
_DETECT, _RESIDUAL, _SAVED = 16, 17, 7  # scratch vectors


@inlined
def spare_residual(work: FloatArray) -> FloatArray:
    """(6,) scratch for a residual that nobody asked for."""
    start = at_vector(int(work[CABLES]), _RESIDUAL)
    return work[start : start + 6]


@compiled
def _scaled_wrench(work: FloatArray, size: Size, wrench: FloatArray) -> Six:
    """Wrench times weights."""
    n = cables(size)
    k = at_weights(n)
    return (
        wrench[0] * work[k],
        wrench[1] * work[k + 1],
        wrench[2] * work[k + 2],
        wrench[3] * work[k + 3],
        wrench[4] * work[k + 4],
        wrench[5] * work[k + 5],
    )


@compiled
def _usable(work: FloatArray, wrench: FloatArray) -> bool:
    """True if pose and wrench are finite; written so that NaN fails."""
    total = (abs(wrench[0]) + abs(wrench[1])) + (abs(wrench[2]) + abs(wrench[3]))
    total += abs(wrench[4]) + abs(wrench[5])
    prepared = work[STATE] == READY or work[STATE] == DEFICIENT
    return bool(prepared and total < LARGEST_WRENCH)


@compiled
def _inside_limits(work: FloatArray, size: Size, target: Six, tension: FloatArray) -> bool:
    """Least-norm tensions if some keep the limits; True if so. Rank 6."""
    n = cables(size)
    pseudo_inverse_tension(work, size, target, tension)
    if n == 8:
        return solve_plane(work, EIGHT, tension)
    if n == 7:
        return solve_line(work, n, tension)
    if n == 6:
        return solve_point(work, n, tension)
    return least_norm(work, n, at_basis(n) + 6 * n, n - 6, tension)


@compiled
def _reject(work: FloatArray, size: Size, tension_out: FloatArray, residual_out: FloatArray) -> int:
    """The safe answer to input that is not finite."""
    n = cables(size)
    for i in range(n):
        tension_out[i] = work[at_limits(n) + i]
    for k in range(6):
        residual_out[k] = float("nan")
    return INVALID


@compiled
def _reached(work: FloatArray, target: Six, largest: float) -> bool:
    """Whether a rank-deficient pose reaches the wrench: by the residual."""
    if work[STATE] != DEFICIENT:
        return False
    span = work[GRAM_MAX] ** 0.5 * work[SCALE]
    for value in target:
        span = max(span, abs(value))
    return bool(largest <= DEFICIENT_TOLERANCE * span)


@compiled
def _fill_loss(work: FloatArray, target: Six, tension: FloatArray) -> None:
    """Write the loss of softened tensions for eight cables, whose sides are written."""
    softened = miss_length(work, EIGHT, target, tension)
    spare = work[at_vector(8, _DETECT) : at_vector(8, _DETECT) + 8]
    for i in range(8):
        spare[i] = tension[i]
    if exchange_blocks(work, EIGHT, target, spare) == DESCEND:
        descend(work, EIGHT, target, spare)
    work[LOSS] = max(softened - miss_length(work, EIGHT, target, spare), 0.0)


@compiled
def _solve(
    work: FloatArray,
    size: Size,
    wrench: FloatArray,
    tension_out: FloatArray,
    residual_out: FloatArray,
) -> int:
    """Do what `solve_prepared` promises for input that is finite, and not plain."""
    n = cables(size)
    target = _scaled_wrench(work, size, wrench)
    ready = work[STATE] == READY
    planar = ready and n == 8
    smooth, saved = work[EXACT] != 1.0 and work[SCALE] > 0.0, at_vector(n, _SAVED)
    if ready and _inside_limits(work, size, target, tension_out):
        if smooth and steep(work, size, tension_out):
            soften(work, size, target, True, saved, tension_out)
        clip_and_subtract(work, size, wrench, tension_out, residual_out)
        return FEASIBLE
    if smooth and planar:
        e = start_from_conflict(work, EIGHT, tension_out)
        done = soften_nearest(work, EIGHT, target, e, tension_out)
        if done != UNSETTLED:
            clip_and_subtract(work, EIGHT, wrench, tension_out, residual_out)
            if done == NO_LOSS:
                _fill_loss(work, target, tension_out)
            return INFEASIBLE
        pseudo_inverse_tension(work, EIGHT, target, tension_out)
    todo = DESCEND
    if planar:
        todo = nearest_from_conflict(work, EIGHT, target, tension_out)
    else:
        start_from_limits(work, n, tension_out)
    if todo == DESCEND:
        todo = descend(work, n, target, tension_out)
    if todo == CHOOSE and not (planar and choose_on_line(work, n, tension_out)):
        choose_on_face(work, n, tension_out)
    largest = clip_and_subtract(work, size, wrench, tension_out, residual_out)
    if _reached(work, target, largest):
        return FEASIBLE
    if smooth:
        soften(work, size, target, False, saved, tension_out)
        clip_and_subtract(work, size, wrench, tension_out, residual_out)
    return INFEASIBLE


@inlined
def solve_prepared(
    work: FloatArray, wrench: FloatArray, tension_out: FloatArray, residual_out: FloatArray
) -> int:
    """Tensions for one wrench, at the pose and limits in `work`.

    Args:
        work: (work_size(n),) work array that `prepare_pose` filled; its scratch is overwritten.
        wrench: (6,) force [N] then torque [N m] on the platform, base axes.
        tension_out: (n,) tensions [N], inside the limits.
        residual_out: (6,) A @ tension_out - wrench.

    Returns:
        0 feasible, 1 infeasible (tensions of the nearest feasible wrench), 2 not finite
        (tension_out = tension_min, residual NaN).
    """
    n = int(work[CABLES])
    if not _usable(work, wrench):
        return _reject(work, n, tension_out, residual_out)
    work[ITERATIONS] = 0.0
    work[LOSS] = 0.0
    if n == 8:
        # The common case stays here: to call a function with arrays costs a tenth of it.
        if work[STATE] == READY and solve_fixed_eight(work, wrench, tension_out):
            clip_and_subtract(work, EIGHT, wrench, tension_out, residual_out)
            return FEASIBLE
        return _solve(work, EIGHT, wrench, tension_out, residual_out)
    return _solve(work, n, wrench, tension_out, residual_out)


@inlined
def detect_prepared(work: FloatArray, wrench: FloatArray) -> int:
    """Status alone, as `solve_prepared` gives it, without the nearest wrench where rank is 6.

    Args:
        work: (work_size(n),) work array that `prepare_pose` filled; its scratch is overwritten.
        wrench: (6,) force [N] then torque [N m] on the platform, base axes.
    """
    n = int(work[CABLES])
    if not _usable(work, wrench):
        return INVALID
    tension = work[at_vector(n, _DETECT) : at_vector(n, _DETECT) + n]
    if work[STATE] == DEFICIENT:
        return solve_prepared(work, wrench, tension, spare_residual(work))
    if n == 8:
        pseudo_inverse_tension(work, EIGHT, _scaled_wrench(work, EIGHT, wrench), tension)
        return FEASIBLE if solve_plane(work, EIGHT, tension) else INFEASIBLE
    inside = _inside_limits(work, n, _scaled_wrench(work, n, wrench), tension)
    return FEASIBLE if inside else INFEASIBLE


@compiled
def _solve_plain(
    work: FloatArray, wrenches: FloatArray, tensions: FloatArray, status: IntArray
) -> None:
    """Solve the plain ones of many wrenches for eight cables.

    A loop of its own, so that the general solver's code is not beside it.
    """
    for k in range(wrenches.shape[0]):
        if _usable(work, wrenches[k]) and solve_fixed_eight(work, wrenches[k], tensions[k]):
            status[k] = FEASIBLE


@compiled
def solve_batch(
    work: FloatArray, wrenches: FloatArray, tensions: FloatArray, status: IntArray
) -> None:
    """`solve_prepared` for many wrenches, the same bits as one by one.

    Args:
        work: (work_size(n),) work array that `prepare_pose` filled.
        wrenches: (k, 6) [N], [N m].
        tensions: (k, n) [N], filled.
        status: (k,) integers, filled.
    """
    n = int(work[CABLES])
    residual = spare_residual(work)
    status[:] = _TO_DO
    if n == 8 and work[STATE] == READY:
        _solve_plain(work, wrenches, tensions, status)
    for k in range(wrenches.shape[0]):
        if status[k] == _TO_DO:
            status[k] = solve_prepared(work, wrenches[k], tensions[k], residual)


@inlined
def _rig_views(work: FloatArray) -> tuple[Any, FloatArray]:
    """(n,) records of CABLE and structure matrix (6, n) of a rig's array."""
    n = int(work[CABLES])
    start = work_size(n)
    cables = work[start : start + CABLE_FLOATS * n].view(CABLE)
    return cables, work[at_structure(n) : at_structure(n) + 6 * n].reshape((6, n))


@inlined
def solve_unprepared(
    work: FloatArray,
    A: FloatArray,
    low: FloatArray,
    high: FloatArray,
    wrench: FloatArray,
    tension_out: FloatArray,
    residual_out: FloatArray,
) -> int:
    """`solve_prepared` where the structure matrix and limits in `work` are new.

    Args:
        work: work array with number of cables, structure matrix, ordered limits and weights in
            their places.
        A: (6, n) view of the structure matrix in it.
        low: (n,) view of the lower limits in it [N].
        high: (n,) view of the upper limits in it [N].
        wrench: (6,) [N], [N m], base axes.
        tension_out: (n,) tensions [N], inside the limits.
        residual_out: (6,) A @ tension_out - wrench.

    Returns:
        Status as `solve_prepared`.
    """
    n = int(work[CABLES])
    work[LOSS] = 0.0
    if not (n == 8 and solve_pose_eight(work, low, high, wrench, tension_out)):
        prepare_pose(A, low, high, work[at_weights(n) : at_weights(n) + 6], work)
        return solve_prepared(work, wrench, tension_out, residual_out)
    for row in range(6):
        total = -wrench[row]
        for i in range(8):
            total += A[row, i] * tension_out[i]
        residual_out[row] = total
    return FEASIBLE


@inlined
def solve_at_pose(
    work: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    wrench: FloatArray,
    tension_out: FloatArray,
    residual_out: FloatArray,
) -> int:
    """`solve_prepared` at a new pose, structure matrix included.

    Args:
        work: (rig_work_size(n),) work array of a rig: number of cables, limits and weights in
            their places, its cables' records at the end. No pose is ready in it afterwards.
        position: (3,) platform origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
        wrench: (6,) [N], [N m], base axes.
        tension_out: (n,) tensions [N], inside the limits.
        residual_out: (6,) A @ tension_out - wrench.

    Returns:
        Status as `solve_prepared`.
    """
    n = int(work[CABLES])
    limits = at_limits(n)
    low, high = work[limits : limits + n], work[limits + n : limits + 2 * n]
    cables, A = _rig_views(work)
    structure_matrix_into(cables, position, rotation, A)
    return solve_unprepared(work, A, low, high, wrench, tension_out, residual_out)


@compiled
def solve_pose_batch(
    work: FloatArray,
    positions: FloatArray,
    rotations: FloatArray,
    wrenches: FloatArray,
    tensions: FloatArray,
    status: IntArray,
) -> None:
    """One wrench at each of many poses, structure matrices included.

    Args:
        work: (rig_work_size(n),) work array of a rig, as for `solve_at_pose`.
        positions: (k, 3) platform origins, base frame [m].
        rotations: (k, 3, 3) from platform to base axes.
        wrenches: (k, 6) [N], [N m], base axes.
        tensions: (k, n) [N], filled.
        status: (k,) integers, filled.
    """
    n = int(work[CABLES])
    residual = spare_residual(work)
    rig, A = _rig_views(work)
    # Arrays of their own: what lies in the work array is loaded anew after every store there.
    rig = rig.copy()
    limits, weights = at_limits(n), work[at_weights(n) : at_weights(n) + 6].copy()
    low, high = work[limits : limits + n].copy(), work[limits + n : limits + 2 * n].copy()
    for k in range(wrenches.shape[0]):
        structure_matrix_into(rig, positions[k], rotations[k], A)
        if n == 8 and solve_pose_eight(work, low, high, wrenches[k], tensions[k]):
            status[k] = FEASIBLE
        else:
            prepare_pose(A, low, high, weights, work)
            status[k] = solve_prepared(work, wrenches[k], tensions[k], residual)
