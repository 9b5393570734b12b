# SPDX-License-Identifier: Apache-2.0
"""Mistakes too small to be seen for certain: named, or held by the deviations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import cabols_stiffness.identification.adequacy.small_mistakes as room
import stiffness_lab as lab
from cabols_stiffness import identify
from cabols_stiffness.identification.adequacy.small_mistakes import NONE, SIZES, SmallMistakes
from cabols_stiffness.identification.adequacy.suspects import suspects
from cabols_stiffness.identification.identify import estimate
from cabols_stiffness.identification.observations import Observations
from cabols_stiffness.model.balance import Law
from cabols_stiffness.model.model_words import LINEAR
from cabols_stiffness.model.verdict import Suspect

STEP = 1e-5


def test_average_is_that_of_whole_normal_models():
    """Against densities of scipy, with a vague prior in place of none for the base's parameters."""
    rng = np.random.default_rng(3)
    base, columns = rng.normal(size=(40, 3)), 100.0 * rng.normal(size=(40, 2))
    target, variance, vague = rng.normal(size=40) + columns @ [0.02, -0.01], 1.3, 1e3
    mistakes = SmallMistakes(base, target, variance)
    mistakes.add(Suspect.TOOL_POINT, columns)
    mistakes.add(Suspect.PLAY, columns)  # none of those with sizes
    found = mistakes.doubt(3)

    def whole(deviation):
        both = np.hstack([base, columns])
        prior = np.diag([vague**2] * 3 + [deviation**2] * 2)
        spread = both @ prior @ both.T + variance * np.eye(40)
        evidence = multivariate_normal(np.zeros(40), spread).logpdf(target)
        inverse = np.diag(1.0 / np.maximum(np.diag(prior), 1e-20))
        after = np.linalg.inv(both.T @ both / variance + inverse)
        return evidence, (after @ both.T @ target / variance)[:3], after[:3, :3]

    plain = whole(0.0)
    models = [whole(deviation) for deviation in SIZES[Suspect.TOOL_POINT]]
    ratio = np.array([(1 - NONE) / len(models) / NONE * np.exp(m[0] - plain[0]) for m in models])
    weight = ratio / (1.0 + ratio.sum())
    wanted = np.zeros((3, 3))
    for share, model in zip(weight, models, strict=True):
        change = model[1] - plain[1]
        wanted += max(share - (1 - NONE) / len(models), 0.0) * (
            np.outer(change, change) + model[2] - plain[2]
        )
    assert found.probability[Suspect.TOOL_POINT] == pytest.approx(weight.sum(), rel=1e-3)
    np.testing.assert_allclose(found.covariance, wanted, rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("reflectors", [0, 1])
def test_columns_of_a_joints_zero_are_derivatives(reflectors):
    design = lab.Design(reflectors=reflectors, configurations=3)
    samples, robot, _ = lab.measure(design, np.random.default_rng(1))
    observations = Observations(samples, robot)
    found, _, _ = estimate(observations, LINEAR, hysteresis=False)
    columns = suspects(observations, found, False)[Suspect.JOINT_ZERO]
    law = Law(1.0 / found.parameters.compliance, found.parameters.cubic)
    for j in range(robot.n):
        sides = []
        for sign in (-1.0, 1.0):
            joints = samples.joints.copy()
            joints[:, j] += sign * STEP
            sides.append(
                Observations(replace(samples, joints=joints), robot).linearise(law).residual
            )
        wanted = (sides[0] - sides[1]) / (2.0 * STEP)
        error = np.abs(columns[:, :, j] - wanted).max()
        assert error < 2e-2 * np.abs(found.line.motion).max() * np.abs(found.deflection).max()


def test_a_gain_of_the_whole_sensor_adds_nothing():
    """It is a factor of all compliances: no misfit sees it, and the summary states it."""
    samples, robot, _ = lab.measure(lab.Design(configurations=8), np.random.default_rng(2))
    observations = Observations(samples, robot)
    found, _, _ = estimate(observations, LINEAR, hysteresis=False)
    base = found.columns.reshape(-1, robot.n)
    common = np.tile(base.sum(axis=1)[:, None], (1, 6)) / 6.0
    mistakes = SmallMistakes(base, np.zeros(len(base)), 1.0)
    mistakes.add(Suspect.WRENCH_GAIN, common)
    assert np.abs(mistakes.doubt(robot.n).covariance).max() < 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_a_tool_point_a_little_off_is_refused_or_held(seed):
    design = lab.Design(configurations=8, loads=6, size=1.0)
    samples, robot, true = lab.measure(design, np.random.default_rng([seed, 6]))
    point = robot.tool_position + np.array([3e-3, -3e-3, 2e-3])
    moved = robot.with_tool(point, robot.tool_rotation)
    found = identify(samples, moved)
    far = np.abs(found.stiffness - true[0]) / found.standard_deviation
    assert not found.adequate or np.all(far[found.identifiable] < 4.0)


@pytest.mark.parametrize("seed", range(3))
def test_deviations_of_good_data_stay(seed, monkeypatch):
    design = lab.Design(configurations=8, loads=6, size=1.0)
    samples, robot, _ = lab.measure(design, np.random.default_rng([seed, 6]))
    found = identify(samples, robot)
    monkeypatch.setattr(room, "NONE", 1.0 - 1e-15)
    plain = identify(samples, robot)
    ratio = found.standard_deviation / plain.standard_deviation
    assert found.adequate
    assert np.all(ratio > 1.0 - 1e-9)
    assert np.max(ratio) < 1.3
