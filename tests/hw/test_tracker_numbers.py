# SPDX-License-Identifier: Apache-2.0
"""What a tracker's server reports, held against what is known before."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cabols_hw.ros.tracker_messages import status_notes, warm_up_note
from cabols_hw.tracker import tracker_pb2 as pb
from cabols_hw.tracker.beam import predicted_covariance
from cabols_hw.tracker.config import load_tracker_config
from cabols_hw.tracker.plausibility import AskedFor, measure_fault, time_fault

CONFIG = load_tracker_config()
POINT = np.array([4.0, 0.3, 0.1])
HOUR_NS = 3_600_000_000_000


def reply(**changes):
    values = {
        "success": True,
        "rms_m": 20e-6,
        "samples": 500,
        "averaging_time_s": 0.5,
        "time_ns": time.time_ns(),
    }
    return pb.MeasureReply(**{**values, **changes})


def covariance_fault(covariance, **changes):
    return measure_fault(reply(**changes), covariance, POINT, CONFIG)


TRUE = predicted_covariance(POINT, CONFIG.noise, 0.1)


@pytest.mark.parametrize("samples", [1, 10, 1000, 100_000])
@pytest.mark.parametrize("rms", [0.0, 5e-6, 30e-6, 80e-6])
def test_honest_covariance_is_taken(samples, rms):
    floor = CONFIG.averaging_floor**2
    honest = predicted_covariance(POINT, CONFIG.noise, floor + (1.0 - floor) / samples)
    assert covariance_fault(honest, samples=samples, rms_m=rms) == ""


@pytest.mark.parametrize(
    "wrong",
    [1e6 * TRUE, 1e12 * TRUE, np.eye(3) * 1e-30, np.eye(3) * 1e30, np.diag([5e-6, 2e-5, 2e-5])],
    ids=["mm2", "um2", "1e-30", "1e30", "deviations"],
)
def test_covariance_in_other_units_is_refused(wrong):
    assert "covariance" in covariance_fault(wrong)


@settings(max_examples=200)
@given(st.floats(-40.0, 40.0).filter(lambda x: abs(x) > 4.5))
def test_no_power_of_ten_beside_the_truth_is_taken(exponent):
    assert covariance_fault(10.0**exponent * TRUE)


@pytest.mark.parametrize("factor", [0.1, 0.5, 2.0, 4.0])
def test_covariance_near_the_noise_is_taken(factor):
    assert covariance_fault(factor * TRUE) == ""


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"samples": 0}, "sample"),
        ({"rms_m": 3e-3}, "rms"),
        ({"rms_m": float("nan")}, "rms"),
        ({"rms_m": -1e-6}, "rms"),
        ({"reason": pb.REASON_BEAM_BROKEN}, "contradicts"),
    ],
)
def test_odd_answer_says_what_is_odd(changes, word):
    assert word in measure_fault(reply(**changes), None, POINT, CONFIG)


@pytest.mark.parametrize(
    ("changes", "asked", "word"),
    [
        ({"averaging_time_s": 0.05}, AskedFor(0.5), "averaging time"),
        ({"averaging_time_s": 500.0}, AskedFor(0.5), "averaging time"),
        ({"averaging_time_s": float("nan")}, AskedFor(0.5), "averaging time"),
        ({"time_ns": time.time_ns() - HOUR_NS}, AskedFor(0.5), "old measurement"),
        ({"time_ns": 5 * HOUR_NS}, AskedFor(0.5, clock_ns=6 * HOUR_NS), "tracker's clock"),
        ({"time_ns": 5 * HOUR_NS}, AskedFor(0.5, before_ns=5 * HOUR_NS), "once more"),
    ],
)
def test_measurement_of_another_time_is_refused(changes, asked, word):
    assert word in time_fault(reply(**changes), asked, 1.0)


@pytest.mark.parametrize(
    ("changes", "asked"),
    [
        ({"averaging_time_s": 0.495}, AskedFor(0.5)),
        ({"averaging_time_s": 0.0}, AskedFor(0.5)),
        ({"time_ns": 0}, AskedFor(0.5)),
        ({"time_ns": 5 * HOUR_NS}, AskedFor(0.5, clock_ns=5 * HOUR_NS + 300_000_000)),
    ],
    ids=["first to last sample", "averaging not told", "time not told", "a clock of its own"],
)
def test_measurement_of_now_is_taken(changes, asked):
    assert time_fault(reply(**changes), asked, 1.0) == ""


@pytest.mark.parametrize(
    ("drift_m", "word"), [(12e-6, "12 um"), (float("nan"), "1000000 um"), (-1.0, "1000000 um")]
)
def test_warm_up_is_told_with_its_drift(drift_m, word):
    warm = pb.Status(warming_up=False, expected_drift_m=1e-6, on_time_s=9000.0)
    cold = pb.Status(warming_up=True, expected_drift_m=drift_m, on_time_s=60.0)
    assert warm_up_note(warm) is None
    assert word in warm_up_note(cold).reason
    assert status_notes(cold)["tracker_warming_up"] == 1
