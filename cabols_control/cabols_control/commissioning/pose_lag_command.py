# SPDX-License-Identifier: Apache-2.0
"""Identify how late the robot's poses are, from a recorded motion under load.

The robot has to move while the cables pull, best to and fro at 50 mm/s: see the action follow_path.
The lag found is of the stamps as recorded: it replaces `pose_lag` in the rig's control.yaml.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from cabols_control.bags.reader import Bag, read_bag
from cabols_control.checks import BoolArray, FloatArray
from cabols_control.command_line import DONE, CommandParser, command, rig_option
from cabols_control.commissioning.pose_lag import PoseLagError, PoseRecording, identify_pose_lag
from cabols_control.rig import load_rig
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


@command
def main() -> int:
    """Print the lag of a bag's poses; returns 0, or 1 if it says nothing about it."""
    parser = CommandParser("pose_lag", __doc__)
    parser.add_argument("bag", type=Path, help="folder of the bag")
    rig_option(parser)
    options = parser.parse_args()
    try:
        found = identify_pose_lag(
            load_rig(options.rig), recording_of(read_bag(options.bag, TOPICS))
        )
    except PoseLagError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(f"pose_lag: {found.lag:.4f}   # s, +- {found.deviation:.4f} by parts of the recording")
    print(
        f"  sensor and cables differ by {found.residual:.2f} N rms with it, by "
        f"{found.residual_without:.2f} N with none"
    )
    return DONE


if __name__ == "__main__":
    raise SystemExit(main())
