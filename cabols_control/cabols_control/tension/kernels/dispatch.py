"""Compiled entries: one wrench, many wrenches, many poses. No allocation, no exception."""

from __future__ import annotations

from cabols_control.cable_kernels import structure_matrix_into
from cabols_control.tension.solution import FEASIBLE, INFEASIBLE, INVALID, FloatArray, IntArray, Six

from .basis import prepare_pose
from .eight_cables import solve_fixed_eight, solve_pose_eight
from .faces import choose_on_face, choose_on_line
from .general import least_norm
from .nearest import CHOOSE, DESCEND, NOTHING, descend, nearest_from_conflict, start_from_limits
from .plane import pseudo_inverse_tension, solve_line, solve_plane, solve_point
from .static_size import EIGHT, Size, cables, compiled
from .work_array import (
    CABLES,
    DEFICIENT,
    GRAM_MAX,
    ITERATIONS,
    READY,
    SCALE,
    STATE,
    at_basis,
    at_limits,
    at_structure,
    at_vector,
    at_weights,
)

LARGEST_WRENCH = 1e100
"""Components beyond this count as not finite: their squares would overflow."""
DEFICIENT_TOLERANCE = 1e-11
"""Rank-deficient A: the wrench is reached if the weighted residual is below this, relative."""
_TO_DO = -1
_DETECT, _DETECT_RESIDUAL = 16, 17  # scratch vectors


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
def _within_limits(work: FloatArray, n: int, tension: FloatArray) -> bool:
    """Least-norm tensions in place of t0; True if feasible. Rank 6, n other than 8."""
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
def clip_and_subtract(
    work: FloatArray,
    size: Size,
    wrench: FloatArray,
    tension_out: FloatArray,
    residual_out: FloatArray,
) -> float:
    """Take rounding off the limits, fill the residual A t - w; its largest weighted entry."""
    n = cables(size)
    limits, structure, weights = at_limits(n), at_structure(n), at_weights(n)
    for i in range(n):
        tension_out[i] = min(max(tension_out[i], work[limits + i]), work[limits + n + i])
    largest = 0.0
    for k in range(6):
        even, odd = -wrench[k], 0.0
        row = structure + k * n
        for i in range(0, n - 1, 2):
            even += work[row + i] * tension_out[i]
            odd += work[row + i + 1] * tension_out[i + 1]
        if n % 2 == 1:
            even += work[row + n - 1] * tension_out[n - 1]
        residual_out[k] = even + odd
        largest = max(largest, abs(even + odd) * work[weights + k])
    return largest


@compiled
def _reached(work: FloatArray, target: Six, largest: float) -> bool:
    """Whether a rank-deficient pose reaches the wrench: by the residual."""
    span = work[GRAM_MAX] ** 0.5 * work[SCALE]
    for value in target:
        span = max(span, abs(value))
    return bool(work[STATE] == DEFICIENT and largest <= DEFICIENT_TOLERANCE * span)


@compiled
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
    target = _scaled_wrench(work, n, wrench)
    ready = work[STATE] == READY
    todo = DESCEND
    if ready and n == 8:
        if solve_fixed_eight(work, wrench, tension_out):
            clip_and_subtract(work, EIGHT, wrench, tension_out, residual_out)
            return FEASIBLE
        pseudo_inverse_tension(work, EIGHT, target, tension_out)
        if solve_plane(work, EIGHT, tension_out):
            clip_and_subtract(work, EIGHT, wrench, tension_out, residual_out)
            return FEASIBLE
        todo = nearest_from_conflict(work, EIGHT, target, tension_out)
        if todo == NOTHING:
            clip_and_subtract(work, EIGHT, wrench, tension_out, residual_out)
            return INFEASIBLE
    else:
        if ready:
            pseudo_inverse_tension(work, n, target, tension_out)
            if _within_limits(work, n, tension_out):
                clip_and_subtract(work, n, wrench, tension_out, residual_out)
                return FEASIBLE
        start_from_limits(work, n, tension_out)
    if todo == DESCEND:
        todo = descend(work, n, target, tension_out)
    if todo == CHOOSE and not (ready and n == 8 and choose_on_line(work, n, tension_out)):
        choose_on_face(work, n, tension_out)
    largest = clip_and_subtract(work, n, wrench, tension_out, residual_out)
    return FEASIBLE if _reached(work, target, largest) else INFEASIBLE


@compiled
def detect_prepared(work: FloatArray, wrench: FloatArray) -> int:
    """Status alone, as `solve_prepared` gives it, without the nearest wrench where rank is 6."""
    n = int(work[CABLES])
    if not _usable(work, wrench):
        return INVALID
    tension = work[at_vector(n, _DETECT) : at_vector(n, _DETECT) + n]
    if work[STATE] == DEFICIENT:
        residual = work[at_vector(n, _DETECT_RESIDUAL) : at_vector(n, _DETECT_RESIDUAL) + 6]
        return solve_prepared(work, wrench, tension, residual)
    if n == 8:
        pseudo_inverse_tension(work, EIGHT, _scaled_wrench(work, EIGHT, wrench), tension)
        return FEASIBLE if solve_plane(work, EIGHT, tension) else INFEASIBLE
    pseudo_inverse_tension(work, n, _scaled_wrench(work, n, wrench), tension)
    return FEASIBLE if _within_limits(work, n, tension) else INFEASIBLE


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
    residual = work[at_vector(n, _DETECT_RESIDUAL) : at_vector(n, _DETECT_RESIDUAL) + 6]
    status[:] = _TO_DO
    if n == 8 and work[STATE] == READY:
        _solve_plain(work, wrenches, tensions, status)
    for k in range(wrenches.shape[0]):
        if status[k] == _TO_DO:
            status[k] = solve_prepared(work, wrenches[k], tensions[k], residual)


@compiled
def solve_pose_batch(
    work: FloatArray,
    base_points: FloatArray,
    platform_points: FloatArray,
    positions: FloatArray,
    rotations: FloatArray,
    wrenches: FloatArray,
    tension_min: FloatArray,
    tension_max: FloatArray,
    weights: FloatArray,
    tensions: FloatArray,
    status: IntArray,
) -> None:
    """One wrench at each of many poses, structure matrices included.

    Args:
        work: (work_size(n),) work array, overwritten; no pose is ready in it afterwards.
        base_points: (n, 3) A_i, base frame [m].
        platform_points: (n, 3) b_i, platform frame [m].
        positions: (k, 3) platform origins, base frame [m].
        rotations: (k, 3, 3) from platform to base axes.
        wrenches: (k, 6) [N], [N m], base axes.
        tension_min: (n,) [N].
        tension_max: (n,) [N].
        weights: (6,) of the nearest wrench.
        tensions: (k, n) [N], filled.
        status: (k,) integers, filled.
    """
    n = base_points.shape[0]
    work[CABLES] = n
    A = work[at_structure(n) : at_structure(n) + 6 * n].reshape((6, n))
    residual = work[at_vector(n, _DETECT_RESIDUAL) : at_vector(n, _DETECT_RESIDUAL) + 6]
    for k in range(wrenches.shape[0]):
        structure_matrix_into(base_points, platform_points, positions[k], rotations[k], A)
        if n == 8 and solve_pose_eight(work, tension_min, tension_max, wrenches[k], tensions[k]):
            status[k] = FEASIBLE
            continue
        prepare_pose(A, tension_min, tension_max, weights, work)
        status[k] = solve_prepared(work, wrenches[k], tensions[k], residual)
