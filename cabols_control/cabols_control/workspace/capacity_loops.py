# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over poses: the structure matrix, what is held, and the pose's capacity."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.cable_kernels import (
    MIN_CABLE_LENGTH_M,
    cable_lengths_into,
    structure_matrix_into,
)
from cabols_control.checks import FloatArray
from cabols_control.tension import work_size
from cabols_control.tension.kernels.static_size import compiled

from .facet_result import worst_result
from .hyperplanes import capacity_at, capacity_of_matrix


@compiled
def to_platform_axes(matrix: FloatArray, rotation: FloatArray) -> None:
    """Turn the columns of a structure matrix from base to platform axes, in place.

    Args:
        matrix: (6, n), changed.
        rotation: (3, 3) from platform to base axes.
    """
    for i in range(matrix.shape[1]):
        for part in range(2):
            x, y, z = matrix[3 * part, i], matrix[3 * part + 1, i], matrix[3 * part + 2, i]
            for k in range(3):
                turned = rotation[0, k] * x + rotation[1, k] * y + rotation[2, k] * z
                matrix[3 * part + k, i] = turned


@compiled
def _held_wrench(task: Any, rotation: FloatArray, held: FloatArray) -> None:
    """Constant part of the required set at an orientation, times the weights, in its axes."""
    r = task.centre_of_mass
    x = rotation[0, 0] * r[0] + rotation[0, 1] * r[1] + rotation[0, 2] * r[2]
    y = rotation[1, 0] * r[0] + rotation[1, 1] * r[1] + rotation[1, 2] * r[2]
    base = np.empty(6)
    # A weight along -z at (x, y, .) is to be carried: a force along z and its torque.
    carried = (0.0, 0.0, 1.0, y, -x, 0.0)
    for k in range(6):
        base[k] = task.held[k] + carried[k] * task.weight
    for part in range(2):
        for k in range(3):
            value = base[3 * part + k]
            if task.platform_axes:
                value = 0.0
                for i in range(3):
                    value += rotation[i, k] * base[3 * part + i]
            held[3 * part + k] = task.weights[3 * part + k] * value


@compiled
def _reaches(task: Any, position: FloatArray, rotation: FloatArray, lengths: FloatArray) -> bool:
    """Whether every cable's length is within its limits; lengths (n,) is filled [m]."""
    cable_lengths_into(task.cables, position, rotation, lengths)
    return bool((task.shortest <= lengths).all() and (lengths <= task.longest).all())


@compiled
def capacity_loop(
    task: Any,
    positions: FloatArray,
    rotations: FloatArray,
    scratch: FloatArray,
    normals: FloatArray,
    results: FloatArray,
) -> None:
    """Fill results (k, o, RESULTS) for every position (k, 3) with every rotation (o, 3, 3).

    Args:
        task: CapacityTask of a platform that moves in space.
        positions: (k, 3) base frame [m].
        rotations: (o, 3, 3) from platform to base axes.
        scratch: of capacity_scratch.
        normals: of capacity_scratch.
        results: filled.
    """
    n = task.cables.shape[0]
    vectors = task.points.shape[0] + task.generators.shape[0] + n
    work = scratch[: work_size(n)]
    start = work_size(n)
    products = scratch[start : start + n * vectors].reshape((n, vectors))
    start += n * vectors
    matrix = scratch[start : start + 6 * n].reshape((6, n))
    scaled = scratch[start + 6 * n : start + 12 * n].reshape((6, n))
    held, lengths = np.zeros(6), np.empty(n)
    bounded = task.shortest > MIN_CABLE_LENGTH_M or task.longest < np.inf
    for k in range(positions.shape[0]):
        for o in range(rotations.shape[0]):
            structure_matrix_into(task.cables, positions[k], rotations[o], matrix)
            if task.platform_axes:
                to_platform_axes(matrix, rotations[o])
            if task.holds:
                _held_wrench(task, rotations[o], held)
            if bounded and not _reaches(task, positions[k], rotations[o], lengths):
                worst_result(results[k, o])
                continue
            capacity_at(task, matrix, work, products, normals, scaled, held, results[k, o])


@compiled
def capacity_loop_of_part(
    task: Any,
    positions: FloatArray,
    rotations: FloatArray,
    scratch: FloatArray,
    normals: FloatArray,
    results: FloatArray,
) -> None:
    """As capacity_loop, for a platform that moves less: only `directions` of a wrench count.

    Args:
        task: CapacityTask.
        positions: (k, 3) base frame [m].
        rotations: (o, 3, 3) from platform to base axes.
        scratch: of capacity_scratch.
        normals: of capacity_scratch.
        results: filled.
    """
    n, m = task.cables.shape[0], task.directions.shape[0]
    matrix = scratch[: 6 * n].reshape((6, n))
    part = scratch[6 * n : (6 + m) * n].reshape((m, n))
    lengths, held, part_held = np.empty(n), np.zeros(6), np.empty(m)
    points = np.empty((task.points.shape[0], m))
    generators = np.empty((task.generators.shape[0], m))
    for a in range(m):
        points[:, a] = task.points[:, task.directions[a]]
        generators[:, a] = task.generators[:, task.directions[a]]
    for k in range(positions.shape[0]):
        for o in range(rotations.shape[0]):
            structure_matrix_into(task.cables, positions[k], rotations[o], matrix)
            if task.platform_axes:
                to_platform_axes(matrix, rotations[o])
            if task.holds:
                _held_wrench(task, rotations[o], held)
            for a in range(m):
                row = task.directions[a]
                part_held[a] = held[row]
                for i in range(n):
                    part[a, i] = task.weights[row] * matrix[row, i]
            if not _reaches(task, positions[k], rotations[o], lengths) or not np.all(
                np.isfinite(part)
            ):
                worst_result(results[k, o])
                continue
            capacity_of_matrix(
                part, task.low, task.high, part_held, points, generators, normals, results[k, o]
            )
