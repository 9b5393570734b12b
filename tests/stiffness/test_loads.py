# SPDX-License-Identifier: Apache-2.0
"""From measured loads to the stiffness: the tracker's registration and the passes agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench.long_bag import NOISE_M, NOISE_N, NOISE_NM, TRUE, LongCampaign

from cabols_stiffness.identification.iterate import identify_loads
from cabols_stiffness.identification.running import RunningIdentification
from cabols_stiffness.measurements.measured_load import MeasuredLoad
from cabols_stiffness.measurements.reflector_points import frames_of, robot_of
from cabols_stiffness.measurements.window import WindowAverage

SAMPLES = 101
SCALE = np.repeat([NOISE_N, NOISE_NM], 3)


@pytest.fixture(scope="module")
def campaign():
    return LongCampaign()


@pytest.fixture(scope="module")
def loads(campaign):
    """The bench's campaign once, 150 loads, with the tracker's and the sensor's noise."""
    random = np.random.default_rng(5)
    found = []
    for message, joints, wrench, point in campaign.loads(150):
        window = wrench + SCALE / np.sqrt(SAMPLES) * random.standard_normal(6)
        covariance = np.diag(SCALE**2) / SAMPLES
        begin_ns = 2_000_000_000 * len(found)
        found.append(
            MeasuredLoad(
                *(message.configuration, message.reflector, message.load, message.group),
                message.branch,
                begin_ns,
                begin_ns + 100_000_000,
                np.array(message.tension),
                WindowAverage(window, covariance, SCALE, joints, SAMPLES),
                point + NOISE_M * random.standard_normal(3),
                NOISE_M**2 * np.eye(3),
            )
        )
    return found


def test_truth_is_found_within_its_deviations(campaign, loads):
    # The long bag's tool has no weight.
    rig = replace(campaign.plan.rig, tool_mass=0.0)
    result = identify_loads(loads, rig, robot_of(rig)).result
    assert result.identifiable.all()
    error = (result.stiffness - TRUE) / result.standard_deviation
    assert np.abs(error).max() < 4.0
    assert result.relative_deviation_max < 0.006


def test_estimate_that_grew_is_that_of_all_loads_at_once(campaign, loads):
    running = RunningIdentification(campaign.plan)
    for begin in range(0, 150, 10):
        running.add(loads[begin : begin + 10])
    at_once = identify_loads(loads, campaign.plan.rig, robot_of(campaign.plan.rig)).result
    assert running.count == 150
    np.testing.assert_allclose(running.result.stiffness, at_once.stiffness, rtol=1e-8)
    np.testing.assert_allclose(
        running.result.standard_deviation, at_once.standard_deviation, rtol=1e-6
    )


def test_too_few_loads_give_a_reason_not_a_number(campaign, loads):
    running = RunningIdentification(campaign.plan)
    assert running.add(loads[:3]) is None
    assert "expected more than" in running.reason


def test_tracker_that_stands_elsewhere_is_registered(campaign, loads):
    rig = campaign.plan.rig
    turned = replace(
        rig,
        tracker_position=[0.605, 3.947, 1.102],
        tracker_rotation_xyz_deg=[0.05, -0.05, -101.9],
    )
    robot = robot_of(rig)
    result = identify_loads(loads, rig, robot).result
    frames = frames_of(loads, turned, robot, result.parameters)
    assert frames.poses == 10
    assert frames.residual < 3.0 * NOISE_M
    np.testing.assert_allclose(frames.position, rig.tracker_position, atol=3e-4)
    np.testing.assert_allclose(frames.reflectors, rig.reflectors, atol=2e-5)
    few = [load for load in loads if load.configuration in campaign.plan.configurations[:3]]
    assert frames_of(few, turned, robot).poses == 0, "three configurations are not enough"
