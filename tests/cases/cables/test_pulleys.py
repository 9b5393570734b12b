# SPDX-License-Identifier: Apache-2.0
"""The bench's cables over swivel pulleys, axis vertical through the base point, by tangents.

Source: the usual pulley model; CASPR's base_rotating_pulley, fzoffoli/OCDPR_SelfCalibration.
"""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from cabols_control.configuration import read_yaml
from cabols_control.geometry import load_geometry
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.rig_folder import rig_file
from cases import outcome

KEY = "pulley_radius"
"""How geometry.yaml is to name the radius [m]; whoever builds it may choose another word here."""


def over_pulleys(geometry, position, rotation, radius):
    """(n,) lengths with the arcs [m] and (n, 3) directions from the platform to the tangents."""
    lengths, directions = [], []
    for base, point in zip(geometry.base_points, geometry.platform_points, strict=True):
        away = position + rotation @ point - base
        out = np.hypot(away[0], away[1])
        along = np.array([away[0] / out, away[1] / out, 0.0])
        up = 1.0 if away[2] < 0.0 else -1.0
        x, z = out - radius, -abs(away[2])
        reach = np.hypot(x, z)
        angle = np.arctan2(z, x) + np.arccos(radius / reach)
        lengths.append(np.sqrt(reach**2 - radius**2) + radius * (np.pi - angle))
        tangent = [radius + radius * np.cos(angle), radius * np.sin(angle)]
        free = np.array([out, z]) - tangent
        back = -(along * free[0] + np.array([0.0, 0.0, up]) * free[1])
        directions.append(back / np.linalg.norm(back))
    return np.array(lengths), np.array(directions)


@pytest.fixture(params=[0.01, 0.03, 0.05])
def radius(request):
    return request.param


def load(tmp_path, radius):
    """The bench over pulleys, as the project reads it; or the error."""
    file = tmp_path / "geometry.yaml"
    content = {**read_yaml(rig_file("geometry.yaml")), KEY: radius}
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return outcome(lambda: load_geometry(file))


def test_tangents_are_the_slope_of_the_lengths(radius):
    """The reference of these tests obeys virtual work itself."""
    bench, step = load_geometry(), 1e-6
    position = np.array(bench.reference_position)
    _, directions = over_pulleys(bench, position, np.eye(3), radius)
    for j in range(3):
        move = step * np.eye(3)[j]
        after, _ = over_pulleys(bench, position + move, np.eye(3), radius)
        before, _ = over_pulleys(bench, position - move, np.eye(3), radius)
        np.testing.assert_allclose((after - before) / (2 * step), -directions[:, j], atol=1e-8)


def test_lengths_hold_the_pulleys(tmp_path, radius):
    bench = load(tmp_path, radius)
    assert not isinstance(bench, Exception), bench
    start = np.array(bench.reference_position)
    length, _ = over_pulleys(bench, start, np.eye(3), radius)
    for move in 0.1 * np.eye(3):
        expected = over_pulleys(bench, start + move, np.eye(3), radius)[0] - length
        found = cable_lengths(bench, start + move, np.eye(3)) - cable_lengths(
            bench, start, np.eye(3)
        )
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_structure_matrix_holds_the_pulleys(tmp_path, radius):
    bench = load(tmp_path, radius)
    assert not isinstance(bench, Exception), bench
    _, directions = over_pulleys(bench, bench.reference_position, np.eye(3), radius)
    torque = np.cross(bench.platform_points, directions)
    found = structure_matrix(bench, bench.reference_position, np.eye(3))
    np.testing.assert_allclose(found, np.vstack([directions.T, torque.T]), atol=1e-9)
