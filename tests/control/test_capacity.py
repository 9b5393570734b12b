# SPDX-License-Identifier: Apache-2.0
"""Wrench closure and feasibility by hyperplanes: against linear programmes and convex hulls."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from cabols_control.errors import CabolsError, ShapeError
from cabols_control.kinematics import structure_matrix
from cabols_control.tension import DEFAULT_WEIGHTS
from cabols_control.workspace.capacity import (
    available_wrenches,
    capacity_along,
    capacity_of_matrices,
)
from cabols_control.workspace.wrench_set import (
    WrenchSet,
    wrench_box,
    wrench_polytope,
    wrench_zonotope,
)
from tension_cases import random_rig
from wrench_lps import VertexPrograms, box_vertices, feasible_poses

LOW, HIGH = 1.0, 150.0
RATED = [94.0, 94.0, 94.0, 9.4, 9.4, 9.4]
BOX = [50.0, 50.0, 50.0, 5.0, 5.0, 5.0]
WEIGHTS = np.array(DEFAULT_WEIGHTS)
# Of the reference bench, found with linear programmes when it was chosen (wrench box: 94 N,
# 9.4 N m at the reference pose): offset [m], turn about an axis [deg], box that is left [N].
KNOWN = [
    ([0, 0, 0], [30, 0, 0], 86.0),
    ([0, 0, 0], [0, 0, 30], 43.0),
    ([0, 0.2, 0], [0, 0, 0], 76.0),
]


def turned(angles):
    return Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()


def random_poses(rig, random, count, reach=0.4, turn=30.0):
    positions = rig.geometry.reference_position + random.uniform(-reach, reach, (count, 3))
    return positions, turned(random.uniform(-turn, turn, (count, 3)))


def test_reference_bench_has_its_known_capacity(rig):
    geometry = rig.geometry
    centre = geometry.reference_position
    at_rest = capacity_along(geometry, [centre], [np.eye(3)], LOW, HIGH, wrench_box(RATED))
    assert at_rest.feasible.all()
    assert at_rest.factor[0] < 1.02
    for offset, angles, box in KNOWN:
        found = capacity_along(
            geometry, [centre + offset], [turned(angles)], LOW, HIGH, wrench_box(RATED)
        )
        assert not found.feasible.any()
        assert abs(94.0 * found.factor[0] - box) < 1.0
    gone = capacity_along(geometry, [centre], [turned([0, 0, 45])], LOW, HIGH, wrench_box(RATED))
    assert gone.factor[0] == 0.0
    assert not gone.closed.any()
    for axis, largest in enumerate([254.0, 222.0, 375.0, 55.0, 59.0, 53.0]):
        wrench = np.eye(6)[axis]
        one = wrench_polytope([wrench, -wrench])
        found = capacity_along(geometry, [centre], [np.eye(3)], LOW, HIGH, one)
        assert abs(found.factor[0] - largest) < 1.0


@pytest.mark.parametrize("platform_axes", [False, True])
def test_agrees_with_linear_programmes(rig, random, platform_axes):
    positions, rotations = random_poses(rig, random, 150)
    found = capacity_along(
        rig.geometry, positions, rotations, LOW, HIGH, wrench_box(BOX), platform_axes
    )
    vertices = box_vertices(BOX)
    programs = VertexPrograms(8, LOW, HIGH)
    assert np.abs(found.margin).min() > 1e-6, "a pose that no solver can decide"
    for k, (position, rotation) in enumerate(zip(positions, rotations, strict=True)):
        asked = vertices
        if platform_axes:
            asked = np.hstack([vertices[:, :3] @ rotation.T, vertices[:, 3:] @ rotation.T])
        matrix = structure_matrix(rig.geometry, position, rotation)
        assert programs.feasible(matrix, asked) == found.feasible[k]
    assert 0.1 < found.feasible.mean() < 0.9


def test_factor_is_where_the_margin_vanishes(rig, random):
    positions, rotations = random_poses(rig, random, 40)
    found = capacity_along(rig.geometry, positions, rotations, LOW, HIGH, wrench_box(BOX))
    for k in np.flatnonzero(found.factor > 0.0):
        pose = ([positions[k]], [rotations[k]])
        scaled = wrench_box(BOX).scaled(found.factor[k])
        again = capacity_along(rig.geometry, *pose, LOW, HIGH, scaled)
        assert abs(again.margin[0]) < 1e-9
        assert abs(again.factor[0] - 1.0) < 1e-9


def test_factor_of_a_set_that_does_not_hold_zero():
    """One cable along x and one against it: 1 to 10 N each; sums in -9 to 9 N, about 5: 3 to 7."""
    matrix = np.array([[[1.0, -1.0]]])
    pull = wrench_box([2.0], [5.0])
    found = capacity_of_matrices(matrix, 1.0, 10.0, pull)
    np.testing.assert_allclose([found.margin[0], found.factor[0]], [2.0, 9.0 / 7.0])
    # Only pulls of 20 to 30 N can be given: no multiple of the set about zero fits at 1.
    one_way = capacity_of_matrices(np.array([[[1.0, 1.0]]]), 10.0, 15.0, wrench_box([1.0], [9.0]))
    np.testing.assert_allclose(one_way.margin, [-12.0])
    np.testing.assert_allclose([one_way.factor_low[0], one_way.factor_high[0]], [2.5, 3.0])
    np.testing.assert_allclose(one_way.factor, [0.0])
    assert one_way.closure[0] == 0.0
    none = capacity_of_matrices(np.array([[[1.0, 1.0]]]), 10.0, 15.0, wrench_box([9.0], [9.0]))
    assert none.factor[0] == 0.0


@pytest.mark.parametrize("n", [6, 7, 8])
def test_fast_and_general_way_agree(rig, random, n):
    """The null-space way for six to eight cables, and facets solved for one by one."""
    low, high = random.uniform(0.0, 5.0, n), random.uniform(50.0, 150.0, n)
    geometry = rig.geometry
    order = random.permutation(8)[:n]
    small = type(geometry)(
        geometry.base_points[order],
        geometry.platform_points[order],
        geometry.reference_position,
        geometry.reference_rotation,
    )
    points = random.uniform(-30.0, 30.0, (5, 6)) / WEIGHTS
    asked = WrenchSet(points, random.uniform(-9.0, 9.0, (3, 6)) / WEIGHTS)
    positions, rotations = random_poses(rig, random, 60)
    fast = capacity_along(small, positions, rotations, low, high, asked)
    matrices = [structure_matrix(small, p, r) for p, r in zip(positions, rotations, strict=True)]
    general = capacity_of_matrices(matrices, low, high, asked)
    for one, other in zip(fast, general, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("m", "n"), [(2, 4), (3, 4), (3, 6), (4, 6)])
def test_planar_and_other_robots_against_convex_hulls(random, m, n):
    """Facets of the zonotope against qhull's, from all corners of the tensions' box."""
    for _ in range(5):
        matrix = random.uniform(-1.0, 1.0, (m, n))
        corners = np.array(list(product((LOW, HIGH), repeat=n))) @ matrix.T
        hull = ConvexHull(corners)
        asked = wrench_polytope(corners.mean(axis=0) + random.uniform(-60.0, 60.0, (4, m)))
        slack = -(hull.equations[:, :-1] @ asked.points.T + hull.equations[:, -1:])
        found = capacity_of_matrices([matrix], LOW, HIGH, asked)
        np.testing.assert_allclose(found.margin[0], slack.min(), atol=1e-8)
        normals, offsets = available_wrenches(matrix, LOW, HIGH)
        reach = (normals @ corners.T).max(axis=1)
        np.testing.assert_allclose(reach, offsets, atol=1e-9)


def test_more_than_eight_cables_against_linear_programmes(random):
    for n in (9, 11):
        programs = VertexPrograms(n, LOW, HIGH)
        matrices = [random_rig(random, n) for _ in range(8)]
        found = capacity_of_matrices(matrices, LOW, HIGH, wrench_box(BOX))
        for matrix, feasible in zip(matrices, found.feasible, strict=True):
            assert programs.feasible(matrix, box_vertices(BOX)) == feasible


def test_closure_against_linear_programmes(rig, random):
    """Closed: rank 6 and strictly positive tensions that balance (Stiemke's theorem)."""
    positions, rotations = random_poses(rig, random, 120, reach=0.6, turn=60.0)
    found = capacity_along(rig.geometry, positions, rotations, LOW, HIGH, wrench_box(BOX))
    for k, (position, rotation) in enumerate(zip(positions, rotations, strict=True)):
        A = structure_matrix(rig.geometry, position, rotation)
        balance = linprog(np.zeros(8), A_eq=A, b_eq=np.zeros(6), bounds=(1.0, None))
        assert (balance.status == 0) == found.closed[k]
    assert 0.2 < found.closed.mean() < 0.98


def test_one_set_in_three_descriptions_has_one_margin(rig):
    half = np.array(BOX)
    sets = (
        wrench_box(half),
        wrench_zonotope(np.diag(half), np.zeros(6)),
        wrench_polytope(box_vertices(half)),
        wrench_polytope(wrench_box(half).vertices()),
    )
    pose = ([np.add(rig.geometry.reference_position, [0.1, 0.0, 0.05])], [turned([5, 10, -8])])
    margins = [capacity_along(rig.geometry, *pose, LOW, HIGH, s).margin[0] for s in sets]
    np.testing.assert_allclose(margins, margins[0], rtol=1e-12)


def test_singular_rig_carries_nothing():
    """All cables through one point: no torque, whatever they pull."""
    rng = np.random.default_rng(3)
    direction = rng.normal(size=(3, 8))
    direction /= np.linalg.norm(direction, axis=0)
    found = capacity_of_matrices(
        [np.vstack([direction, 0 * direction])], LOW, HIGH, wrench_box(BOX)
    )
    assert found.margin[0] == -np.inf
    assert found.factor[0] == found.closure[0] == 0.0
    assert not found.feasible.any()


def test_arguments_that_cannot_be_used_are_named(rig):
    pose = ([rig.geometry.reference_position], [np.eye(3)])
    with pytest.raises(ShapeError, match=r"required: expected wrenches \(q, 6\), got \(q, 3\)"):
        capacity_along(rig.geometry, *pose, LOW, HIGH, wrench_box([1.0, 1.0, 1.0]))
    with pytest.raises(ShapeError, match="rotations"):
        capacity_along(rig.geometry, pose[0], [np.eye(3)] * 2, LOW, HIGH, wrench_box(BOX))
    with pytest.raises(CabolsError, match="tension_min"):
        capacity_along(rig.geometry, *pose, HIGH, LOW, wrench_box(BOX))
    with pytest.raises(CabolsError, match="half_widths: expected none below zero"):
        wrench_box([1.0, -1.0])
    with pytest.raises(ShapeError, match="expected finite"):
        wrench_polytope([[np.nan] * 6])
    with pytest.raises(ShapeError, match="at least one wrench"):
        wrench_polytope(np.zeros((0, 6)))


def test_bench_helper_counts_what_it_solves(rig):
    """The benchmark's opponent stops at the first infeasible vertex, and says how many it took."""
    pose = (rig.geometry.reference_position[None], np.eye(3)[None])
    answers, solved = feasible_poses(rig.geometry, *pose, box_vertices(BOX), LOW, HIGH)
    assert answers.all()
    assert solved == 64
    answers, solved = feasible_poses(rig.geometry, *pose, 9.0 * box_vertices(BOX), LOW, HIGH)
    assert not answers.any()
    assert solved < 64
