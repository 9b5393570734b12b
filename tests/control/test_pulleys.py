# SPDX-License-Identifier: Apache-2.0
"""Cables over swivelling pulleys, against virtual work, a search for the tangent, and MuJoCo.

The search knows no formula of the product: it looks for the point of the wheel's rim from which
the straight line to the platform touches the rim, by bisection on the sign of a scalar product.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import yaml
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from cabols_control.cable_kernels import departures_into
from cabols_control.configuration import read_yaml
from cabols_control.errors import CabolsError, ConfigError, ShapeError
from cabols_control.geometry import RigGeometry, load_geometry
from cabols_control.kinematics import cable_lengths, direction_gradients, structure_matrix
from cabols_control.motion import Motion
from cabols_control.rig_folder import rig_file
from cabols_control.tension import RigTensionResolver, distribute
from cabols_control.workspace.bodies import load_bodies
from cabols_control.workspace.capacity import capacity_along, capacity_of_matrices
from cabols_control.workspace.interference import clearance_along, free_turn
from cabols_control.workspace.tool.files import write_geometry
from cabols_control.workspace.wrench_set import wrench_box

BENCH = load_geometry()
BOX = [40.0, 40.0, 40.0, 4.0, 4.0, 4.0]


def tilted(seed, radius=(0.01, 0.08)):
    """The bench with a pulley of its own radius and tilted axis on every cable."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(8, 3)) * 0.3
    axes[:, 2] += np.where(np.arange(8) < 4, 1.0, -1.0)
    return replace(BENCH, pulley_radius=rng.uniform(*radius, 8), pulley_axes=axes)


def poses(seed, count):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        position = BENCH.reference_position + rng.uniform(-0.2, 0.2, 3)
        yield position, Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3)).as_matrix()


def searched(base, axis, radius, point):
    """Length from the base point and the point where the cable leaves the rim, by search."""
    away = point - base
    beside = away - (away @ axis) * axis
    e = beside / np.linalg.norm(beside)
    centre = base + radius * e

    def rim(wrapped):
        return centre - radius * (np.cos(wrapped) * e - np.sin(wrapped) * axis)

    def misses(wrapped):
        return (point - rim(wrapped)) @ (rim(wrapped) - centre)

    # The rim's outward normal meets the straight line at a right angle; of both tangents, the one
    # where the cable runs on in the sense in which it wrapped.
    grid = np.linspace(0.0, 2.0 * np.pi, 400)
    values = [misses(angle) for angle in grid]
    for low, high, one, other in zip(grid, grid[1:], values, values[1:], strict=False):
        if one * other <= 0.0:
            wrapped = brentq(misses, low, high, xtol=1e-15)
            onward = np.sin(wrapped) * e + np.cos(wrapped) * axis
            if (point - rim(wrapped)) @ onward > 0.0:
                leaves = rim(wrapped)
                return radius * wrapped + np.linalg.norm(point - leaves), leaves
    raise AssertionError("no tangent")


@pytest.mark.parametrize("seed", range(4))
def test_a_search_for_the_tangent_finds_the_same(seed):
    rig = tilted(seed)
    for position, rotation in poses(seed, 5):
        lengths, matrix = (f(rig, position, rotation) for f in (cable_lengths, structure_matrix))
        starts = np.empty((8, 3))
        departures_into(rig.records(), position, rotation, starts)
        for i in range(8):
            point = position + rotation @ rig.platform_points[i]
            length, leaves = searched(
                rig.base_points[i], rig.pulley_axes[i], rig.pulley_radius[i], point
            )
            assert abs(lengths[i] - length) < 1e-10
            np.testing.assert_allclose(starts[i], leaves, atol=1e-7)
            u = (leaves - point) / np.linalg.norm(leaves - point)
            np.testing.assert_allclose(matrix[:3, i], u, atol=1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_virtual_work(seed):
    """l_dot = -A^T twist to 1e-9, by Richardson's extrapolation of central differences."""
    rig = tilted(seed, (0.001, 0.15))
    for position, rotation in poses(seed, 3):
        matrix = structure_matrix(rig, position, rotation)
        for k in range(6):
            slopes = []
            for step in (1e-3, 5e-4, 2.5e-4):
                after, before = (
                    cable_lengths(
                        rig,
                        position + sign * step * (np.arange(3) == k),
                        Rotation.from_rotvec(sign * step * (np.arange(3, 6) == k)).as_matrix()
                        @ rotation,
                    )
                    for sign in (1.0, -1.0)
                )
                slopes.append((after - before) / (2.0 * step))
            first = [(4.0 * b - a) / 3.0 for a, b in itertools.pairwise(slopes)]
            np.testing.assert_allclose((16.0 * first[1] - first[0]) / 15.0, -matrix[k], atol=1e-9)


@pytest.mark.parametrize("rig", [BENCH, tilted(3)], ids=["points", "pulleys"])
def test_directions_turn_as_their_differences_say(rig):
    for position, rotation in poses(2, 3):
        gradients = direction_gradients(rig, position, rotation)
        for k in range(3):
            move = 1e-6 * (np.arange(3) == k)
            after, before = (
                structure_matrix(rig, position + sign * move, rotation)[:3].T for sign in (1, -1)
            )
            np.testing.assert_allclose((before - after) / 2e-6, gradients[:, :, k], atol=1e-7)


def test_a_vanishing_radius_is_a_point():
    small = replace(BENCH, pulley_radius=1e-9)
    for position, rotation in poses(1, 3):
        for function in (cable_lengths, structure_matrix):
            found, expected = (function(rig, position, rotation) for rig in (small, BENCH))
            np.testing.assert_allclose(found, expected, atol=1e-8)


def wrapped_tendon(radius, height):
    """Length of MuJoCo's tendon over a cylinder that cannot swivel, target in its plane."""
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco><worldbody>
      <site name="inlet" pos="0 0 -0.5"/>
      <geom name="wheel" type="cylinder" size="{radius} 0.01" pos="{radius} 0 0"
            euler="90 0 0" contype="0" conaffinity="0"/>
      <site name="side" pos="{radius} 0 {2.0 * radius}"/>
      <body name="platform"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
        <geom size="0.01" mass="1"/><site name="held" pos="0.8 0 {height}"/></body>
    </worldbody><tendon><spatial name="cable">
      <site site="inlet"/><geom geom="wheel" sidesite="side"/><site site="held"/>
    </spatial></tendon></mujoco>""")
    data = mujoco.MjData(model)
    found = []
    for x, z in ((0.0, 0.0), (0.1, -0.05), (-0.2, 0.1)):
        data.qpos[:] = x, z
        mujoco.mj_forward(model, data)
        jacobian = np.array(data.ten_J).reshape(-1)[:2]
        found.append(((0.8 + x, 0.0, height + z), float(data.ten_length[0]) - 0.5, jacobian))
    return found


@pytest.mark.parametrize("radius", [0.02, 0.06])
@pytest.mark.parametrize("height", [-0.6, -0.1, 0.3])
def test_mujoco_wraps_the_same_tendon(radius, height):
    """A cable that comes from below along the axis, over the wheel: MuJoCo's cylinder wrapping."""
    rig = RigGeometry(
        base_points=np.vstack([[0.0, 0.0, 0.0], BENCH.base_points[1:]]),
        platform_points=np.vstack([[0.0, 0.0, 0.0], BENCH.platform_points[1:]]),
        reference_position=BENCH.reference_position,
        reference_rotation=np.eye(3),
        pulley_radius=np.array([radius, *[0.0] * 7]),
        pulley_axes=np.tile([0.0, 0.0, 1.0], (8, 1)),
    )
    for point, length, jacobian in wrapped_tendon(radius, height):
        position = np.array(point)
        assert abs(cable_lengths(rig, position, np.eye(3))[0] - length) < 1e-9
        u = structure_matrix(rig, position, np.eye(3))[:3, 0]
        np.testing.assert_allclose(-u[[0, 2]], jacobian, atol=1e-9)


def test_tensions_maps_and_clearances_are_over_the_pulleys():
    rig = tilted(7)
    moving = RigTensionResolver(
        rig.base_points, rig.platform_points, 1.0, 150.0,
        pulley_radius=rig.pulley_radius, pulley_axes=rig.pulley_axes,
    )  # fmt: skip
    at = list(poses(4, 20))
    positions, rotations = (np.array([pose[k] for pose in at]) for k in (0, 1))
    matrices = np.array([structure_matrix(rig, *pose) for pose in at])
    wrench = np.array([20.0, -10.0, 15.0, 1.0, 0.5, -1.0])
    tensions, _ = moving.solve_batch(positions, rotations, np.tile(wrench, (20, 1)))
    for k, (position, rotation) in enumerate(at):
        expected = distribute(matrices[k], wrench, 1.0, 150.0)
        found = moving.solve(position, rotation, wrench)
        np.testing.assert_allclose(found.tension, expected.tension, atol=1e-8)
        np.testing.assert_allclose(tensions[k], expected.tension, atol=1e-8)
    limits = (1.0, 150.0, wrench_box(BOX))
    found = capacity_along(rig, positions, rotations, *limits).margin
    np.testing.assert_allclose(found, capacity_of_matrices(matrices, *limits).margin, atol=1e-9)
    bodies = load_bodies()
    over, straight = (clearance_along(g, bodies, positions, rotations).least for g in (rig, BENCH))
    assert (np.abs(over - straight) > 1e-6).any()
    with pytest.raises(CabolsError, match="pulleys, over which no range is certified"):
        free_turn(rig, bodies, positions[0], rotations[0], (0.0, 0.0, 1.0))


def test_lengths_with_their_arcs_are_held_against_the_limits():
    rig = replace(BENCH, pulley_radius=0.05)
    at = np.array([position for position, _ in poses(9, 200)])
    turns = np.tile(np.eye(3), (200, 1, 1))
    lengths = np.array([cable_lengths(rig, p, np.eye(3)).max() for p in at])
    limit = float(np.median(lengths))
    bounded = replace(rig, cable_length_max=limit)
    found = capacity_along(bounded, at, turns, 1.0, 150.0, wrench_box([1.0] * 6))
    np.testing.assert_array_equal(np.isneginf(found.margin), lengths > limit)


def test_a_pose_on_the_wheel_is_out_of_reach():
    rig = replace(BENCH, pulley_radius=0.05)
    inside = rig.base_points[0] + [-0.05, 0.0, -0.01] - rig.platform_points[0]
    for function in (cable_lengths, structure_matrix):
        with pytest.raises(ShapeError, match=r"cable 1.*pulley"):
            function(rig, inside, np.eye(3))
    found = capacity_along(rig, [inside], [np.eye(3)], 1.0, 150.0, wrench_box([1.0] * 6))
    assert not found.feasible[0]


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"pulley_radius": 40.0}, "pulley_radius.*10"),
        ({"pulley_radius": 0.9}, "metres|millimetres|pulley"),
        ({"pulley_radius": -0.01}, "pulley_radius"),
        ({"pulley_radius": float("nan")}, "pulley_radius"),
        ({"pulley_radius": [0.04] * 7}, "pulley_radius: expected shape"),
        ({"pulley_radius": [0.0] * 7}, "pulley_radius: expected shape"),
        ({"pulley_radius": []}, "pulley_radius: expected shape"),
        ({"pulley_radius": "wide"}, "pulley_radius"),
        ({"pulley_radius": True}, "pulley_radius"),
        ({"pulley_radius": 0.04, "pulley_axes": [[0, 0, 1]] * 7}, "pulley_axes"),
        ({"pulley_radius": 0.04, "pulley_axes": [[0, 0, 0]] * 8}, "pulley_axes.*direction"),
        ({"pulley_axes": [[0, 0, 1]] * 8}, "expected pulley_radius"),
    ],
)
def test_what_cannot_be_a_pulley_is_refused(tmp_path, change, match):
    file = tmp_path / "geometry.yaml"
    file.write_text(yaml.safe_dump({**read_yaml(rig_file("geometry.yaml")), **change}))
    with pytest.raises(ConfigError, match=match):
        load_geometry(file)


def test_planar_pulleys_swivel_in_their_plane():
    """A planar robot's wheels stand in its plane; the default axes, along z, lead out of it."""
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    points = (corners, 0.1 * corners, np.zeros(3), np.eye(3))
    given = {"pulley_radius": 0.04, "motion": Motion.PLANAR_XY}
    with pytest.raises(ShapeError, match=r"pulley_axes.*plane of the motion planar_xy"):
        RigGeometry(*points, **given)
    axes = np.array([[0.0, 1, 0], [0, 1, 0], [0, -1, 0], [0, -1, 0]])
    matrix = structure_matrix(
        RigGeometry(*points, **given, pulley_axes=axes), [0.1, 0, 0], np.eye(3)
    )
    assert np.abs(matrix[2:5]).max() < 1e-15


def test_pulleys_survive_the_round_trip(tmp_path):
    rig = tilted(11)
    write_geometry(rig, tmp_path / "geometry.yaml", "tilted")
    back = load_geometry(tmp_path / "geometry.yaml")
    np.testing.assert_allclose(back.pulley_radius, rig.pulley_radius, atol=1e-6)
    np.testing.assert_allclose(back.pulley_axes, rig.pulley_axes, atol=1e-12)
