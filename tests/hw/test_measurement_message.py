# SPDX-License-Identifier: Apache-2.0
"""A measurement says what was done: averaging time, samples and the middle of them."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from cabols_msgs.action import MeasureReflector

from cabols_hw.ros.tracker_messages import measurement_message
from cabols_hw.tracker.client import TrackerClient
from cabols_hw.tracker.config import load_tracker_config
from cabols_hw.tracker.reading import failed
from cabols_sim.devices.tracker.config import load_tracker_truth
from cabols_sim.devices.tracker.server import TrackerServer

RECORD = np.dtype(
    [
        ("time_ns", "i8"),
        ("position", "f8", 3),
        ("rotation", "f8", (3, 3)),
        ("speed", "f8"),
        ("beam_blocked", "u1"),
    ]
)

RATE = 1000.0
"""The tracker's own, of single samples [Hz]."""


class StandingRig:
    """The truth's seam: a platform that stands; each look lets 10 ms of the rig's time pass."""

    def __init__(self):
        self.record = np.zeros(1, RECORD)
        self.record["position"] = [0.0, 1.234615, 0.792718]
        self.record["rotation"] = np.eye(3)

    def newest(self):
        self.record["time_ns"] += 10_000_000
        return self.record[0].copy()


@pytest.fixture
def measure():
    rig, config = StandingRig(), load_tracker_config()
    server = TrackerServer(rig, load_tracker_truth())
    address = f"127.0.0.1:{server.start()}"
    pose = rig.record["position"][0], rig.record["rotation"][0]
    with TrackerClient(address, config, lambda i: config.expected(i, *pose)) as client:
        yield lambda averaging_s: client.measure(1, averaging_s)
    server.stop()


@pytest.mark.parametrize("asked", [0.0, 0.02, 0.3])
def test_what_was_averaged_is_said_also_where_nothing_was_asked_for(measure, asked):
    began_ns = time.time_ns()
    reading = measure(asked)
    took_ns = time.time_ns() - began_ns
    assert reading.reason == ""
    config = load_tracker_config()
    seconds = asked or config.averaging_time
    goal = MeasureReflector.Goal(reflector=1, averaging_time=asked)
    message = measurement_message(goal, reading, "", reading.middle_ns, "tracker")
    assert message.success
    assert message.averaging_time == pytest.approx(seconds, abs=2.0 / RATE)
    assert message.samples == pytest.approx(seconds * RATE, abs=2.0)
    stamp_ns = 1_000_000_000 * message.header.stamp.sec + message.header.stamp.nanosec
    assert stamp_ns == reading.middle_ns
    # The middle lies half the averaging time before an answer that came within the call.
    half_ns = round(0.5e9 * message.averaging_time)
    assert began_ns - half_ns <= stamp_ns <= began_ns + took_ns - half_ns


def test_what_failed_was_not_averaged():
    goal = MeasureReflector.Goal(reflector=2, averaging_time=0.5)
    for reading in (failed("beam broken"), None):
        message = measurement_message(goal, reading, "no answer", 12, "tracker")
        assert not message.success
        assert (message.averaging_time, message.samples) == (0.0, 0)
        assert np.isnan(message.position.x)
        assert message.reason == ("beam broken" if reading else "no answer")


def test_a_server_that_does_not_say_how_long_has_done_as_it_was_asked(measure, monkeypatch):
    call = TrackerClient._call

    def silent(self, name, request, timeout_s):
        answer = call(self, name, request, timeout_s)
        if name == "Measure":
            answer.averaging_time_s = 0.0
        return answer

    monkeypatch.setattr(TrackerClient, "_call", silent)
    assert measure(0.3).averaging_s == 0.3
    assert replace(measure(0.3), middle_ns=0).samples > 1
