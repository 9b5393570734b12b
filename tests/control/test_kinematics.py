# SPDX-License-Identifier: Apache-2.0
"""Kinematics against physics: virtual work, finite differences, frames."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from cabols_control.errors import ShapeError
from cabols_control.geometry import load_geometry
from cabols_control.kinematics import cable_lengths, structure_matrix

GEOMETRY = load_geometry()
small = st.floats(-0.2, 0.2)
vectors = arrays(np.float64, 3, elements=small)


@settings(max_examples=60)
@given(offset=vectors, angles=vectors, tension=arrays(np.float64, 8, elements=st.floats(0, 150)))
def test_virtual_work(offset, angles, tension):
    """Moving the platform along any twist, the wrench's work is what the cables lose in length."""
    position = GEOMETRY.reference_position + offset
    rotation = Rotation.from_rotvec(angles).as_matrix()
    wrench = structure_matrix(GEOMETRY, position, rotation) @ tension
    h = 1e-6
    for k in range(6):
        twist = np.zeros(6)
        twist[k] = h
        lengths = [
            cable_lengths(
                GEOMETRY,
                position + sign * twist[:3],
                Rotation.from_rotvec(sign * twist[3:]).as_matrix() @ rotation,
            )
            for sign in (1.0, -1.0)
        ]
        work = -tension @ (lengths[0] - lengths[1]) / (2.0 * h)
        # Central differences of lengths near 1.4 m: rounding 1e-16/1e-6, curvature 1e-12.
        assert work == pytest.approx(wrench[k], abs=1e-6 * (1.0 + tension.sum()))


def test_lengths_by_hand():
    lengths = cable_lengths(GEOMETRY, GEOMETRY.reference_position, np.eye(3))
    by_hand = [
        np.linalg.norm(a - GEOMETRY.reference_position - b)
        for a, b in zip(GEOMETRY.base_points, GEOMETRY.platform_points, strict=True)
    ]
    np.testing.assert_allclose(lengths, by_hand, rtol=1e-14)


def test_columns_are_unit_pulls_towards_the_frame():
    matrix = structure_matrix(GEOMETRY, GEOMETRY.reference_position, np.eye(3))
    np.testing.assert_allclose(np.linalg.norm(matrix[:3], axis=0), 1.0)
    # Upper cables pull up, lower ones down.
    assert (matrix[2, :4] > 0).all()
    assert (matrix[2, 4:] < 0).all()


@pytest.mark.parametrize(
    ("position", "rotation", "message"),
    [
        ([0.0, 0.0], np.eye(3), "position: expected shape"),
        ([0.0, np.nan, 0.0], np.eye(3), "position: expected finite"),
        ([0.0, 0.0, np.inf], np.eye(3), "position: expected finite"),
        ([0.0, 0.0, 0.0], np.eye(2), "rotation: expected shape"),
        ([0.0, 0.0, 0.0], 2.0 * np.eye(3), "rotation: expected a rotation"),
        ("here", np.eye(3), "position: expected numbers"),
    ],
)
@pytest.mark.parametrize("function", [cable_lengths, structure_matrix])
def test_bad_poses(function, position, rotation, message):
    with pytest.raises(ShapeError, match=message):
        function(GEOMETRY, position, rotation)
