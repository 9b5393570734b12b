"""Verdicts name what is wrong, and survive a file; the data are of an independent robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

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
