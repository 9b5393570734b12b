# SPDX-License-Identifier: Apache-2.0
"""Registration: against scipy's own fits, and its covariance against Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from cabols_control.errors import OutOfRangeError, ShapeError
from cabols_control.registration.reflectors import (
    MisfitError,
    RegistrationError,
    in_base,
    register_frame,
    register_pose,
)
from cabols_hw.tracker.beam import BeamNoise, beam_axes, predicted_covariance

REFLECTORS = np.array([[0.07, 0.12, -0.02], [-0.07, 0.12, -0.02], [0.0, 0.09, 0.1]])
POSITION = np.array([2.4, -1.3, 0.2])
ROTATION = Rotation.from_euler("XYZ", [20.0, -35.0, 110.0], degrees=True).as_matrix()
NOISE = BeamNoise()
ROBOT = np.diag([2e-5] * 3 + [4e-5] * 3) ** 2


def covariances(points):
    return np.array([predicted_covariance(point, NOISE) for point in points])


def noisy(random, points, covariance):
    factors = np.linalg.cholesky(covariance)
    return points + np.einsum("...ij,...j->...i", factors, random.standard_normal(points.shape))


def pose_error(position, rotation, true_position, true_rotation):
    turn = Rotation.from_matrix(true_rotation @ rotation.T).as_rotvec()
    return np.concatenate([true_position - position, turn])


def band(size, draws, level=0.95):
    """Band of the mean of `draws` chi-squares with `size` degrees of freedom."""
    return chi2.ppf([0.5 - level / 2.0, 0.5 + level / 2.0], size * draws) / draws


def test_noise_free_points_give_the_pose_back():
    points = POSITION + REFLECTORS @ ROTATION.T
    pose = register_pose(REFLECTORS, points, covariances(points))
    np.testing.assert_allclose(pose.position, POSITION, atol=1e-13)
    np.testing.assert_allclose(pose.rotation, ROTATION, atol=1e-13)
    assert pose.converged
    assert pose.chi_square < 1e-12
    assert pose.degrees_of_freedom == 3


@pytest.mark.parametrize("count", [3, 5])
def test_equal_isotropic_noise_gives_the_unweighted_fit(random, count):
    reflectors = np.vstack([REFLECTORS, [[0.1, 0.0, 0.05], [-0.05, -0.1, 0.0]]])[:count]
    points = POSITION + reflectors @ ROTATION.T + 1e-4 * random.standard_normal((count, 3))
    pose = register_pose(reflectors, points, np.tile(1e-8 * np.eye(3), (count, 1, 1)))
    centred = reflectors - reflectors.mean(axis=0)
    expected, _ = Rotation.align_vectors(points - points.mean(axis=0), centred)
    np.testing.assert_allclose(pose.rotation, expected.as_matrix(), atol=1e-9)
    position = points.mean(axis=0) - expected.as_matrix() @ reflectors.mean(axis=0)
    np.testing.assert_allclose(pose.position, position, atol=1e-9)


def test_anisotropic_noise_gives_the_weighted_fit_of_scipy(random):
    points = POSITION + REFLECTORS @ ROTATION.T
    # Noise so uneven that an unweighted fit is clearly another one.
    weights = np.array([predicted_covariance(p, BeamNoise(1e-6, 0, 1e-3, 0)) for p in points])
    seen = noisy(random, points, weights)
    white = np.linalg.inv(np.linalg.cholesky(weights))

    def residuals(x):
        turn = Rotation.from_euler("zyx", x[3:]).as_matrix()
        return np.einsum("nij,nj->ni", white, x[:3] + REFLECTORS @ turn.T - seen).ravel()

    start = np.concatenate([POSITION, Rotation.from_matrix(ROTATION).as_euler("zyx")])
    found = least_squares(residuals, start, xtol=1e-15, ftol=1e-15, gtol=1e-12, x_scale="jac")
    pose = register_pose(REFLECTORS, seen, weights)
    np.testing.assert_allclose(pose.position, found.x[:3], atol=1e-8)
    turn = Rotation.from_euler("zyx", found.x[3:]).as_matrix()
    np.testing.assert_allclose(pose.rotation, turn, atol=1e-7)
    assert pose.chi_square == pytest.approx(2.0 * found.cost, rel=1e-6)
    unweighted = register_pose(REFLECTORS, seen, np.tile(np.eye(3), (3, 1, 1)))
    assert np.abs(unweighted.position - pose.position).max() > 1e-6


def test_covariance_of_the_pose_agrees_with_monte_carlo(random):
    draws = 3000
    points = POSITION + REFLECTORS @ ROTATION.T
    weights = covariances(points)
    errors, squares, residuals, predicted = [], [], [], []
    for _ in range(draws):
        pose = register_pose(REFLECTORS, noisy(random, points, weights), weights)
        error = pose_error(pose.position, pose.rotation, POSITION, ROTATION)
        errors.append(error)
        squares.append(error @ np.linalg.solve(pose.covariance, error))
        residuals.append(pose.chi_square)
        predicted.append(pose.covariance)
    low, high = band(6, draws)
    assert low <= np.mean(squares) <= high
    # A second statistic of the same draws: wider, or one seed in twenty would fail for nothing.
    low, high = band(3, draws, 0.999)
    assert low <= np.mean(residuals) <= high
    # The scatter itself, too: a covariance with two wrongs could still have the right NEES.
    sigma = np.sqrt(np.diag(np.mean(predicted, axis=0)))
    np.testing.assert_allclose(np.std(errors, axis=0), sigma, rtol=0.07)


def test_isotropic_weights_on_anisotropic_noise_are_found_out(random):
    """The check above can fail: it does if the covariance ignores the beam's direction."""
    draws = 300
    points = POSITION + REFLECTORS @ ROTATION.T
    weights = covariances(points)
    alike = np.array([np.trace(w) / 3.0 * np.eye(3) for w in weights])
    squares = []
    for _ in range(draws):
        pose = register_pose(REFLECTORS, noisy(random, points, weights), alike)
        error = pose_error(pose.position, pose.rotation, POSITION, ROTATION)
        squares.append(error @ np.linalg.solve(pose.covariance, error))
    low, high = band(6, draws)
    assert not low <= np.mean(squares) <= high or np.var(squares) > 1.3 * 12.0


def test_exchanged_reflectors_show_in_the_chi_square():
    points = POSITION + REFLECTORS @ ROTATION.T
    pose = register_pose(REFLECTORS, points[[0, 2, 1]], covariances(points))
    assert pose.probability < 1e-6


def test_points_on_a_line_are_refused():
    line = np.outer([0.0, 0.05, 0.12], [1.0, 2.0, 0.5])
    points = POSITION + line @ ROTATION.T
    with pytest.raises(RegistrationError, match=r"reflectors: .* not on one line"):
        register_pose(line, points, covariances(points))
    with pytest.raises(RegistrationError, match=r"measured: .* not on one line"):
        register_pose(REFLECTORS, points, covariances(points))
    with pytest.raises(RegistrationError, match="not on one line"):
        register_pose(np.zeros((3, 3)), points, covariances(points))


def test_two_points_are_refused():
    points = POSITION + REFLECTORS[:2] @ ROTATION.T
    with pytest.raises(RegistrationError, match="at least 3, got 2"):
        register_pose(REFLECTORS[:2], points, covariances(points))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(bad):
    points = POSITION + REFLECTORS @ ROTATION.T
    weights = covariances(points)
    arguments = [REFLECTORS, points, weights]
    for index, name in enumerate(["reflectors", "measured", "covariances"]):
        wrong = [a.copy() for a in arguments]
        wrong[index][1, 1] = bad
        with pytest.raises(ShapeError, match=rf"{name}: expected finite"):
            register_pose(*wrong)


def test_covariances_that_are_none_are_refused():
    points = POSITION + REFLECTORS @ ROTATION.T
    weights = covariances(points)
    for wrong, message in ((-weights, "positive definite"), (np.zeros((3, 3, 3)), "positive")):
        with pytest.raises(ShapeError, match=message):
            register_pose(REFLECTORS, points, wrong)
    weights[0, 0, 1] += 1e-10
    with pytest.raises(ShapeError, match="symmetric"):
        register_pose(REFLECTORS, points, weights)


def robot_poses(random, count=8):
    positions = [0.0, 1.23, 0.79] + 0.25 * random.uniform(-1.0, 1.0, (count, 3))
    turns = Rotation.from_rotvec(0.4 * random.uniform(-1.0, 1.0, (count, 3))).as_matrix()
    return positions, turns


def seen_by_tracker(positions, turns, reflectors):
    """(k, n, 3) in the tracker's frame, whose pose in the base is POSITION, ROTATION."""
    in_base = positions[:, None, :] + np.einsum("kij,nj->kni", turns, reflectors)
    return (in_base - POSITION) @ ROTATION


@pytest.mark.parametrize("solve", [False, True])
def test_frame_from_exact_poses(random, solve):
    positions, turns = robot_poses(random)
    seen = seen_by_tracker(positions, turns, REFLECTORS)
    weights = np.array([covariances(points) for points in seen])
    nominal = REFLECTORS + 0.02 if solve else REFLECTORS
    valid = np.ones(seen.shape[:2], dtype=bool)
    valid[2, 1] = valid[5] = False
    seen[~valid] = np.nan
    frame = register_frame(
        positions, turns, nominal, seen, weights, valid=valid, solve_reflectors=solve
    )
    np.testing.assert_allclose(frame.position, POSITION, atol=1e-11)
    np.testing.assert_allclose(frame.rotation, ROTATION, atol=1e-11)
    np.testing.assert_allclose(frame.reflectors, REFLECTORS, atol=1e-11)
    assert frame.residual_rms < 1e-11
    np.testing.assert_array_equal(np.isnan(frame.residuals[..., 0]), ~valid)
    assert frame.degrees_of_freedom == 3 * valid.sum() - (15 if solve else 6)


def test_frame_from_one_fixed_reflector_without_knowing_where_it_is(random):
    positions, turns = robot_poses(random)
    seen = seen_by_tracker(positions, turns, REFLECTORS[:1])
    weights = np.array([covariances(points) for points in seen])
    frame = register_frame(positions, turns, np.zeros((1, 3)), seen, weights, solve_reflectors=True)
    np.testing.assert_allclose(frame.position, POSITION, atol=1e-10)
    np.testing.assert_allclose(frame.reflectors, REFLECTORS[:1], atol=1e-10)


@pytest.mark.parametrize("solve", [False, True])
def test_covariance_of_the_frame_agrees_with_monte_carlo(random, solve):
    draws = 300
    positions, turns = robot_poses(random)
    count, unknowns = 3, 15 if solve else 6
    squares, residuals = [], []
    spread = np.sqrt(np.diag(ROBOT))
    for _ in range(draws):
        slip = spread * random.standard_normal((len(positions), 6))
        true_turns = Rotation.from_rotvec(slip[:, 3:]).as_matrix() @ turns
        points = seen_by_tracker(positions + slip[:, :3], true_turns, REFLECTORS)
        weights = np.array([covariances(row) for row in points])
        frame = register_frame(
            positions,
            turns,
            REFLECTORS,
            noisy(random, points, weights),
            weights,
            pose_covariance=ROBOT,
            solve_reflectors=solve,
        )
        error = pose_error(frame.position, frame.rotation, POSITION, ROTATION)
        squares.append(error @ np.linalg.solve(frame.covariance, error))
        residuals.append(frame.chi_square)
        if solve:
            off = (REFLECTORS - frame.reflectors).ravel()
            assert off @ np.linalg.solve(frame.reflector_covariance, off) < chi2.isf(1e-7, 9)
    # Few draws, several statistics: the 95 % band is for the benchmark, which draws more.
    low, high = band(6, draws, 0.999)
    assert low <= np.mean(squares) <= high
    low, high = band(3 * count * len(positions) - unknowns, draws, 0.999)
    assert low <= np.mean(residuals) <= high


def test_frame_needs_poses_that_determine_it(random):
    positions, turns = robot_poses(random)
    seen = seen_by_tracker(positions, np.tile(np.eye(3), (8, 1, 1)), REFLECTORS)
    weights = np.array([covariances(points) for points in seen])
    with pytest.raises(RegistrationError, match="turn the platform about two axes"):
        register_frame(
            positions,
            np.tile(np.eye(3), (8, 1, 1)),
            REFLECTORS,
            seen,
            weights,
            solve_reflectors=True,
        )
    with pytest.raises(RegistrationError, match="measure at more poses"):
        register_frame(
            positions[:1], turns[:1], REFLECTORS, seen[:1], weights[:1], solve_reflectors=True
        )
    line = positions[:1] + np.outer(np.arange(8), [0.1, 0.0, 0.0])
    seen = seen_by_tracker(line, np.tile(np.eye(3), (8, 1, 1)), REFLECTORS[:1])
    with pytest.raises(RegistrationError, match="not on one line"):
        register_frame(line, turns, REFLECTORS[:1], seen, weights[:, :1])


def test_frame_refuses_nan_that_was_not_declared(random):
    positions, turns = robot_poses(random)
    seen = seen_by_tracker(positions, turns, REFLECTORS)
    weights = np.array([covariances(points) for points in seen])
    seen[3, 1, 2] = np.nan
    with pytest.raises(ShapeError, match=r"measured: expected finite.*\[3, 1, 2\]"):
        register_frame(positions, turns, REFLECTORS, seen, weights)


def test_predicted_covariance_lies_along_and_across_the_beam():
    point = np.array([1.0, 2.0, -2.0])
    covariance = predicted_covariance(point, NOISE)
    along = point / 3.0
    assert np.sqrt(along @ covariance @ along) == pytest.approx(5e-6 + 0.15e-6 * 3.0)
    values = np.sqrt(np.linalg.eigvalsh(covariance))
    np.testing.assert_allclose(values, [5.45e-6, 16.5e-6, 16.5e-6], rtol=1e-9)
    axes = beam_axes(point)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    with pytest.raises(OutOfRangeError, match="distance"):
        predicted_covariance([0.0, 0.0, 0.0], NOISE)
    with pytest.raises(ShapeError, match="finite"):
        predicted_covariance([np.nan, 0.0, 0.0], NOISE)


def test_a_point_moves_into_the_base_with_its_covariance():
    point = np.array([1.0, 2.0, -2.0])
    covariance = predicted_covariance(point, NOISE)
    moved, turned = in_base(POSITION, ROTATION, point, covariance)
    beam = (moved - POSITION) / 3.0
    assert np.sqrt(beam @ turned @ beam) == pytest.approx(5e-6 + 0.15e-6 * 3.0)


def registered(positions, turns, seen, **options):
    weights = np.array([covariances(points) for points in seen])
    return register_frame(
        positions, turns, REFLECTORS, seen, weights, pose_covariance=ROBOT, **options
    )


@pytest.mark.parametrize("solve", [False, True])
@pytest.mark.parametrize("after", [3, 5, 6])
@pytest.mark.parametrize("shift", [[1e-3, 0, 0], [0, -0.7e-3, 0.4e-3]])
def test_tracker_that_was_bumped_is_refused_with_the_pose(random, shift, after, solve):
    positions, turns = robot_poses(random)
    seen = seen_by_tracker(positions, turns, REFLECTORS)
    seen[after:] += shift
    with pytest.raises(MisfitError, match=rf"moved by some .* mm after {after} of 8") as error:
        registered(positions, turns, seen, solve_reflectors=solve)
    assert error.value.estimate.probability < 1e-6
    assert registered(positions, turns, seen, least_probability=0.0).residual_rms > 1e-4


def test_turned_tracker_exchanged_reflectors_and_a_left_hand_are_refused(random):
    positions, turns = robot_poses(random)
    seen = seen_by_tracker(positions, turns, REFLECTORS)
    bent = seen.copy()
    bent[4:] = bent[4:] @ Rotation.from_rotvec([0.0, 0.0, 1e-3]).as_matrix()
    exchanged = seen.copy()
    exchanged[2] = exchanged[2][[1, 0, 2]]
    for wrong in (bent, exchanged, seen * [1.0, 1.0, -1.0]):
        with pytest.raises(MisfitError, match="expected points of one frame"):
            registered(positions, turns, wrong)
    assert registered(positions, turns, seen).mirror_visible


def test_covariances_that_promise_too_much_are_refused(random):
    positions, turns = robot_poses(random)
    seen = seen_by_tracker(positions, turns, REFLECTORS)
    seen = seen + 1e-4 * random.standard_normal(seen.shape)
    with pytest.raises(MisfitError, match="correct covariances"):
        registered(positions, turns, seen)


def test_three_points_say_that_they_cannot_see_a_mirror():
    fourth = np.vstack([REFLECTORS, [0.0, 0.0, -0.1]])
    flat = np.vstack([REFLECTORS, REFLECTORS.mean(axis=0)])
    for reflectors, visible in ((REFLECTORS, False), (fourth, True), (flat, False)):
        points = POSITION + reflectors @ ROTATION.T
        pose = register_pose(reflectors, points, covariances(points))
        assert pose.mirror_visible == visible
        mirrored = register_pose(reflectors, points * [1, 1, -1], covariances(points))
        assert (mirrored.probability < 1e-6) == visible
