# SPDX-License-Identifier: Apache-2.0
"""Rotations against numpy's cross product and scipy; what is no pose is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.rotations import cross_matrix, read_pose


@pytest.mark.parametrize("shape", [(3,), (5, 3), (2, 4, 3)])
def test_cross_matrix_is_the_cross_product(random, shape):
    v, x = random.normal(size=shape), random.normal(size=3)
    np.testing.assert_allclose(cross_matrix(v) @ x, np.cross(v, x), atol=1e-14)


def test_a_pose_is_split(random):
    turn = Rotation.random(random_state=3)
    position, rotation = read_pose(np.concatenate([[1.0, 2.0, 3.0], turn.as_quat()]))
    np.testing.assert_allclose(position, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(rotation, turn.as_matrix(), atol=1e-15)


@pytest.mark.parametrize("index", range(7))
def test_a_pose_with_nan_is_refused(index):
    pose = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    pose[index] = np.nan
    assert read_pose(pose) is None


@pytest.mark.parametrize("length", [0.0, 0.99, 1.01, np.inf])
def test_a_quaternion_of_another_length_is_refused(length):
    assert read_pose(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, length])) is None
