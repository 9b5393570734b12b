# SPDX-License-Identifier: Apache-2.0
"""Programmes of a platform that hangs on its cables: they bear its weight beside the load."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import constants
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from cabols_control.kinematics import structure_matrix
from cabols_control.load_programs.feasibility import check_program, check_shaped
from cabols_control.load_programs.motor_demand import fastest_preview
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import load_rig

TURNED = Rotation.from_euler("XYZ", [0.05, -0.04, 0.1]).as_matrix()
HEIGHTS = (0.0, 0.05)


@pytest.fixture(scope="module")
def rig():
    return load_rig("hanging")


def held(wrench):
    """A programme that rises to one wrench and holds it."""
    wrenches = np.vstack([np.zeros(6), wrench, wrench])
    return LoadProgram("held", np.array([0.0, 1.0, 2.0]), wrenches, held=False)


def most_along(rig, place, direction):
    """By a linear programme: how much of a wrench cables at most give beside the weight."""
    matrix = structure_matrix(rig.geometry, *place)
    weight = np.array([0.0, 0.0, -rig.hanging.mass * constants.g])
    moment = np.cross(place[1] @ rig.hanging.centre, weight)
    n = rig.geometry.cables
    equal = np.hstack([matrix, -direction[:, None]])
    bounds = [(rig.control.tension_min, rig.hanging.proof_pull)] * n + [(0.0, None)]
    cost = np.r_[np.zeros(n), -1.0]
    found = linprog(cost, A_eq=equal, b_eq=-np.r_[weight, moment], bounds=bounds)
    assert found.status == 0, found.message
    return found.x[-1]


@pytest.mark.parametrize("height", HEIGHTS)
@pytest.mark.parametrize("axis", [0, 2, 3, 5])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_most_that_is_feasible_is_that_of_a_linear_programme(rig, height, axis, sign):
    place = rig.geometry.reference_position + np.array([0.0, 0.0, height]), TURNED
    direction = np.zeros(6)
    direction[axis] = sign
    most = most_along(rig, place, direction)
    assert most > 0.5
    assert check_program(rig, held(0.995 * most * direction), *place).feasible
    assert not check_program(rig, held(1.005 * most * direction), *place).feasible


def test_cables_of_a_programme_of_zero_bear_the_weight(rig):
    place = rig.geometry.reference_position, TURNED
    found = check_shaped(rig, fastest_preview(held(np.zeros(6)), rig, *place), *place)
    assert found.feasible
    exerted = found.tension @ structure_matrix(rig.geometry, *place).T
    np.testing.assert_allclose(exerted[:, 2], rig.hanging.mass * constants.g, atol=1e-6)


def test_a_platform_that_is_held_bears_its_own_weight():
    bench = load_rig()
    assert not bench.borne(TURNED).any()
