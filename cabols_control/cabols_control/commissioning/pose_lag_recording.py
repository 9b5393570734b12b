# SPDX-License-Identifier: Apache-2.0
"""What the identification of the poses' lag takes from a bag."""

from __future__ import annotations

import numpy as np

from cabols_control.bags.reader import Bag
from cabols_control.checks import BoolArray, FloatArray
from cabols_control.commissioning.pose_lag import PoseLagError, PoseRecording
from cabols_control.supervision.modes import LOADED

TOPICS = ("limb_state", "wrench", "platform_pose")
FORCE = [f"wrench.{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz"]
POSE = [f"pose.position.{axis}" for axis in "xyz"] + [f"pose.orientation.{axis}" for axis in "xyzw"]


def recording_of(bag: Bag) -> PoseRecording:
    """Collect what a bag has of a motion under load.

    Args:
        bag: with limb_state, wrench and platform_pose.

    Raises:
        BagError, PoseLagError: if topics, or samples under load, are missing.
    """
    states, wrenches, poses = (bag[name] for name in TOPICS)
    stamps, left, right = np.intersect1d(
        states.stamp_ns, wrenches.stamp_ns, assume_unique=False, return_indices=True
    )
    loaded: BoolArray = np.isin(np.asarray(states["mode"])[left], [int(mode) for mode in LOADED])
    if not loaded.any():
        raise PoseLagError(
            "expected samples in LOADING, got none: the robot has to move under load"
        )
    wrench: FloatArray = np.column_stack([wrenches[field] for field in FORCE])[right]
    wound = np.asarray(states["wound_length"], dtype=np.float64)[left]
    return PoseRecording(
        time=np.multiply(1e-9, stamps[loaded] - bag.start_ns, dtype=np.float64),
        wound=wound[loaded],
        wrench=wrench[loaded],
        pose_time=np.multiply(1e-9, poses.stamp_ns - bag.start_ns, dtype=np.float64),
        pose=np.column_stack([poses[field] for field in POSE]),
    )
