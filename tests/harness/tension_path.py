# SPDX-License-Identifier: Apache-2.0
"""A loop through the workspace, with a wrench that varies, for comparing tension methods."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.kinematics import structure_matrix
from cabols_control.tension import (
    DEFAULT_WEIGHTS,
    choose_prepared,
    prepare_pose,
    set_method,
    work_size,
)

BOX = np.array([94.0, 94.0, 94.0, 9.4, 9.4, 9.4])
"""What the reference bench can give at its reference pose, all six at once [N, N m]."""


def path(geometry, count):
    """Positions, rotations and wrenches of `count` samples, all feasible for the bench."""
    s = np.linspace(0.0, 2.0 * np.pi, count)
    circle = np.column_stack([0.15 * np.cos(s), 0.15 * np.sin(s), 0.1 * np.sin(2 * s)])
    turns = np.column_stack([12 * np.sin(s), 12 * np.cos(2 * s), 10 * np.sin(3 * s)])
    rotations = Rotation.from_euler("XYZ", turns, degrees=True).as_matrix()
    phases = np.array([0.0, 0.7, 1.9, 2.3, 3.1, 4.4])
    wrenches = 0.35 * BOX * np.sin(np.outer(s, [1, 2, 3, 2, 1, 3]) + phases)
    return geometry.reference_position + circle, rotations, wrenches


def tensions_along(geometry, method, count, low, high):
    """(count, 8) tensions of a method along the path, and the worst residual [N, N m]."""
    work, residual, worst = np.zeros(work_size(8)), np.zeros(6), 0.0
    set_method(work, 8, method)
    limits = (np.full(8, low), np.full(8, high))
    tensions = np.zeros((count, 8))
    for k, (position, rotation, wrench) in enumerate(zip(*path(geometry, count), strict=True)):
        matrix = structure_matrix(geometry, position, rotation)
        prepare_pose(matrix, *limits, np.array(DEFAULT_WEIGHTS), work)
        assert choose_prepared(work, wrench, tensions[k], residual) == 0
        worst = max(worst, float(np.abs(matrix @ tensions[k] - wrench).max()))
    return tensions, worst


def largest_jump(tensions):
    """Largest change of one tension between neighbours [N]."""
    return float(np.abs(np.diff(tensions, axis=0)).max())
