# SPDX-License-Identifier: Apache-2.0
"""Poses at which a cable has no length, and numbers near the largest double.

cdpyr has a criterion of cable length for the former. Every reduction of a margin must let NaN fail.
"""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.errors import ShapeError
from cabols_control.geometry import load_geometry
from cabols_control.kinematics import structure_matrix
from cabols_control.tension import RigTensionResolver
from cabols_control.workspace.capacity import capacity_along
from cabols_control.workspace.wrench_set import wrench_box
from case_robots import FOLDER, load
from cases import outcome

EYE = np.eye(3)
POSE = np.array([1.5, 0.75, 2.25])
"""Where the platform's second point of the round rig meets its base point."""
BOX = wrench_box([50, 50, 50, 5, 5, 5])


@pytest.fixture(scope="module")
def round_rig():
    return load_geometry(FOLDER / "round.yaml")


def capacity_at(geometry, position, low=1.0, high=150.0, box=BOX):
    with np.errstate(all="ignore"):
        return capacity_along(geometry, position[None], EYE[None], low, high, box)


def test_pose_without_a_cable_length_is_out_of_reach(round_rig):
    found = outcome(lambda: capacity_at(round_rig, POSE))
    assert not isinstance(found, Exception), found
    assert found.margin[0] < 0.0
    assert not found.feasible[0]
    assert not found.closed[0]
    assert not found.factor[0] > 0.0


def test_structure_matrix_names_the_cable_without_length(round_rig):
    error = outcome(lambda: structure_matrix(round_rig, POSE, EYE))
    assert isinstance(error, ShapeError)
    assert "cable" in str(error)


def test_resolver_blames_the_cable(round_rig):
    resolver = RigTensionResolver(round_rig.base_points, round_rig.platform_points, 1.0, 150.0)
    error = outcome(lambda: resolver.solve(POSE, EYE, np.zeros(6)))
    assert isinstance(error, ShapeError)
    assert "cable" in str(error)


@pytest.mark.parametrize("name", ["macarm", "acrobot", "cablesim", "swin_full"])
def test_platform_point_on_its_base_point_is_out_of_reach(name):
    geometry, low, high, _ = load(name)
    corners = geometry.base_points - geometry.platform_points
    turns = np.repeat(EYE[None], geometry.cables, axis=0)
    with np.errstate(all="ignore"):
        found = outcome(
            lambda: capacity_along(geometry, corners, turns, low, high, wrench_box([1] * 6))
        )
    assert not isinstance(found, Exception), found
    assert not np.isposinf(found.margin).any()
    assert np.all(found.margin < 0.0)


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning")
def test_wrenches_near_the_largest_double_are_not_feasible():
    bench = load_geometry()
    box = wrench_box([1.7e308] * 6)
    found = outcome(lambda: capacity_at(bench, bench.reference_position, box=box))
    assert not isinstance(found, Exception), found
    assert not np.isposinf(found.margin[0])
    assert not found.feasible[0]
