# SPDX-License-Identifier: Apache-2.0
"""Tensions of poses that lie close together: the tracker's noise must not make them jump.

Facet changes are a theme of the papers on force distribution; inside the boundary there are none.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.geometry import load_geometry
from cabols_control.kinematics import structure_matrix
from cabols_control.tension import distribute
from cabols_control.workspace.capacity import capacity_along
from cabols_control.workspace.wrench_set import wrench_polytope

NOISE = (16e-6, 136e-6)
"""Of the tracker's pose: position [m], rotation [rad]."""
JUMP_N = 10.0
WRENCH = np.array([10.6956, -25.5055, -10.9573, -27.583, -31.5889, 5.01])
"""Not feasible at the bench's reference pose [N, N m]."""


@pytest.fixture(scope="module")
def bench():
    return load_geometry()


def tensions(bench, wrench, method, offsets):
    """(k, n) at the reference pose moved by each of the (k, 6) offsets."""
    found = []
    for offset in offsets:
        turn = Rotation.from_rotvec(offset[3:]).as_matrix()
        A = structure_matrix(bench, bench.reference_position + offset[:3], turn)
        found.append(distribute(A, wrench, 1.0, 150.0, method).tension)
    return np.array(found)


@pytest.fixture(scope="module")
def boundary(bench):
    """(60, 6) directions, and (60,) how far along each the wrench stays feasible."""
    directions = np.random.default_rng(0).standard_normal((60, 6))
    length = np.linalg.norm(directions * [1, 1, 1, 6.67, 6.67, 6.67], axis=1)
    directions /= length[:, None]
    at = bench.reference_position[None], np.eye(3)[None]
    ends = [
        capacity_along(bench, *at, 1, 150, wrench_polytope([np.zeros(6), d])).factor[0]
        for d in directions
    ]
    return directions, np.array(ends)


def largest_change(bench, boundary, share, method):
    """Largest change of any tension under the noise, over all directions [N]."""
    rng, (directions, ends) = np.random.default_rng(1), boundary
    changes = []
    for direction, end in zip(directions, ends, strict=True):
        offsets = rng.normal(0.0, 1.0, (8, 6)) * np.repeat(NOISE, 3)
        found = tensions(bench, share * end * direction, method, offsets)
        changes.append(np.ptp(found, axis=0).max())
    return max(changes)


@pytest.mark.parametrize("method", ["min_norm", "barycentre"])
def test_tensions_inside_the_boundary_do_not_jump(bench, boundary, method):
    assert largest_change(bench, boundary, 0.99, method) < 2.0


@pytest.mark.parametrize("method", ["min_norm", "barycentre"])
@pytest.mark.parametrize("share", [1.001, 1.1])
def test_tensions_beyond_the_boundary_do_not_jump(bench, boundary, method, share):
    assert largest_change(bench, boundary, share, method) < JUMP_N


def test_tensions_of_neighbouring_poses_are_neighbours(bench):
    offsets = np.random.default_rng(0).uniform(-1e-6, 1e-6, (60, 6))
    found = tensions(bench, WRENCH, "min_norm", offsets)
    assert np.ptp(found, axis=0).max() < JUMP_N
