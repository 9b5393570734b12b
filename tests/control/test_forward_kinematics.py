# SPDX-License-Identifier: Apache-2.0
"""Pose from cable lengths, beside scipy and facts of geometry; never a wrong pose as known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from cabols_control.errors import CabolsError
from cabols_control.forward_kinematics import (
    PoseFinder,
    PoseRegion,
    PoseState,
    stretched_lengths,
)
from cabols_control.geometry import RigGeometry, load_geometry
from cabols_control.kinematics import cable_lengths, structure_matrix
from case_robots import load

ROBOTS = ("cogiro", "ipanema1", "robocrane", "fast", "segesta10", "caroca", "macarm", "cablesim")
TURN = 0.3


def region_of(rig, share=0.2, turn=TURN):
    half = share * np.ptp(rig.base_points, axis=0)
    half = np.where(half > 0.0, half, rig.platform_radius)
    return PoseRegion(rig.reference_position, rig.reference_rotation, half, turn)


def random_pose(rng, region):
    vector = rng.standard_normal(3)
    vector *= region.largest_turn * rng.uniform() ** (1 / 3) / np.linalg.norm(vector)
    position = region.position + rng.uniform(-1.0, 1.0, 3) * region.half_widths
    return position, Rotation.from_rotvec(vector).as_matrix() @ region.rotation


def deviation(found, position, rotation):
    turn = Rotation.from_matrix(found.rotation @ rotation.T).as_rotvec()
    return np.r_[found.position - position, turn]


def size_of(rig):
    return float(np.ptp(rig.base_points, axis=0).max())


@pytest.mark.filterwarnings("ignore::cabols_control.rig_folder.RigWarning")
@pytest.mark.parametrize("name", ROBOTS)
def test_pose_of_exact_lengths_is_found_and_is_the_only_one(name):
    rig = load(name)[0]
    region, rng = region_of(rig), np.random.default_rng(4)
    finder = PoseFinder(rig, 1e-5 * size_of(rig), region)
    for _ in range(20):
        position, rotation = random_pose(rng, region)
        found = finder.find(cable_lengths(rig, position, rotation))
        assert found.state is PoseState.KNOWN
        # A last step of 1e-5 leaves 1e-10 of the size.
        assert np.abs(deviation(found, position, rotation)).max() < 1e-8 * size_of(rig)


def test_estimate_is_that_of_scipy():
    rig = load_geometry()
    region, rng, std = region_of(rig), np.random.default_rng(7), 1e-4
    finder = PoseFinder(rig, std, region)
    for _ in range(5):
        position, rotation = random_pose(rng, region)
        lengths = cable_lengths(rig, position, rotation) + std * rng.standard_normal(8)

        def errors(x, lengths=lengths):
            turn = Rotation.from_rotvec(x[3:]).as_matrix() @ region.rotation
            return (cable_lengths(rig, x[:3], turn) - lengths) / std

        other = least_squares(
            errors, np.r_[region.position, 0.0, 0.0, 0.0], method="lm", xtol=1e-14
        )
        turn = Rotation.from_rotvec(other.x[3:]).as_matrix() @ region.rotation
        found = finder.find(lengths)
        assert np.abs(deviation(found, other.x[:3], turn)).max() < 1e-8
        assert np.allclose(-std * other.fun, found.residual, atol=1e-10)
        # Of the pose before the last step, of at most 1e-5.
        J = structure_matrix(rig, found.position, found.rotation) / std
        assert np.allclose(found.covariance @ (J @ J.T), np.eye(6), atol=1e-3)


def test_covariance_covers_the_truth():
    rig = load_geometry()
    region, rng = region_of(rig, 0.15), np.random.default_rng(11)
    std = rng.uniform(2e-5, 2e-4, 8)
    finder, trials, inside = PoseFinder(rig, std, region), 1500, np.zeros(6, int)
    squares = 0.0
    for _ in range(trials):
        position, rotation = random_pose(rng, region)
        lengths = cable_lengths(rig, position, rotation) + std * rng.standard_normal(8)
        found = finder.find(lengths)
        assert found.state is PoseState.KNOWN
        error = deviation(found, position, rotation)
        inside += np.abs(error) < 1.959964 * np.sqrt(np.diag(found.covariance))
        squares += error @ np.linalg.solve(found.covariance, error)
    low, high = binom.ppf([0.0005, 0.9995], trials, 0.95)
    assert ((low <= inside) & (inside <= high)).all(), inside / trials
    # Sum of chi-square with 6 degrees: 6 trials +- 4 standard deviations.
    assert abs(squares - 6 * trials) < 4.0 * np.sqrt(12 * trials)


def mirrored():
    """Base points in one plane: what hangs below it could stand above."""
    angles = np.deg2rad(60.0 * np.arange(6) + np.tile([25.0, -25.0], 3))
    base = np.c_[2.0 * np.cos(angles), 2.0 * np.sin(angles), np.zeros(6)]
    angles = np.deg2rad(60.0 * np.arange(6) + np.tile([-20.0, 20.0], 3))
    points = np.c_[0.3 * np.cos(angles), 0.3 * np.sin(angles), np.zeros(6)]
    return RigGeometry(base, points, np.array([0.0, 0.0, -0.8]), np.eye(3))


def test_mirror_image_is_told_and_never_known():
    rig, rng = mirrored(), np.random.default_rng(3)
    both = PoseRegion(np.zeros(3), np.eye(3), np.array([0.3, 0.3, 1.2]), 0.4)
    below = PoseRegion(np.array([0.0, 0.0, -0.8]), np.eye(3), np.array([0.3, 0.3, 0.3]), 0.2)
    for _ in range(20):
        position, rotation = random_pose(rng, below)
        lengths = cable_lengths(rig, position, rotation)
        found = PoseFinder(rig, 1e-4, both).find(lengths)
        assert found.state in (PoseState.NOT_ALONE, PoseState.NOT_SHOWN)
        found = PoseFinder(rig, 1e-4, below).find(lengths)
        assert found.state is PoseState.KNOWN
        assert np.abs(deviation(found, position, rotation)).max() < 1e-7


@pytest.mark.parametrize("radius", [0.02, 0.05])
def test_cables_over_pulleys(radius):
    rig, rng = load_geometry(), np.random.default_rng(6)
    rig = replace(rig, pulley_radius=np.full(8, radius))
    region = region_of(rig)
    finder = PoseFinder(rig, 1e-5, region)
    for _ in range(20):
        position, rotation = random_pose(rng, region)
        found = finder.find(cable_lengths(rig, position, rotation))
        assert found.state is PoseState.KNOWN
        assert np.abs(deviation(found, position, rotation)).max() < 1e-8


def test_slipped_cable_leaves_no_pose():
    rig = load_geometry()
    region, rng = region_of(rig), np.random.default_rng(5)
    finder = PoseFinder(rig, 1e-4, region)
    for cable in range(8):
        lengths = cable_lengths(rig, *random_pose(rng, region))
        lengths[cable] += 5e-3
        found = finder.find(lengths)
        assert found.state is PoseState.NO_POSE
        assert np.isnan(found.position).all()


def test_platform_outside_the_region_is_not_known():
    rig = load_geometry()
    region = region_of(rig, 0.1, 0.1)
    far = rig.reference_position + np.array([0.0, 0.4, 0.0])
    found = PoseFinder(rig, 1e-4, region).find(cable_lengths(rig, far, rig.reference_rotation))
    assert found.state is PoseState.NO_POSE


def test_too_little_effort_is_not_called_known():
    rig = load_geometry()
    region = region_of(rig, 0.3, 0.5)
    pose = random_pose(np.random.default_rng(1), region)
    finder = PoseFinder(rig, 1e-4, region)
    assert finder.find(cable_lengths(rig, *pose), boxes=2).state is PoseState.NOT_SHOWN
    assert finder.find(cable_lengths(rig, *pose)).state is PoseState.KNOWN


def test_region_round_the_last_pose_takes_one_look():
    rig, rng = load_geometry(), np.random.default_rng(2)
    position, rotation = random_pose(rng, region_of(rig, 0.1))
    near = PoseRegion(position + 5e-3, rotation, np.full(3, 0.01), 0.02)
    found = PoseFinder(rig, 1e-5, near).find(cable_lengths(rig, position, rotation), boxes=1)
    assert found.state is PoseState.KNOWN


@pytest.mark.parametrize(
    "lengths", [np.full(8, np.nan), np.ones(7), np.ones((8, 1)), ["a"] * 8, np.full(8, np.inf)]
)
def test_what_are_no_lengths_is_refused(lengths):
    rig = load_geometry()
    with pytest.raises(CabolsError, match="lengths"):
        PoseFinder(rig, 1e-4, region_of(rig)).find(lengths)


@pytest.mark.parametrize("lengths", [np.zeros(8), np.full(8, -1.0), np.full(8, 1e300), np.ones(8)])
def test_impossible_lengths_have_no_pose(lengths):
    rig = load_geometry()
    found = PoseFinder(rig, 1e-4, region_of(rig)).find(lengths)
    assert found.state in (PoseState.NO_POSE, PoseState.NOT_FOUND)


@pytest.mark.parametrize("std", [0.0, -1e-4, np.nan, np.ones(7)])
def test_noise_that_cannot_be_is_refused(std):
    rig = load_geometry()
    with pytest.raises((CabolsError, ValueError)):
        PoseFinder(rig, std, region_of(rig))


def test_springs_lengthen_by_their_tension():
    lengths, std = stretched_lengths(np.ones(3), [0.0, 10.0, 20.0], 2000.0, 3e-4, 8e-1)
    assert np.allclose(lengths, [1.0, 1.005, 1.01])
    assert np.allclose(std, 5e-4)
    with pytest.raises(CabolsError):
        stretched_lengths(np.ones(3), np.ones(3), 0.0)
