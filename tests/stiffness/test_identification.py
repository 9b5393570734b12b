# SPDX-License-Identifier: Apache-2.0
"""Identification: recovery, independent solutions, models, outliers, what is not identifiable."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import lstsq
from scipy.optimize import least_squares

from cabols_control.errors import CabolsError, ConfigError, ShapeError
from cabols_stiffness import Samples, identify
from cabols_stiffness.identification.gauss_newton import IdentificationError
from cabols_stiffness.identification.online import OnlineIdentifier
from cabols_stiffness.identification.published import identify_as_source
from cabols_stiffness.identification.validation import choose_model, validate
from cabols_stiffness.measurements.poses import PoseWarning, poses
from cabols_stiffness.measurements.samples import concatenate, select
from cabols_stiffness.model.balance import Law, balance
from cabols_stiffness.model.result_file import read_result, write_result
from cabols_stiffness.model.screws import logarithm
from stiffness_bench import (
    Bench,
    bench_configurations,
    bench_robot,
    bench_truth,
    optimal_peaks,
    ramps,
    random_peaks,
)

TRUTH = np.array(bench_truth().stiffness)
ROBOT = bench_robot()


def small_plan(levels=(0.5, 1.0), peaks=4):
    configurations = bench_configurations()[[0, 1, 3, 7]]
    return ramps(configurations, optimal_peaks(configurations, peaks)[0], levels)


@pytest.fixture(scope="module")
def bench():
    return Bench(ROBOT, small_plan())


@pytest.fixture(scope="module")
def samples(bench):
    return bench.draw(0)


@pytest.fixture(scope="module")
def harder(bench):
    """Truth with cubic terms: 30 % of the linear torque at the largest deflection."""
    reach = np.abs(bench.deflection).max(axis=0)
    return replace(bench.truth, cubic=list(0.3 * TRUTH / reach**2))


def made(stiffness, wrenches, joints, noise=(1e-7, 1e-7), wrench_noise=1e-6, seed=0):
    """6-DOF samples of a robot with a given stiffness, made with this package's balance."""
    random = np.random.default_rng(seed)
    law = Law(np.asarray(stiffness, dtype=float), np.zeros(6))
    rest = balance(ROBOT, joints, wrenches, law, follows=False)
    start = ROBOT.posture(joints)
    moved = np.concatenate(
        [
            rest.posture.position - start.position,
            logarithm(rest.posture.rotation @ start.rotation.swapaxes(1, 2)),
        ],
        axis=1,
    )
    k, sigma = len(joints), np.repeat(noise, 3)
    return Samples(
        configuration=np.zeros(k),
        load=np.arange(k),
        branch=np.ones(k),
        joints=joints,
        wrench=wrenches + wrench_noise * random.standard_normal((k, 6)),
        wrench_covariance=np.broadcast_to(wrench_noise**2 * np.eye(6), (k, 6, 6)),
        deflection=moved + sigma * random.standard_normal((k, 6)),
        deflection_covariance=np.broadcast_to(np.diag(sigma**2), (k, 6, 6)),
    )


def loads(k, seed=1, size=(60, 60, 60, 6, 6, 6)):
    random = np.random.default_rng(seed)
    joints = bench_configurations()[0] + 0.2 * random.uniform(-1, 1, (k, 6))
    return random.uniform(-1, 1, (k, 6)) * size, joints


def test_noisy_campaign_gives_table_4_3_within_two_percent(samples):
    result = identify(samples, ROBOT)
    np.testing.assert_allclose(result.stiffness, TRUTH, rtol=0.02)
    assert result.identifiable.all()
    assert result.converged
    assert result.residual_rms == pytest.approx(1.0, abs=0.08)
    assert result.outliers.size == 0
    assert not result.hysteretic.any()
    # Errors are as large as stated: six of them stay below four standard deviations.
    assert np.abs((result.stiffness - TRUTH) / result.standard_deviation).max() < 4.0
    assert (result.interval[:, 0] < result.stiffness).all()
    assert (result.stiffness < result.interval[:, 1]).all()


@settings(max_examples=15)
@given(st.lists(st.floats(0.3, 3.0), min_size=6, max_size=6), st.integers(0, 1000))
def test_any_stiffness_is_recovered_from_clean_data(factors, seed):
    stiffness = TRUTH * factors
    wrenches, joints = loads(8, seed)
    result = identify(made(stiffness, wrenches, joints, (1e-10, 1e-10), 1e-9), ROBOT)
    np.testing.assert_allclose(result.stiffness, stiffness, rtol=1e-3)


def test_small_loads_agree_with_scipy_least_squares():
    """A hand-made case: linear equations in the compliance, written out and solved by scipy."""
    wrenches, joints = loads(5, size=(1, 1, 1, 0.1, 0.1, 0.1))
    data = made(TRUTH, wrenches, joints, (2e-8, 1e-7), 1e-9, seed=3)
    rows, right = [], []
    for q, w, d in zip(data.joints, data.wrench, data.deflection, strict=True):
        jacobian = ROBOT.jacobian(q)
        weight = np.diag([1 / 2e-8] * 3 + [1 / 1e-7] * 3)
        rows.append(weight @ jacobian @ np.diag(jacobian.T @ w))
        right.append(weight @ d)
    compliance = lstsq(np.vstack(rows), np.concatenate(right))[0]
    result = identify(data, ROBOT, robust=False)
    # What the linear equations leave out, K_C and the wrench's noise, is below 1e-3 of the error.
    difference = (1.0 / compliance - result.stiffness) / result.standard_deviation
    assert np.abs(difference).max() < 0.02


def test_errors_in_the_wrench_are_those_of_the_full_problem():
    """Against scipy with the true wrenches among the unknowns: orthogonal distance regression."""
    wrenches, joints = loads(5)
    noise, wrench_noise = np.repeat([5e-6, 2e-5], 3), 0.05
    data = made(TRUTH, wrenches, joints, (5e-6, 2e-5), wrench_noise, seed=5)
    result = identify(data, ROBOT, robust=False)

    def residuals(unknowns):
        law = Law(TRUTH * unknowns[:6], np.zeros(6))
        true = data.wrench + wrench_noise * unknowns[6:].reshape(-1, 6)
        rest = balance(ROBOT, joints, true, law, follows=False)
        start = ROBOT.posture(joints)
        turned = logarithm(rest.posture.rotation @ start.rotation.swapaxes(1, 2))
        moved = np.concatenate([rest.posture.position - start.position, turned], axis=1)
        return np.concatenate([((data.deflection - moved) / noise).ravel(), unknowns[6:]])

    full = least_squares(residuals, np.r_[np.ones(6), np.zeros(30)])
    difference = (TRUTH * full.x[:6] - result.stiffness) / result.standard_deviation
    assert np.abs(difference).max() < 0.1


def test_source_regression_is_pulled_down_by_the_trackers_noise():
    wrenches, joints = loads(400, seed=7)
    quiet = made(TRUTH, wrenches, joints, (1e-9, 1e-9))
    np.testing.assert_allclose(identify_as_source(quiet, ROBOT), TRUTH, rtol=5e-3)
    noisy = made(TRUTH, wrenches, joints, (16e-6, 136e-6), seed=8)
    attenuated = identify_as_source(noisy, ROBOT) / TRUTH
    here = identify(noisy, ROBOT)
    assert attenuated[0] < 0.7
    assert np.abs((here.stiffness - TRUTH) / here.standard_deviation).max() < 4.0


def test_cubic_terms_are_found_and_a_third_of_them_as_published(bench, harder):
    data = Bench(ROBOT, small_plan((0.5, 1.0)), harder).draw(1)
    exact, published = identify(data, ROBOT, "cubic"), identify(data, ROBOT, "as_published")
    assert exact.cubic_identifiable.all()
    error = (exact.cubic - np.array(harder.cubic)) / exact.cubic_deviation
    assert np.abs(error).max() < 4.0
    # 3 a d^3 for a d^3: joints 4 to 6, whose cubic terms are known to a few percent.
    ratio = published.cubic / np.array(harder.cubic)
    np.testing.assert_allclose(ratio[3:], 1 / 3, rtol=0.1)


def test_hysteresis_is_detected_and_does_not_bend_the_curve(bench):
    torque = TRUTH * np.abs(bench.deflection).max(axis=0)
    reach = np.abs(bench.deflection).max(axis=0)
    truth = replace(
        bench.truth,
        hysteresis_torque=list(0.04 * torque * [0, 0, 0, 1, 1, 1]),
        hysteresis_deflection=list(0.1 * reach),
    )
    result = identify(Bench(ROBOT, small_plan(), truth).draw(2), ROBOT)
    assert result.hysteretic[3:].all()
    np.testing.assert_allclose(result.friction[3:], truth.hysteresis_torque[3:], rtol=0.35)
    np.testing.assert_allclose(result.stiffness, TRUTH, rtol=0.02)


def test_outliers_are_found_and_left_out(samples):
    bad = np.array([7, 50, 123, 124])
    position = samples.position.copy()
    position[bad] += [3e-4, -2e-4, 4e-4]
    spoilt = replace(samples, position=position)
    result = identify(spoilt, ROBOT)
    assert set(bad) <= set(result.outliers)
    assert result.outliers.size <= bad.size + 1
    np.testing.assert_allclose(result.stiffness, TRUTH, rtol=0.02)


def test_data_of_another_robot_are_refused(samples):
    mixed = replace(samples, position=samples.position[::-1])
    result = identify(mixed, ROBOT, robust=False)
    assert result.residual_rms > 100.0


def test_no_number_for_a_joint_that_was_not_loaded():
    """Wrenches that load joint 1 alone say nothing of the other five."""
    joints = np.repeat(bench_configurations()[:1], 4, axis=0)
    unit = np.linalg.solve(ROBOT.jacobian(joints[0]).T, np.eye(6)[0])
    wrenches = np.outer([50.0, 100.0, 150.0, 200.0], unit)
    data = made(TRUTH, wrenches, joints, (2e-6, 1e-5), 1e-4)
    result = identify(data, ROBOT, "cubic")
    assert not result.identifiable[1:].any()
    assert np.isnan(result.stiffness[1:]).all()
    assert np.isnan(result.interval[1:]).all()
    assert np.isnan(result.cubic[1:]).all()
    linear = identify(data, ROBOT)
    np.testing.assert_array_equal(linear.identifiable, [True] + [False] * 5)
    assert np.isnan(np.diagonal(linear.covariance)[1:]).all()
    assert linear.stiffness[0] == pytest.approx(TRUTH[0], rel=0.05)


def test_online_ends_where_batch_does(samples):
    online = OnlineIdentifier(ROBOT, accuracy=0.02)
    assert not online.accurate
    first = samples.group < 3
    assert online.add(select(samples, np.flatnonzero(first)[:2])) is None
    assert "measure more loads" in online.reason
    online.add(select(samples, np.flatnonzero(first)[2:]))
    for group in np.unique(samples.group[~first])[::3]:
        online.add(select(samples, (samples.group >= group) & (samples.group < group + 3)))
    batch = identify(samples, ROBOT)
    # Both have converged to a millionth of a standard deviation.
    difference = (online.result.stiffness - batch.stiffness) / batch.standard_deviation
    assert np.abs(difference).max() < 1e-4
    assert online.accurate == (batch.relative_deviation_max <= 0.02)


def test_order_of_the_samples_does_not_matter(samples):
    shuffled = select(samples, np.random.default_rng(0).permutation(len(samples)))
    one, other = identify(samples, ROBOT), identify(shuffled, ROBOT)
    np.testing.assert_allclose(one.stiffness, other.stiffness, rtol=1e-9)


def test_poses_from_three_passes(bench, samples):
    with pytest.warns(PoseWarning, match="do not fit a rigid motion"):
        joined = poses(samples, ROBOT)
    assert (
        len(joined)
        == np.unique(
            samples.load[samples.branch != 0] + 1000 * samples.configuration[samples.branch != 0]
        ).size
    )
    result = identify(joined, ROBOT)
    np.testing.assert_allclose(result.stiffness, TRUTH, rtol=0.03)
    # The passes' wrenches differ by more than the noise, until a result makes up for it; until
    # then the poses' covariances are wider.
    assert result.residual_rms == pytest.approx(1.0, abs=0.3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        better = poses(samples, ROBOT, result)
    assert identify(better, ROBOT).residual_rms == pytest.approx(1.0, abs=0.15)
    wider = np.trace(joined.deflection_covariance, axis1=1, axis2=2).mean()
    assert wider > 1.3**2 * np.trace(better.deflection_covariance, axis1=1, axis2=2).mean()


def test_bumped_reflector_widens_the_poses_that_it_spoils(samples):
    result = identify(samples, ROBOT)
    bumped = (samples.reflector == 1) & (samples.load == 2) & (samples.branch != 0)
    assert bumped.any()
    moved = samples.position + np.where(bumped[:, None], [0.0, 0.0, 5e-4], 0.0)
    with pytest.warns(PoseWarning) as told:
        spoilt = poses(replace(samples, position=moved), ROBOT, result)
    right = poses(samples, ROBOT, result)
    ratio = spoilt.deflection_covariance[:, 0, 0] / right.deflection_covariance[:, 0, 0]
    hit = np.isin(right.load, 2)
    assert (ratio[hit] > 10.0).all()
    np.testing.assert_allclose(ratio[~hit], 1.0, rtol=1e-6)
    assert f"points: {hit.sum()} of" in str(told[0].message)


def test_model_is_chosen_on_held_out_loads(samples, harder):
    linear = choose_model(samples, ROBOT)
    assert linear.model == "linear"
    bent = choose_model(Bench(ROBOT, small_plan(), harder).draw(3), ROBOT)
    assert bent.model == "cubic"
    assert bent.held_out_error["cubic"] < 0.7 * bent.held_out_error["linear"]


def test_other_configurations_and_wrenches_are_predicted_within_the_band(samples):
    result = identify(samples, ROBOT)
    elsewhere = bench_configurations()[10:]
    other = Bench(ROBOT, ramps(elsewhere, random_peaks(ROBOT, elsewhere, 3, 11), (1.0,))).draw(4)
    found = validate(result, other, ROBOT)
    assert found.normalised_rms == pytest.approx(1.0, abs=0.2)
    assert found.explained > 0.99
    inside = np.abs(found.measured - found.predicted) <= found.band
    assert 0.9 < inside.mean() <= 1.0


@pytest.mark.parametrize("model", ["linear", "cubic"])
def test_result_file_keeps_every_number(samples, tmp_path, model):
    result = identify(samples, ROBOT, model)
    write_result(tmp_path / "result.yaml", result, ROBOT, {"provenance": {"bag": "x"}})
    read = read_result(tmp_path / "result.yaml")
    for name in ("stiffness", "covariance", "interval", "parameters", "parameter_covariance",
                 "joint_range", "friction", "identifiable", "cubic_identifiable"):  # fmt: skip
        np.testing.assert_array_equal(getattr(read, name), getattr(result, name))
    if model == "cubic":
        np.testing.assert_array_equal(read.cubic, result.cubic)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format: another", "expected 'cabols stiffness 1'"),
        ("format: cabols stiffness 1\nmodel: linear", "joints"),
        ("[]", "mapping"),
    ],
)
def test_bad_result_files_are_refused(tmp_path, text, message):
    path = tmp_path / "result.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        read_result(path)


def spoil(samples, name, index, value):
    array = np.array(getattr(samples, name), dtype=float)
    array[index] = value
    return {name: array}


@pytest.mark.parametrize(
    ("name", "index", "value", "message"),
    [
        ("wrench", (3, 1), np.nan, r"wrench: expected finite numbers, got nan at \[3, 1\]"),
        ("joints", (0, 0), np.inf, "joints: expected finite"),
        ("branch", 2, 3, r"branch: expected 1 \(loading\)"),
        ("load", 2, 0.5, "load: expected whole numbers"),
        ("position_covariance", (4, 0, 1), 1.0, r"position_covariance\[4\]: expected a symmetric"),
        ("position_covariance", (4, 0, 0), -1e-9, "positive definite"),
        ("wrench_covariance", (1, 2, 2), -1.0, "positive semidefinite"),
    ],
)
def test_bad_samples_are_refused(samples, name, index, value, message):
    with pytest.raises(ShapeError, match=message):
        replace(samples, **spoil(samples, name, index, value))


def test_wrong_shapes_are_refused(samples):
    with pytest.raises(ShapeError, match=r"wrench: expected shape"):
        replace(samples, wrench=samples.wrench[:-1])
    with pytest.raises(ShapeError, match=r"joints: expected shape"):
        identify(replace(samples, joints=samples.joints[:, :5]), ROBOT)
    with pytest.raises(CabolsError, match="one of linear"):
        identify(samples, ROBOT, "quadratic")
    with pytest.raises(IdentificationError, match="measure more loads"):
        identify(select(samples, np.arange(3)), ROBOT)
    with pytest.raises(IdentificationError):
        identify(select(samples, np.arange(0)), ROBOT)
    with pytest.raises(CabolsError, match="one kind"):
        concatenate([])
