"""Gauss-Newton for the pose whose cables have given lengths, damped where it has to be; compiled.

The lengths' derivative along a motion (v, omega) is -A^T (v, omega) (`cabols_control.kinematics`),
so a step solves (A Q A^T) step = -A Q (given - computed lengths) with Q the inverse variances, and
(A Q A^T)^-1 is the covariance of the pose. Damping after Levenberg (1944) and Marquardt (1963).
"""

from __future__ import annotations

import math

from cabols_control.cable_kernels import cable_lengths_into, structure_matrix_into
from cabols_control.checks import FloatArray
from cabols_control.tension.kernels.static_size import compiled

from .task import PoseTask, PoseWork

MOST_STEPS = 40
SMALL_STEP = 1e-5
"""Relative to the scale. A step this small leaves its square: 1e-10 of the scale."""
SINGULAR = 1e-13
"""Share of a diagonal element that is left of it where a direction is not seen by the lengths."""


@compiled
def turned(rotation: FloatArray, x: float, y: float, z: float, out: FloatArray) -> None:
    """Write exp(vector) rotation into out (3, 3), which is not rotation; Rodrigues."""
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
    task: PoseTask,
    lengths: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    matrix: FloatArray,
    residual: FloatArray,
) -> float:
    """Fill structure matrix (6, n) and residual (n,) of a pose; weighted sum of its squares."""
    cables, information = task.cables, task.information
    structure_matrix_into(cables, position, rotation, matrix)
    cable_lengths_into(cables, position, rotation, residual)
    cost = 0.0
    for i in range(lengths.shape[0]):
        # A cable without length has no direction: NaN, which fails.
        error = lengths[i] - residual[i] + 0.0 * matrix[0, i]
        residual[i] = error
        cost += information[i] * error * error
    return cost


@compiled
def factor(task: PoseTask, work: PoseWork, damping: float) -> bool:
    """Cholesky factor of A Q A^T, its diagonal times 1 + damping, into `normal`'s lower half.

    Its diagonal holds the inverse of the factor's. False where a direction is not seen.
    """
    directions, information, normal, matrix = (
        task.directions,
        task.information,
        work.normal,
        work.matrix,
    )
    m, n = directions.shape[0], information.shape[0]
    for a in range(m):
        row_a = directions[a]
        for b in range(a + 1):
            row_b = directions[b]
            value = 0.0
            for i in range(n):
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
def solve_factored(normal: FloatArray, vector: FloatArray) -> None:
    """Solve in place with the factor that `factor` left: vector (m,)."""
    m = vector.shape[0]
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
def _propose(task: PoseTask, work: PoseWork) -> float:
    """Step from the factor into `step` and the pose there into `trial`; its size, scaled [m]."""
    directions, information, matrix, residual, step, move = (
        task.directions,
        task.information,
        work.matrix,
        work.residual,
        work.step,
        work.move,
    )
    for a in range(directions.shape[0]):
        value, row = 0.0, directions[a]
        for i in range(information.shape[0]):
            value -= matrix[row, i] * information[i] * residual[i]
        step[a] = value
    solve_factored(work.normal, step)
    move[:] = 0.0
    for a in range(directions.shape[0]):
        move[directions[a]] = step[a]
    turn2 = move[3] * move[3] + move[4] * move[4] + move[5] * move[5]
    if turn2 > 1.0:
        move[3:] /= math.sqrt(turn2)
        turn2 = 1.0
    shift2 = 0.0
    for k in range(3):
        work.trial_position[k] = work.position[k] + move[k]
        shift2 += move[k] * move[k]
    turned(work.rotation, move[3], move[4], move[5], work.trial_rotation)
    return math.sqrt(shift2 + task.scale * task.scale * turn2)


@compiled
def _accept(work: PoseWork) -> None:
    """Make the trial the pose."""
    position, rotation = work.position, work.rotation
    other, turn = work.trial_position, work.trial_rotation
    for k in range(3):
        position[k] = other[k]
        for j in range(3):
            rotation[k, j] = turn[k, j]


@compiled
def _take(work: PoseWork) -> None:
    """Make the trial, a tiny step away, the pose; the residual moves with it."""
    _accept(work)
    residual, matrix, move = work.residual, work.matrix, work.move
    for i in range(residual.shape[0]):
        value = residual[i]
        for k in range(6):
            value += matrix[k, i] * move[k]
        residual[i] = value


@compiled
def iterate(task: PoseTask, lengths: FloatArray, work: PoseWork) -> int:
    """Improve the pose in `work` until its steps are small.

    Args:
        task: what is asked.
        lengths: (n,) of the cables, between their points [m].
        work: `position` and `rotation`: start, then the answer; residual, matrix and the factor in
            `normal` are those of the pose before the last, tiny step, the residual moved with it.

    Returns:
        Number of steps; 0 where it did not converge.
    """
    damping = 0.0
    cost = look(task, lengths, work.position, work.rotation, work.matrix, work.residual)
    for count in range(1, MOST_STEPS + 1):
        if not cost < math.inf or not factor(task, work, damping):
            damping = max(10.0 * damping, 1e-6)
            if not cost < math.inf or damping > 1e8:
                return 0
            continue
        size = _propose(task, work)
        if size < SMALL_STEP * task.scale and damping < 1e-3:
            _take(work)
            if damping > 0.0 and not factor(task, work, 0.0):
                return 0
            return count
        found = look(
            task, lengths, work.trial_position, work.trial_rotation, work.matrix, work.residual
        )
        if found < cost or size < SMALL_STEP * task.scale:
            cost, damping = found, 0.1 * damping if damping > 1e-7 else 0.0
            _accept(work)
        else:
            damping = max(10.0 * damping, 1e-4)
            if damping > 1e8:
                return 0
            look(task, lengths, work.position, work.rotation, work.matrix, work.residual)
    return 0


@compiled
def invert(task: PoseTask, work: PoseWork) -> None:
    """Fill `inverse` (m, n): change of the pose for changes of the lengths, from the factor."""
    directions, information, matrix = task.directions, task.information, work.matrix
    normal, inverse = work.normal, work.inverse
    m, n = directions.shape[0], information.shape[0]
    for a in range(m):
        row = directions[a]
        for i in range(n):
            inverse[a, i] = -matrix[row, i] * information[i]
    for a in range(m):
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
def covariance_into(task: PoseTask, work: PoseWork, covariance: FloatArray) -> None:
    """Fill the covariance (6, 6) from the factor: position [m], rotation vector [rad], base axes.

    Zero along what the platform cannot move.
    """
    directions, step, normal = task.directions, work.step, work.normal
    m = directions.shape[0]
    covariance[:, :] = 0.0
    for a in range(m):
        for b in range(m):
            step[b] = 1.0 if a == b else 0.0
        solve_factored(normal, step)
        for b in range(m):
            covariance[directions[a], directions[b]] = step[b]
