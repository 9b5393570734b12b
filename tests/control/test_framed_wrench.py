# SPDX-License-Identifier: Apache-2.0
"""Wrenches told in a frame of the rig are of the pose at their sample, in every mode."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("rclpy")

from cabols_msgs.msg import FrameWrench
from rclpy.serialization import deserialize_message

from cabols_control.frames import load_wrench_frames, load_wrench_uncertainty
from cabols_control.geometry import load_geometry
from cabols_control.ros.framed_wrench import TOLD_EVERY, FrameWrenchOutput


class Node:
    """Keeps what is published."""

    def __init__(self):
        self.sent = []

    def advertise_live(self, topic):
        assert topic == "frame_wrench"
        return self

    def copy(self):
        """The slow copy is the middleware's."""

    def publish(self, raw):
        self.sent.append(deserialize_message(bytes(raw), FrameWrench))


@pytest.mark.parametrize("name", ["base", "platform", "flange", "sensor"])
def test_wrenches_are_told_at_the_pose_of_the_sample(name):
    """Nothing has placed the frame before: the rig need not be in LOADING."""
    geometry = load_geometry()
    frames, node = load_wrench_frames(geometry), Node()
    output = FrameWrenchOutput(node, frames, load_wrench_uncertainty(frames))
    rng = np.random.default_rng(3)
    for _ in range(3):
        position = geometry.reference_position + rng.uniform(-0.1, 0.1, 3)
        pose = position, Rotation.from_rotvec(rng.uniform(-0.3, 0.3, 3)).as_matrix()
        wrenches = rng.uniform(-20.0, 20.0, (2, 6))
        for _ in range(TOLD_EVERY):
            output.tell(
                1_000_000, frames.names[0] if name == "base" else name, pose, np.zeros(3), *wrenches
            )
        told = node.sent[-1]
        for message, wrench in zip((told.desired, told.measured), wrenches, strict=True):
            parts = (message.force, message.torque)
            found = [getattr(part, axis) for part in parts for axis in "xyz"]
            assert found == pytest.approx(frames.from_base(name, wrench, *pose), abs=1e-12)
        known = [getattr(told.uncertainty.force, axis) for axis in "xyz"]
        known += [getattr(told.uncertainty.torque, axis) for axis in "xyz"]
        assert np.isfinite(known).all()
        assert min(known) > 0.0
    assert len(node.sent) == 3
