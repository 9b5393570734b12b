# SPDX-License-Identifier: Apache-2.0
"""Numbers of a peer, fits and references: compared with what is known before they are used."""

from __future__ import annotations

import time
from concurrent import futures

import grpc
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.registration.reflectors import register_frame
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.card.daq import CardSample
from cabols_hw.tracker import tracker_pb2 as pb
from cabols_hw.tracker.client import TrackerClient
from cabols_hw.tracker.config import load_tracker_config
from cabols_hw.tracker.tracker_pb2_grpc import (
    LaserTrackerServicer,
    add_LaserTrackerServicer_to_server,
)
from cases import outcome

POINT = np.array([2.6, 0.02, -0.3])
BIAS = np.array([0.1, -0.2, 0.3, 0.0, 0.05, -0.1])
"""Of the unloaded gauges [V]."""


class Tracker(LaserTrackerServicer):
    """Says what it is told to say of its covariance, beside an rms of 5 um over 100 samples."""

    def __init__(self):
        self.variance = (0.0, 0.0, 0.0)

    def Aim(self, request, context):  # noqa: N802
        return pb.BeamReply(success=True, position_m=pb.Vector3(x=POINT[0], y=POINT[1], z=POINT[2]))

    def Measure(self, request, context):  # noqa: N802
        x, y, z = self.variance
        return pb.MeasureReply(
            success=True,
            position_m=pb.Vector3(x=POINT[0], y=POINT[1], z=POINT[2]),
            rms_m=5e-6,
            samples=100,
            averaging_time_s=request.averaging_time_s,
            temperature_c=20.0,
            time_ns=time.time_ns(),
            covariance_m2=pb.Symmetric3(xx=x, yy=y, zz=z),
        )


@pytest.fixture
def measure():
    """Measures with a tracker that reports a (3,) variance [m2]; the reading or the error."""
    tracker, server = Tracker(), grpc.server(futures.ThreadPoolExecutor(2))
    add_LaserTrackerServicer_to_server(tracker, server)
    port = server.add_insecure_port("127.0.0.1:0")
    server.start()
    with TrackerClient(f"127.0.0.1:{port}", load_tracker_config()) as client:

        def ask(variance):
            tracker.variance = variance
            return outcome(lambda: client.measure(0, 0.5, expected=POINT))

        yield ask
    server.stop(0)


def test_covariance_that_fits_its_rms_is_taken(measure):
    assert measure((1e-12,) * 3).success


@pytest.mark.parametrize(
    "variance",
    [(1e-6,) * 3, (1e-6, 2e-6, 2e-6), (1e-30,) * 3],
    ids=["in mm2", "standard deviations", "1e-30 m2"],
)
def test_covariance_that_does_not_fit_its_rms_is_refused(measure, variance):
    reading = measure(variance)
    assert isinstance(reading, Exception) or not reading.success


def register(bump_m):
    """Frame of a tracker that is bumped along x after four of eight poses; or the error."""
    rng = np.random.default_rng(0)
    reflectors = np.array([[0.10, 0.02, 0.03], [-0.08, 0.09, 0.0], [0.01, -0.11, 0.05]])
    turn = Rotation.from_euler("xyz", [2, -3, 170], degrees=True).as_matrix()
    positions, rotations, measured = [], [], []
    for k in range(8):
        angles = rng.uniform(-25, 25, 3)
        rotation = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        position = np.array([1.0, 0.0, 1.0]) + rng.uniform(-0.2, 0.2, 3)
        seen = (position + reflectors @ rotation.T - [3.0, 0.5, 0.2]) @ turn
        seen += rng.normal(0.0, 8e-6, (3, 3))
        positions.append(position)
        rotations.append(rotation)
        measured.append(seen + ([bump_m, 0.0, 0.0] if k >= 4 else [0.0] * 3))
    covariance = np.broadcast_to(np.eye(3) * 64e-12, (8, 3, 3, 3))
    return outcome(
        lambda: register_frame(
            positions,
            rotations,
            reflectors,
            np.array(measured),
            covariance,
            pose_covariance=np.eye(6) * 1e-10,
        )
    )


def test_frame_of_a_quiet_tracker_fits():
    found = register(0.0)
    assert found.converged
    assert found.probability > 0.01


def test_frame_of_a_tracker_that_was_bumped_is_not_usable():
    found = register(0.5e-3)
    assert isinstance(found, Exception) or not found.converged


def test_tare_under_load_is_refused(card, rig):
    """UniversalRobots/Universal_Robots_ROS_Driver#512, #670: 45 N in each cable, 100 N on all."""
    bridge = Bridge(rig, card)

    def take(counts, volts, slack, mode, times=1):
        for _ in range(times):
            encoders = np.full(8, counts, dtype=np.int64)
            bridge.take(CardSample(0, encoders, np.array(volts), np.full(8, slack)), mode)

    take(0, BIAS, True, OperatingMode.STOPPED, card.tare_samples)
    take(0, BIAS, True, OperatingMode.PRETIGHTENING)
    zero = int(0.005 * card.counts_per_metre)
    take(zero, BIAS, False, OperatingMode.PRETIGHTENING)
    tight = zero + int(40.0 / rig.limbs.stiffness * card.counts_per_metre)
    loaded = BIAS + np.linalg.solve(card.ft_matrix, [0, 0, 100.0, 0, 0, 2.0])
    take(tight, loaded, False, OperatingMode.STOPPED)
    assert np.all(bridge.tension > 30.0)
    assert bridge.wrench[2] == pytest.approx(100.0, abs=0.1), "the fixture's own load"
    outcome(bridge.tare)
    take(tight, loaded, False, OperatingMode.STOPPED, card.tare_samples)
    assert abs(bridge.wrench[2]) > 50.0
