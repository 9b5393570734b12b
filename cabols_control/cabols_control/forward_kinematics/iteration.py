# SPDX-License-Identifier: Apache-2.0
"""Gauss-Newton for the pose whose cables have given lengths, damped where it has to be; compiled.

The lengths' derivative along a motion (v, omega) is -A^T (v, omega) (`cabols_control.kinematics`),
so a step solves (A Q A^T) step = -A Q (given - computed lengths) with Q the inverse variances, and
(A Q A^T)^-1 is the covariance of the pose. Damping after Levenberg (1944) and Marquardt (1963).
"""

from __future__ import annotations

import math
from typing import Any

from cabols_control.cable_kernels import cable_lengths_into, structure_matrix_into
from cabols_control.checks import FloatArray
from cabols_control.tension.kernels.static_size import compiled

MOST_STEPS = 40
SMALL_STEP = 1e-5
"""Relative to the scale. A step this small leaves its square: 1e-10 of the scale."""
SINGULAR = 1e-13
"""Share of a diagonal element that is left of it where a direction is not seen by the lengths."""


@compiled
def turned(rotation: FloatArray, x: float, y: float, z: float, out: FloatArray) -> None:
    """Write exp(vector) rotation into out; Rodrigues.

    Args:
        rotation: (3, 3).
        x: of the rotation vector [rad].
        y: likewise.
        z: likewise.
        out: (3, 3), another array than rotation; filled.
    """
    angle2 = x * x + y * y + z * z
    if angle2 > 1e-12:
        angle = math.sqrt(angle2)
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    else:
        a, b = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    for j in range(3):
        p, q, r = rotation[0, j], rotation[1, j], rotation[2, j]
        cx, cy, cz = y * r - z * q, z * p - x * r, x * q - y * p
        dx, dy, dz = y * cz - z * cy, z * cx - x * cz, x * cy - y * cx
        out[0, j] = p + a * cx + b * dx
        out[1, j] = q + a * cy + b * dy
        out[2, j] = r + a * cz + b * dz


@compiled
def look(
    cables: Any,
    task: Any,
    lengths: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    work: Any,
) -> float:
    """Fill structure matrix and residual of a pose.

    Args:
        cables: (n,) records of CABLE.
        task: record of POSE_TASK.
        lengths: (n,) given [m].
        position: (3,) base frame [m].
        rotation: (3, 3) from platform to base axes.
        work: record of POSE_WORK.

    Returns:
        Weighted sum of the squared residuals; NaN where a cable has no length.
    """
    matrix, residual, information = work.matrix, work.residual, task.information
    structure_matrix_into(cables, position, rotation, matrix)
    cable_lengths_into(cables, position, rotation, residual)
    cost = 0.0
    for i in range(task.cables):
        # A cable without length has no direction: NaN, which fails.
        error = lengths[i] - residual[i] + 0.0 * matrix[0, i]
        residual[i] = error
        cost += information[i] * error * error
    return cost


@compiled
def factor(task: Any, work: Any, damping: float) -> bool:
    """Cholesky factor of A Q A^T, its diagonal times 1 + damping, into `normal`'s lower half.

    Args:
        task: record of POSE_TASK.
        work: record of POSE_WORK; on the factor's diagonal stand the inverses.
        damping: share by which the diagonal grows.

    Returns:
        False where a direction is not seen.
    """
    directions, information, matrix, normal = (
        task.directions,
        task.information,
        work.matrix,
        work.normal,
    )
    for a in range(task.freedom):
        row_a = directions[a]
        for b in range(a + 1):
            row_b, value = directions[b], 0.0
            for i in range(task.cables):
                value += matrix[row_a, i] * information[i] * matrix[row_b, i]
            if a == b:
                value *= 1.0 + damping
            diagonal = value
            for k in range(b):
                value -= normal[a, k] * normal[b, k]
            if a == b:
                if not value > SINGULAR * diagonal:
                    return False
                normal[a, a] = 1.0 / math.sqrt(value)
            else:
                normal[a, b] = value * normal[b, b]
    return True


@compiled
def solve_factored(m: int, normal: FloatArray, vector: FloatArray) -> None:
    """Solve in place with the factor that `factor` left.

    Args:
        m: size.
        normal: (m, m) or larger, factor.
        vector: (m,) or longer, right side, then solution.
    """
    for a in range(m):
        value = vector[a]
        for k in range(a):
            value -= normal[a, k] * vector[k]
        vector[a] = value * normal[a, a]
    for a in range(m - 1, -1, -1):
        value = vector[a]
        for k in range(a + 1, m):
            value -= normal[k, a] * vector[k]
        vector[a] = value * normal[a, a]


@compiled
def _propose(task: Any, work: Any) -> float:
    """Step from the factor, and the pose there as trial; the step's size, scaled [m]."""
    directions, information, matrix, residual, step, move = (
        task.directions,
        task.information,
        work.matrix,
        work.residual,
        work.step,
        work.move,
    )
    m = task.freedom
    for a in range(m):
        value, row = 0.0, directions[a]
        for i in range(task.cables):
            value -= matrix[row, i] * information[i] * residual[i]
        step[a] = value
    solve_factored(m, work.normal, step)
    for k in range(6):
        move[k] = 0.0
    for a in range(m):
        move[directions[a]] = step[a]
    turn = move[3:]
    turn2 = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]
    if turn2 > 1.0:
        shorter = 1.0 / math.sqrt(turn2)
        for k in range(3):
            turn[k] *= shorter
        turn2 = 1.0
    shift2, position, trial = 0.0, work.position, work.trial_position
    for k in range(3):
        trial[k] = position[k] + move[k]
        shift2 += move[k] * move[k]
    turned(work.rotation, turn[0], turn[1], turn[2], work.trial_rotation)
    return math.sqrt(shift2 + task.scale * task.scale * turn2)


@compiled
def copy_pose(
    position: FloatArray, rotation: FloatArray, to_position: FloatArray, to_rotation: FloatArray
) -> None:
    """Copy a pose.

    Args:
        position: (3,).
        rotation: (3, 3).
        to_position: (3,), filled.
        to_rotation: (3, 3), filled.
    """
    for k in range(3):
        to_position[k] = position[k]
        for j in range(3):
            to_rotation[k, j] = rotation[k, j]


@compiled
def _take(task: Any, work: Any) -> None:
    """Make the trial, a tiny step away, the pose; the residual moves with it."""
    copy_pose(work.trial_position, work.trial_rotation, work.position, work.rotation)
    residual, matrix, move = work.residual, work.matrix, work.move
    for i in range(task.cables):
        value = residual[i]
        for k in range(6):
            value += matrix[k, i] * move[k]
        residual[i] = value


@compiled
def iterate(cables: Any, task: Any, lengths: FloatArray, work: Any) -> int:
    """Improve the pose in `work` until its steps are small.

    Args:
        cables: (n,) records of CABLE.
        task: record of POSE_TASK.
        lengths: (n,) given [m].
        work: record of POSE_WORK; `position` and `rotation`: start, then the answer. Matrix and
            factor are those of the pose before the last, tiny step, which moved the residual.

    Returns:
        Number of steps; 0 where it did not converge.
    """
    damping, smallest = 0.0, SMALL_STEP * task.scale
    cost = look(cables, task, lengths, work.position, work.rotation, work)
    for count in range(1, MOST_STEPS + 1):
        if not cost < math.inf:
            return 0
        if not factor(task, work, damping):
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e8:
                return 0
            continue
        size = _propose(task, work)
        if size < smallest and damping < 1e-3:
            _take(task, work)
            if damping > 0.0 and not factor(task, work, 0.0):
                return 0
            return count
        found = look(cables, task, lengths, work.trial_position, work.trial_rotation, work)
        if found < cost or size < smallest:
            cost, damping = found, 0.1 * damping if damping > 1e-7 else 0.0
            copy_pose(work.trial_position, work.trial_rotation, work.position, work.rotation)
        else:
            damping = max(10.0 * damping, 1e-4)
            if damping > 1e8:
                return 0
            look(cables, task, lengths, work.position, work.rotation, work)
    return 0


@compiled
def invert(task: Any, work: Any) -> None:
    """Fill `inverse`: change of the pose for changes of the lengths, from the factor.

    Args:
        task: record of POSE_TASK.
        work: record of POSE_WORK.
    """
    directions, information, matrix = task.directions, task.information, work.matrix
    normal, inverse = work.normal, work.inverse
    m, n = task.freedom, task.cables
    for a in range(m):
        row = directions[a]
        for i in range(n):
            inverse[a, i] = -matrix[row, i] * information[i]
        for k in range(a):
            share = normal[a, k]
            for i in range(n):
                inverse[a, i] -= share * inverse[k, i]
        for i in range(n):
            inverse[a, i] *= normal[a, a]
    for a in range(m - 1, -1, -1):
        for k in range(a + 1, m):
            share = normal[k, a]
            for i in range(n):
                inverse[a, i] -= share * inverse[k, i]
        for i in range(n):
            inverse[a, i] *= normal[a, a]


@compiled
def covariance_into(task: Any, work: Any, covariance: FloatArray) -> None:
    """Fill the covariance of the pose from the factor; zero along what cannot move.

    Args:
        task: record of POSE_TASK.
        work: record of POSE_WORK.
        covariance: (6, 6) of position [m] and rotation vector [rad], base axes; filled.
    """
    directions, step, normal = task.directions, work.step, work.normal
    m = task.freedom
    for a in range(6):
        for b in range(6):
            covariance[a, b] = 0.0
    for a in range(m):
        for b in range(m):
            step[b] = 1.0 if a == b else 0.0
        solve_factored(m, normal, step)
        for b in range(m):
            covariance[directions[a], directions[b]] = step[b]
