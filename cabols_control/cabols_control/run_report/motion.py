# SPDX-License-Identifier: Apache-2.0
"""The robot's motion in a bag: platform, joints, the laser tracker's measurements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.bags.reader import Bag, Series
from cabols_control.checks import BoolArray, FloatArray, IntArray

POSITION = tuple(f"pose.position.{axis}" for axis in "xyz")
SPEED_OVER_S = 0.04
"""Time over which a speed is averaged [s]: ten packets of the robot, for little noise."""


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """The robot's motion; p poses, q joint states, r measurements. Times as in BenchRun.

    Attributes:
        pose_time: (p,) in order [s].
        position: (p, 3) of the platform's origin, base axes [m].
        joint_time: (q,) in order [s].
        joints: (q, m) encoders' angles [rad].
        measured_time: (r,) of the reflector measurements that succeeded [s].
        packets_lost: of the robot's stream, as its bridge counted; None without a bridge.
    """

    pose_time: FloatArray
    position: FloatArray
    joint_time: FloatArray
    joints: FloatArray
    measured_time: FloatArray
    packets_lost: int | None

    def speed(self) -> tuple[FloatArray, FloatArray]:
        """Times (s,) [s] and speeds (s,) of the platform's origin [m/s]; empty without poses."""
        rows = self._rows_apart()
        time, position = self.pose_time[rows], self.position[rows]
        way = np.linalg.norm(np.diff(position, axis=0), axis=1)
        return 0.5 * (time[1:] + time[:-1]), way / np.diff(time)

    def way(self) -> float:
        """Length of the path of the platform's origin [m]."""
        position = self.position[self._rows_apart()]
        return float(np.linalg.norm(np.diff(position, axis=0), axis=1).sum())

    def within(self, start: float, end: float) -> RecordedMotion:
        """Return the part from start to end [s].

        Args:
            start: [s].
            end: [s].
        """
        pose, joint, measured = (
            _inside(time, start, end)
            for time in (self.pose_time, self.joint_time, self.measured_time)
        )
        return RecordedMotion(
            self.pose_time[pose],
            self.position[pose],
            self.joint_time[joint],
            self.joints[joint],
            self.measured_time[measured],
            self.packets_lost,
        )

    def _rows_apart(self) -> IntArray:
        """Rows of the first pose in each stretch of SPEED_OVER_S."""
        if not self.pose_time.size:
            return np.zeros(0, np.int64)
        stretch = np.floor((self.pose_time - self.pose_time[0]) / SPEED_OVER_S + 1e-6)
        return np.unique(stretch, return_index=True)[1]


def _inside(time: FloatArray, start: float, end: float) -> BoolArray:
    return np.asarray((time >= start) & (time < end))


def join_motion(bag: Bag, zero_ns: int) -> RecordedMotion:
    """Take the robot's motion from a bag; topics that it lacks are empty.

    Args:
        bag: recorded.
        zero_ns: stamp that becomes time 0 [ns].
    """
    pose_time, pose_rows = _times(bag, "platform_pose", zero_ns)
    joint_time, joint_rows = _times(bag, "joint_states", zero_ns)
    measured_time, measured_rows = _times(bag, "reflector_measurement", zero_ns)
    position = np.zeros((0, 3))
    if pose_time.size:
        series = bag["platform_pose"]
        position = np.column_stack([_column(series, name) for name in POSITION])[pose_rows]
    joints = np.zeros((0, 6))
    if joint_time.size:
        joints = _column(bag["joint_states"], "position")[joint_rows]
    if measured_time.size:
        good = _column(bag["reflector_measurement"], "success")[measured_rows] != 0.0
        measured_time = measured_time[good]
    return RecordedMotion(
        pose_time, position, joint_time, joints, measured_time, _packets_lost(bag)
    )


def _times(bag: Bag, topic: str, zero_ns: int) -> tuple[FloatArray, IntArray]:
    """Times of a topic's messages [s], each once and in order, and their rows."""
    if topic not in bag or not len(bag[topic]):
        return np.zeros(0), np.zeros(0, np.int64)
    # A stamp of zero is from before the first packet.
    stamps = bag[topic].stamp_ns
    known, rows = np.unique(stamps, return_index=True)
    real = known > 0
    return np.multiply(1e-9, known[real] - zero_ns), rows[real]


def _column(series: Series, field: str) -> FloatArray:
    return np.asarray(series[field], dtype=np.float64)


def _packets_lost(bag: Bag) -> int | None:
    """Packets missing in the robot's stream while its bridge ran."""
    if "loop_status" not in bag:
        return None
    series = bag["loop_status"]
    mine = np.array(series["node"]) == "abb_tracker_bridge"
    return int(_column(series, "lost")[mine].max()) if mine.any() else None
