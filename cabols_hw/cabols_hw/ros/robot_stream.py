# SPDX-License-Identifier: Apache-2.0
"""The robot's position stream as topics: platform_pose and joint_states at the EGM rate."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from rclpy.serialization import serialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from cabols_control.checks import finite_array
from cabols_control.naming import number
from cabols_control.rig_folder import RigFolder
from cabols_control.ros.messages import topics
from cabols_control.ros.node import FAULT, RUNNING, WAITING, ControlNode
from cabols_control.ros.sessions import ModeInput
from cabols_control.ros.stops import STOPPED, StopLatch
from cabols_control.ros.threads.guarded_thread import GuardedThread
from cabols_control.rotations import pose_matrix
from cabols_control.serial_arms.arm import read_serial_arm
from cabols_control.stamps import SECOND_NS, STAMP, STAMP_AT
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.abb.egm.reader import EgmSample, StreamQuality
from cabols_hw.abb.egm.stream_quality import CountedStream

WAIT_S = 0.01
MOTORS_OFF = Fault(
    FaultName.ROBOT_MOTORS,
    "robot: its motors are off and its brakes hold it: no load and no measurement; release "
    "emergency stops and press motors on",
)
PROGRAM_STOPPED = Fault(
    FaultName.ROBOT_PROGRAM, "robot: RAPID is stopped; it stands, and a motion starts RAPID anew"
)
JOINT_NAMES = tuple(f"joint_{number(i)}" for i in range(6))


def joint_names(folder: RigFolder) -> tuple[str, ...]:
    """Names of the robot's joints, as in its URDF: robot_state_publisher looks them up there.

    Args:
        folder: of the rig; without a URDF they are numbered.
    """
    if not folder.has("robot.urdf"):
        return JOINT_NAMES
    names = read_serial_arm(folder.file("robot.urdf")).joints
    return names if len(names) == len(JOINT_NAMES) else JOINT_NAMES


class PoseSource(Protocol):
    """Where the robot's state comes from.

    Attributes:
        counter: what was received, lost, late, refused.
    """

    counter: CountedStream

    def take(self, timeout_s: float) -> EgmSample | None:
        """Wait for the newest sample; None if none came in time."""


class JointStateBytes:
    """A serialised JointState whose time and positions are written in place."""

    def __init__(self, names: Sequence[str]) -> None:
        """Lay out for these joints; velocity and effort stay empty, as EGM does not send them."""
        marks = [1.0 + i for i in range(len(names))]
        message = JointState(name=list(names), position=marks)
        self._raw = bytearray(serialize_message(message))
        self._format = struct.Struct(f"<{len(names)}d")
        self._at = bytes(self._raw).index(self._format.pack(*marks))
        # serialize_message may leave unused bytes behind the message, which strict readers of a bag
        # refuse: it ends with the lengths of velocity and effort, both zero.
        del self._raw[self._at + self._format.size + 8 :]

    def raw(self, stamp_ns: int, positions: Sequence[float]) -> bytes:
        """Return the bytes to publish, for a time [ns] and angles [rad]."""
        STAMP.pack_into(self._raw, STAMP_AT, *divmod(stamp_ns, SECOND_NS))
        self._format.pack_into(self._raw, self._at, *positions)
        return bytes(self._raw)


class BaseFrame:
    """Where the robot's base stands in the rig's."""

    def __init__(self, position: Sequence[float], rotation_xyz_deg: Sequence[float]) -> None:
        """Take (3,) position [m] and (3,) intrinsic x-y-z Euler angles [deg].

        Raises:
            ShapeError: if one has another shape or is not finite.
        """
        angles = finite_array("robot_rotation_xyz_deg", rotation_xyz_deg, (3,))
        self._position = finite_array("robot_position", position, (3,))
        self._rotation = Rotation.from_euler("XYZ", angles, degrees=True)
        self._identity = not (angles.any() or self._position.any())

    def pose_into(self, sample: EgmSample, pose: np.ndarray) -> None:
        """Fill pose (7,): position [m], quaternion x y z w, in the rig's base frame."""
        pose[:3], pose[3:] = sample.position, sample.quaternion
        if not self._identity:
            pose[:3] = self._position + self._rotation.apply(sample.position)
            pose[3:] = (self._rotation * Rotation.from_quat(sample.quaternion)).as_quat()


class RobotStream(GuardedThread):
    """Publishes every newest packet; without packets it publishes nothing and reports FAULT.

    Attributes:
        newest: newest sample; None before the first.
        stamp_ns: the time it was published with.
        mode: newest mode of the rig; None before the first.
        notes: further numbers for /diagnostics, by name.
        note: what is worth saying while all runs; loop_status is recorded.
    """

    def __init__(
        self,
        node: ControlNode,
        reader: PoseSource,
        base: BaseFrame,
        stale_after_s: float,
        robot_clock: bool,
    ) -> None:
        """Prepare; start() begins.

        Args:
            node: owner of topics and status.
            reader: of the stream.
            base: the robot's place in the rig.
            stale_after_s: silence after which the pose counts as stale [s].
            robot_clock: stamps are the controller's time, not this computer's.
        """
        super().__init__(node.context, "robot_stream")
        self._node = node
        self._reader = reader
        # In lockstep the rig's time runs at a speed of its own: nothing is late.
        late = np.inf if node.lockstep else 0.6
        self._quality = StreamQuality(reader.counter, late=late)
        self._base = base
        self._stale_after_s = stale_after_s
        self._robot_clock = robot_clock
        self._pose = topics.pose_layout(node.rig.geometry).record()
        self._joints = JointStateBytes(joint_names(node.rig_folder))
        self._pose_output = node.advertise_live("platform_pose")
        self._joint_output = node.advertise_live("joint_states")
        self._mode_input = ModeInput(node, node.status.sessions, node.lockstep)
        self.notes: dict[str, int] = {}
        self.note: Fault | None = None
        self.newest: EgmSample | None = None
        self.stamp_ns = 0
        self.mode: OperatingMode | None = None
        self.stops: StopLatch | None = None
        self.on_fault: Callable[[], object] = lambda: None
        self.on_mode: Callable[[OperatingMode], object] = lambda _: None

    def platform(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the newest pose: position (3,) [m], rotation (3, 3) to the rig's base axes."""
        pose = np.array(self._pose["pose"])
        return pose[:3], pose_matrix(pose[3:])

    @property
    def stale(self) -> bool:
        """Whether the newest pose is too old."""
        newest = self.newest
        return newest is None or not self._age_s(newest) <= self._stale_after_s

    @staticmethod
    def _age_s(sample: EgmSample) -> float:
        return time.monotonic() - sample.received_s

    def now_ns(self) -> int:
        """Return the present time, in the clock of the stamps."""
        return self.stamp_ns if self._robot_clock else time.time_ns()

    def body(self) -> None:
        """Read, publish, report."""
        self._node.prepare_thread()
        while self.running:
            sample = self._reader.take(WAIT_S)
            if sample is not None and self._age_s(sample) <= self._stale_after_s:
                self._publish(sample)
            if self._mode_input.take():
                self._hear_mode()
            self._report()

    def _hear_mode(self) -> None:
        before, self.mode = self.mode, OperatingMode(int(self._mode_input.record["mode"]))
        if self.stops is not None:
            self.stops.follow(self._mode_input.record["lifted"])
        self.on_mode(self.mode)
        if self.mode == OperatingMode.FAULT and before not in (None, self.mode):
            self.on_fault()

    def _publish(self, sample: EgmSample) -> None:
        began = time.monotonic()
        self.newest = sample
        age_ns = int(1e9 * max(self._age_s(sample), 0.0))
        self.stamp_ns = sample.robot_time_ns if self._robot_clock else time.time_ns() - age_ns
        self._pose.stamp(self.stamp_ns)
        self._base.pose_into(sample, self._pose["pose"])
        self._pose_output.publish(self._pose.raw())
        self._joint_output.publish(self._joints.raw(self.stamp_ns, sample.joints.tolist()))
        self._pose_output.copy()
        self._joint_output.copy()
        self._node.status.work.add(time.monotonic() - began)

    def _report(self) -> None:
        status, counter = self._node.status, self._reader.counter
        status.lost = counter.lost
        status.late = 0 if self._node.lockstep else counter.late
        status.counted = {
            **self.notes,
            "restarts": counter.restarts,
            "clock_steps": counter.clock_steps,
            "impossible_numbers": counter.impossible,
            **{f"refused_{reason.name.lower()}": n for reason, n in counter.refused.items()},
        }
        self._quality.look()
        status.stop = 0 if self.stops is None else self.stops.number
        state, fault = self._judged()
        status.cycle(0 if self.newest is None else self.stamp_ns, state, fault)
        self._node.tidy()

    def _judged(self) -> tuple[int, Fault | None]:
        """Return the state, and what is wrong or only worth saying."""
        quality, newest = self._quality, self.newest
        if self._node.status.stop:
            return FAULT, STOPPED
        refused = None
        if quality.notice:
            refused = Fault(FaultName.STREAM_REFUSED, f"robot: {quality.notice}")
        if newest is None:
            return WAITING, refused
        if self.stale:
            reason = f"robot: no EGM packet for {self._stale_after_s:g} s"
            if quality.notice:
                reason = f"{reason}; {quality.notice}"
            return FAULT, Fault(FaultName.STREAM_SILENT, reason)
        if quality.trouble:
            return FAULT, Fault(FaultName.STREAM_QUALITY, f"robot: {quality.trouble}")
        if not newest.motors_on:
            return FAULT, MOTORS_OFF
        stopped = None if newest.rapid_running else PROGRAM_STOPPED
        return RUNNING, refused or self.note or stopped
