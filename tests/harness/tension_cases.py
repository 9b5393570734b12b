# SPDX-License-Identifier: Apache-2.0
"""Structure matrices and wrenches for tests of the redundancy resolution."""

from __future__ import annotations

import numpy as np

from cabols_control.cable_kernels import cable_records, structure_matrix_into

LOW, HIGH = 1.0, 150.0
CENTRE = np.array([0.0, 1.234615, 0.792718])


def reference_points():
    """Reference geometry of docs/reference: corner swirl +1 -1 +1 -1 above, the opposite below."""
    base, platform = [], []
    for level, swirl in ((1.0, (1, -1, 1, -1)), (-1.0, (-1, 1, -1, 1))):
        for corner, s in zip((45.0, 135.0, 225.0, 315.0), swirl, strict=True):
            angle = np.deg2rad(corner)
            side = np.sign([np.cos(angle), np.sin(angle)])
            base.append([0.9 * side[0], 0.8 * side[1], 0.8 * level])
            angle = np.deg2rad(corner + 45.0 * s)
            platform.append([0.15 * np.cos(angle), 0.15 * np.sin(angle), -0.10 * level])
    return np.array(base) + CENTRE, np.array(platform)


def matrix_of(base, platform, position=CENTRE, rotation=None):
    A = np.empty((6, base.shape[0]))
    turn = np.eye(3) if rotation is None else rotation
    structure_matrix_into(cable_records(base, platform), position, turn, A)
    return A


REFERENCE = matrix_of(*reference_points())


def random_rig(rng, n=8):
    """A frame of about a metre, a platform of 0.1 to 0.3 m, cables from anywhere to anywhere."""
    corners = rng.choice([-1.0, 1.0], (n, 3)) * rng.uniform(0.4, 1.2, (n, 3))
    points = rng.uniform(-1.0, 1.0, (n, 3)) * rng.uniform(0.1, 0.3)
    return matrix_of(corners, points, rng.uniform(-0.2, 0.2, 3))


def boundary_wrench(rng, A, low, high):
    """A wrench exactly on the boundary of the feasible ones, and the outward unit normal there.

    Five random cables span a facet; the others sit at the limit that lies farthest out.
    """
    n = A.shape[1]
    facet = rng.choice(n, 5, replace=False)
    normal = np.linalg.svd(A[:, facet].T)[2][-1]
    tension = np.where(normal @ A > 0.0, high, low)
    tension[facet] = rng.uniform(low, high, 5)
    return A @ tension, normal
