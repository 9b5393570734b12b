# SPDX-License-Identifier: Apache-2.0
"""Identification of the tool: what is no tool's weight is refused, with the cause."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_hw.force_torque.tool_weight import ToolError, identify_tool, tool_weight

CENTRE = np.array([0.01, -0.02, 0.15])
NOISE = 7e-5
"""Of the mean of 200 samples of a gauge [V]."""


def turns(random, count=8):
    return Rotation.from_rotvec(random.uniform(-0.8, 0.8, (count, 3))).as_matrix()


def volts_of(matrix, rotations, random, mass=2.5, centre=CENTRE, noise=NOISE):
    wrenches = np.array([tool_weight(mass, centre, rotation) for rotation in rotations])
    bias = random.uniform(-0.5, 0.5, 6)
    volts = bias + np.linalg.solve(matrix, wrenches.T).T
    return volts + noise * random.normal(size=volts.shape)


SIGNS = {
    "axis x of the sensor is inverted": [0, 3],
    "axis y of the sensor is inverted": [1, 4],
    "axis z of the sensor is inverted": [2, 5],
    "the force along z is inverted": [2],
    "the force along x is inverted": [0],
    "the torque about y is inverted": [4],
    "all axes of the sensor are inverted": [0, 1, 2, 3, 4, 5],
    "turned by 180 degrees about y": [0, 2, 3, 5],
}


@pytest.mark.parametrize(("cause", "inverted"), SIGNS.items(), ids=SIGNS)
def test_inverted_axis_is_named(card, random, cause, inverted):
    rotations = turns(random)
    volts = volts_of(card.ft_matrix, rotations, random)
    wrong = card.ft_matrix.copy()
    wrong[inverted] *= -1.0
    with pytest.raises(ToolError, match=cause):
        identify_tool(wrong, volts, rotations)


def test_transposed_rotations_are_named(card, random):
    rotations = turns(random)
    volts = volts_of(card.ft_matrix, rotations, random)
    with pytest.raises(ToolError, match="the rotations are transposed"):
        identify_tool(card.ft_matrix, volts, rotations.transpose(0, 2, 1))


@pytest.mark.parametrize(("mass", "far"), [(0.06, 1.3), (2.0, 0.7), (0.5, 3.0)])
def test_tool_out_of_reach_is_refused(card, random, mass, far):
    rotations = turns(random)
    volts = volts_of(card.ft_matrix, rotations, random, mass, np.array([0.0, 0.0, far]))
    with pytest.raises(ToolError, match=r"centre of mass within 0.5 m, got .* kg at"):
        identify_tool(card.ft_matrix, volts, rotations)
    found = identify_tool(card.ft_matrix, volts, rotations, reach=4.0)
    assert found.mass == pytest.approx(mass, rel=0.05)


def test_nothing_but_noise_is_no_tool(card, random):
    rotations = turns(random)
    for _ in range(20):
        volts = volts_of(card.ft_matrix, rotations, random, mass=0.0)
        with pytest.raises(ToolError):
            identify_tool(card.ft_matrix, volts, rotations)


def test_load_that_changes_between_the_orientations_is_refused(card, random):
    rotations = turns(random)
    volts = volts_of(card.ft_matrix, rotations, random)
    volts[3] += np.linalg.solve(card.ft_matrix, [0, 20.0, 0, 0, 0, 1.0])
    with pytest.raises(ToolError, match="something else than the tool"):
        identify_tool(card.ft_matrix, volts, rotations)


@pytest.mark.parametrize("mass", [0.2, 1.0, 5.0, 20.0])
def test_real_tools_are_found_with_noise(card, random, mass):
    for _ in range(10):
        rotations = turns(random, 6)
        found = identify_tool(
            card.ft_matrix, volts_of(card.ft_matrix, rotations, random, mass), rotations
        )
        assert found.mass == pytest.approx(mass, rel=0.03, abs=0.01)
        np.testing.assert_allclose(found.centre_of_mass, CENTRE, atol=0.02)
