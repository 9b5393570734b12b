# SPDX-License-Identifier: Apache-2.0
"""Verdicts name what is wrong, and survive a file; the data are of an independent robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import independent_arm as arm
from cabols_stiffness import identify, load_robot
from cabols_stiffness.model.result_file import read_result, write_result
from cabols_stiffness.model.verdict import Grade, Suspect


@pytest.fixture(scope="module")
def samples():
    rng, chain = np.random.default_rng(7), arm.Chain()
    Q, W = arm.configurations(rng, 6), arm.loads(rng, 4)
    columns = arm.truth(Q, W, lambda i, q, w: chain.settle(q, w))
    return arm.noisy(columns, np.random.default_rng(8))


def mirrored(samples):
    flip = np.diag([1.0, -1.0, 1.0])
    return replace(samples, position=samples.position @ flip)


@pytest.mark.parametrize(
    ("change", "suspect"),
    [
        (lambda s: replace(s, wrench=-s.wrench), Suspect.SIGN),
        (lambda s: replace(s, wrench=s.wrench * [1, 1, 1, 1e3, 1e3, 1e3]), Suspect.UNIT),
        (lambda s: replace(s, joints=np.degrees(s.joints)), Suspect.UNIT),
        (mirrored, Suspect.AXES),
        (lambda s: replace(s, wrench=1e-3 * s.wrench), Suspect.MAGNITUDE),
    ],
)
def test_what_is_wrong_with_the_data_is_named_first(samples, change, suspect):
    verdict = identify(change(samples), arm.robot()).verdict
    assert not verdict.adequate
    assert verdict.findings[0].suspect is suspect


def test_tool_point_is_named(samples):
    off = load_robot(tool_position=[0.0, 0.02, 0.15])
    verdict = identify(samples, off).verdict
    assert verdict.grade is Grade.DOUBTFUL
    assert verdict.findings[0].suspect is Suspect.TOOL_POINT


def test_good_data_have_a_good_verdict_that_a_file_keeps(samples, tmp_path):
    result = identify(samples, arm.robot())
    verdict = result.verdict
    assert verdict.grade is Grade.GOOD
    assert verdict.explained > 0.99
    assert verdict.share_of_joint.sum() == pytest.approx(1.0, abs=1e-6)
    assert verdict.leave_one_out.shape == (6, 6)
    assert verdict.cochran_freedom == 30
    write_result(tmp_path / "result.yaml", result, arm.robot())
    read = read_result(tmp_path / "result.yaml").verdict
    assert read.grade is verdict.grade
    assert read.chi_square == verdict.chi_square
    assert read.findings == verdict.findings
    np.testing.assert_array_equal(read.leave_one_out, verdict.leave_one_out)


@pytest.mark.parametrize("seed", range(3))
def test_stiffness_that_varies_with_the_angle_is_seen_where_data_show_it(seed):
    """Joint 2 by 0.6 sin(q), at ten configurations within +-0.8 rad: each its own, mean covered."""
    rng, chain = np.random.default_rng(seed), arm.Chain()
    Q, W = arm.configurations(rng, 10), arm.loads(rng, 4)
    Q[:, 1] = rng.permutation(np.linspace(-0.8, 0.8, 10))
    stiffness = np.tile(arm.STIFFNESS, (10, 1))
    stiffness[:, 1] *= 1.0 + 0.6 * np.sin(Q[:, 1])
    columns = arm.truth(Q, W, lambda i, q, w: chain.settle(q, w, stiffness[i]))
    result = identify(arm.noisy(columns, np.random.default_rng(5)), arm.robot())
    assert result.verdict.grade is Grade.SCATTERED
    assert result.verdict.scatter[1] > 0.15
    mean = 1.0 / np.mean(1.0 / stiffness, axis=0)
    assert np.all(np.abs(result.stiffness - mean) < 3.0 * result.standard_deviation)


def test_six_near_configurations_cannot_show_it():
    """What tests/cases asks of these data: noise of their size hides it, whoever looks."""
    rng, chain = np.random.default_rng(11), arm.Chain()
    Q, W = arm.configurations(rng, 6), arm.loads(rng, 4)
    stiffness = np.tile(arm.STIFFNESS, (6, 1))
    stiffness[:, 1] *= 1.0 + 0.6 * np.sin(Q[:, 1])
    columns = arm.truth(Q, W, lambda i, q, w: chain.settle(q, w, stiffness[i]))
    quiet = {"position_m": 1e-9, "force_n": 1e-6, "torque_nm": 1e-7}
    exact, stated = (arm.noisy(columns, np.random.default_rng(5), **kind) for kind in (quiet, {}))
    samples = replace(
        exact,
        position_covariance=stated.position_covariance,
        wrench_covariance=stated.wrench_covariance,
    )
    result = identify(samples, arm.robot(), robust=False, judged=False)
    misfit = result.residual_rms**2 * result.degrees_of_freedom
    # One parameter at a chance of 1e-4, the best that any test of this effect alone could do.
    assert misfit < chi2.isf(1e-4, 1)
