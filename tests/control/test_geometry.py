# SPDX-License-Identifier: Apache-2.0
"""Geometry files: what is accepted, and what each mistake is answered with."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from cabols_control.errors import CabolsError, ConfigError, DegenerateGeometryError, ShapeError
from cabols_control.geometry import RigGeometry, load_geometry
from cabols_control.rig_folder import rig_file


@pytest.fixture
def content():
    return yaml.safe_load(rig_file("geometry.yaml").read_text())


def write(tmp_path, content):
    path = tmp_path / "rig.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return path


def test_reference_bench():
    geometry = load_geometry()
    assert geometry.cables == 8
    np.testing.assert_allclose(geometry.reference_position, [0.0, 1.234615, 0.792718])
    np.testing.assert_allclose(geometry.reference_rotation, np.eye(3))
    corners = geometry.base_points - geometry.reference_position
    np.testing.assert_allclose(np.abs(corners), np.tile([0.9, 0.8, 0.8], (8, 1)), atol=1e-9)
    radius = np.linalg.norm(geometry.platform_points[:, :2], axis=1)
    np.testing.assert_allclose(radius, 0.15)
    # Upper cables hold the lower side of the platform.
    np.testing.assert_allclose(np.sign(corners[:, 2]), -np.sign(geometry.platform_points[:, 2]))


def test_file_round_trip(tmp_path, content):
    loaded = load_geometry(write(tmp_path, content))
    np.testing.assert_array_equal(loaded.base_points, load_geometry().base_points)


def test_arrays_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        load_geometry().base_points[0, 0] = 1.0


def test_euler_angles_are_intrinsic_xyz(tmp_path, content):
    content["reference_pose"]["rotation_xyz_deg"] = [30.0, 20.0, 10.0]
    a, b, c = np.radians([30.0, 20.0, 10.0])
    rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    rz = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    loaded = load_geometry(write(tmp_path, content))
    np.testing.assert_allclose(loaded.reference_rotation, rx @ ry @ rz, atol=1e-12)


def spoil_unknown_key(content):
    content["base_point"] = content.pop("base_points")


def spoil_five_cables(content):
    content["base_points"] = content["base_points"][:5]
    content["platform_points"] = content["platform_points"][:5]


def spoil_row(content):
    content["base_points"][2] = [1.0, 2.0]


def spoil_nan(content):
    content["platform_points"][3][1] = float("nan")


def spoil_text(content):
    content["base_points"][0][0] = "left"


def spoil_count(content):
    content["platform_points"].append([0.0, 0.0, 0.1])


def spoil_pose(content):
    del content["reference_pose"]["position"]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (spoil_unknown_key, "base_point"),
        (spoil_five_cables, "at least 6 cables, got 5"),
        (spoil_row, r"base_points, cable 3: expected \[x, y, z\]"),
        (spoil_nan, r"platform_points: expected finite numbers, got nan at \[3, 1\]"),
        (spoil_text, r"base_points.*left"),
        (spoil_count, r"platform_points: expected shape \(8, 3\), got \(9, 3\)"),
        (spoil_pose, "reference_pose.position"),
    ],
)
def test_mistakes_name_file_and_key(tmp_path, content, spoil, message):
    spoil(content)
    path = write(tmp_path, content)
    with pytest.raises(ConfigError, match=message) as caught:
        load_geometry(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("text", ["a: [1", "- 1\n- 2", "", "just words"])
def test_malformed_yaml(tmp_path, text):
    with pytest.raises(ConfigError, match="expected"):
        load_geometry(write(tmp_path, text))


def test_missing_file(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        load_geometry(tmp_path / "none.yaml")


def test_binary_file(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_geometry(path)


def test_levels_that_swirl_against_each_other_are_degenerate(content):
    # The trap of figure 3.2: upper cables counterclockwise, lower ones clockwise, as its caption
    # says; f_z and m_z then depend on each other.
    platform = np.array(content["platform_points"])
    angle = np.radians(np.tile([45.0, 135.0, 225.0, 315.0], 2) + np.repeat([45.0, -45.0], 4))
    platform[:, 0], platform[:, 1] = 0.15 * np.cos(angle), 0.15 * np.sin(angle)
    base = np.array(content["base_points"])
    centre = np.array(content["reference_pose"]["position"])
    # A square frame makes the swirl exactly symmetric.
    base[:, :2] = centre[:2] + 0.8 * np.sign(base[:, :2] - centre[:2])
    with pytest.raises(DegenerateGeometryError, match="swirl"):
        RigGeometry(base, platform, centre, np.eye(3))


def test_cable_of_no_length():
    geometry = load_geometry()
    base = np.array(geometry.base_points)
    base[4] = geometry.reference_position + geometry.platform_points[4]
    with pytest.raises(DegenerateGeometryError, match="cable 5"):
        RigGeometry(base, geometry.platform_points, geometry.reference_position, np.eye(3))


def test_transposed_points_are_hinted_at():
    geometry = load_geometry()
    with pytest.raises(ShapeError, match="transpose"):
        RigGeometry(
            geometry.base_points.T, geometry.platform_points, geometry.reference_position, np.eye(3)
        )


@pytest.mark.parametrize("rotation", [np.zeros((3, 3)), np.diag([1.0, 1.0, -1.0]), np.ones((3, 3))])
def test_no_rotation(rotation):
    geometry = load_geometry()
    with pytest.raises(CabolsError, match="rotation"):
        RigGeometry(
            geometry.base_points, geometry.platform_points, geometry.reference_position, rotation
        )
