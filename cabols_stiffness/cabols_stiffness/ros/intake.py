# SPDX-License-Identifier: Apache-2.0
"""A campaign's inputs from the rig: newest states, rolling streams, all recorded in a bag."""

from __future__ import annotations

import threading
import time
from collections import deque
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message

from cabols_control.bags.metadata import OfferedQos
from cabols_control.bags.writer import BagWriter
from cabols_control.cdr import LayoutError
from cabols_control.ros.loop import Input, make_wait_set, subscribe_aside, wait_for
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import ControlNode
from cabols_control.ros.sessions import ModeInput
from cabols_control.ros.threads.guarded_thread import GuardedThread
from cabols_control.stamps import column_ns, time_ns
from cabols_control.supervision.modes import OperatingMode
from cabols_stiffness.measurements.window import Rolling

GATHER_S = 0.01
IDLE_NS = 50_000_000
DEPTH = 4000
JOINTS = 6
"""Depth of the queue: no sample may be lost, also when this process is late."""
KEPT_WRENCHES, KEPT_JOINTS = 120_000, 40_000
FLUSH_S = 0.5
RECORDED = {
    "wrench": "geometry_msgs/msg/WrenchStamped",
    "joint_states": "sensor_msgs/msg/JointState",
    "mode": "cabols_msgs/msg/Mode",
    "reflector_measurement": "cabols_msgs/msg/ReflectorMeasurement",
    "stiffness_load": "cabols_msgs/msg/StiffnessLoad",
    "stiffness_estimate": "cabols_msgs/msg/StiffnessEstimate",
}
"""Topics of an analysis, and the campaign's own results; `recorder` records everything."""


class CampaignBag:
    """The campaign's own bag; any thread may add."""

    def __init__(self, folder: Path, metadata: dict[str, str]) -> None:
        """Create it.

        Raises:
            BagError: if it cannot be created.
        """
        folder.parent.mkdir(parents=True, exist_ok=True)
        self._writer = BagWriter(folder, metadata)
        for topic, type_name in RECORDED.items():
            self._writer.add_topic(topic, type_name, OfferedQos(DEPTH, "reliable", "volatile"))
        self._waiting: deque[tuple[int, str, int, bytes]] = deque()
        self._lock = threading.Lock()
        self._flushed = time.monotonic()
        self._closed = False

    def add(self, topic: str, raw: bytes, received_ns: int, sent_ns: int = 0) -> None:
        """Queue one message."""
        self._waiting.append((received_ns, topic, sent_ns or received_ns, raw))

    def write(self, flush: bool = False) -> None:
        """Write waiting messages; twice a second, or on demand, make them safe against kill -9."""
        with self._lock:
            if self._closed:
                return
            batch = [self._waiting.popleft() for _ in range(len(self._waiting))]
            batch.sort(key=itemgetter(0))
            for received_ns, topic, sent_ns, raw in batch:
                self._writer.write(topic, received_ns, sent_ns, raw)
            if flush or time.monotonic() - self._flushed > FLUSH_S:
                self._writer.flush()
                self._flushed = time.monotonic()

    def close(self) -> None:
        """Write the rest and complete the bag."""
        self.write()
        with self._lock:
            self._closed = True
            self._writer.close()


class Stream:
    """All messages of one topic, raw; into a Rolling and the bag."""

    def __init__(
        self, node: ControlNode, topic: str, columns: int, capacity: int, lockstep: bool
    ) -> None:
        self.topic = topic
        self._type = topics.message_type(topic)
        self._subscription = subscribe_aside(
            node, self._type, topic, topic_qos(topic, lockstep, DEPTH)
        )
        self._handle = self._subscription.handle
        self.rolling = Rolling(columns, capacity)

    def take(self, bag: CampaignBag | None) -> int:
        """Take all waiting messages; return their number."""
        stamps, rows = [], []
        while (taken := self._handle.take_message(self._type, True)) is not None:
            raw, info = taken
            if bag is not None:
                received = info["received_timestamp"] or time.time_ns()
                bag.add(self.topic, raw, received, info["source_timestamp"])
            found = self._numbers(raw)
            if found is not None:
                stamps.append(found[0])
                rows.append(found[1])
        if stamps:
            self.rolling.add(np.array(stamps, dtype=np.int64), np.array(rows))
        return len(stamps)

    def _numbers(self, raw: bytes) -> tuple[int, Any] | None:
        """Stamp [ns] and row of a message; None for bytes that are no such message."""
        raise NotImplementedError


class WrenchStream(Stream):
    """The sensor's wrench, platform axes."""

    def __init__(self, node: ControlNode, lockstep: bool) -> None:
        super().__init__(node, "wrench", 6, KEPT_WRENCHES, lockstep)
        self._layout = topics.wrench_layout(node.rig.geometry.platform_frame)

    def _numbers(self, raw: bytes) -> tuple[int, Any] | None:
        try:
            record = self._layout.read(raw)
        except LayoutError:
            return None
        return int(column_ns(record)), record["wrench"]


class JointStream(Stream):
    """The robot's encoders."""

    def __init__(self, node: ControlNode, lockstep: bool) -> None:
        super().__init__(node, "joint_states", JOINTS, KEPT_JOINTS, lockstep)

    def _numbers(self, raw: bytes) -> tuple[int, Any] | None:
        try:
            message = deserialize_message(raw, self._type)
        except Exception:
            # rclpy has no error of its own for bytes that are none of a type.
            return None
        if len(message.position) != JOINTS:
            return None
        return time_ns(message.header.stamp), np.array(message.position)


class Intake(GuardedThread):
    """Takes all messages every hundredth of a second, keeps the newest, notifies waiting threads.

    Attributes:
        news: notified after each turn.
        wrenches: rolling (6,) [N, N m].
        joints: rolling (6,) [rad].
        mode: newest; None before the first.
        reason: why it was entered.
        tension: (n,) newest estimates [N].
        zeroed: (n,) bool, newest.
        zeroing: number of the pre-tightening that the zeros are of.
        mode_zeroing: number of the newest pre-tightening.
        pose: (7,) of the platform, position [m], quaternion x y z w; None before the first.
        bag: in which all messages are recorded; None: none.
    """

    def __init__(self, node: ControlNode) -> None:
        """Subscribe; start() begins."""
        super().__init__(node.context, "intake")
        self._node = node
        lockstep = node.lockstep
        geometry = node.rig.geometry
        self._wrench = WrenchStream(node, lockstep)
        self._joint = JointStream(node, lockstep)
        # Only the newest of these counts; older ones are skipped.
        states, poses = topics.limb_state_layout(geometry), topics.pose_layout(geometry)
        self._state = Input(node, "limb_state", states, lockstep, depth=1)
        self._pose = Input(node, "platform_pose", poses, lockstep, depth=1)
        self._mode = ModeInput(node, node.status.sessions, lockstep)
        self._wait_set = make_wait_set(node, 1)
        self.news = threading.Condition()
        self.wrenches, self.joints = self._wrench.rolling, self._joint.rolling
        self.mode: OperatingMode | None = None
        self.reason = ""
        self.tension = np.full(geometry.cables, np.nan)
        self.zeroed = np.zeros(geometry.cables, dtype=bool)
        self.zeroing = self.mode_zeroing = 0
        self.pose: np.ndarray | None = None
        self.bag: CampaignBag | None = None
        self.on_look = lambda: None

    @property
    def now_ns(self) -> int:
        """The rig's time [ns]; -1 before the first sample."""
        return self.wrenches.newest_ns

    @property
    def tight(self) -> np.ndarray:
        """(n,) bool, limbs with a zero of the newest pre-tightening."""
        return self.zeroed & (self.zeroing == self.mode_zeroing)

    def body(self) -> None:
        """Take messages until the end."""
        self._node.prepare_thread()
        while self.running:
            if wait_for(self._wait_set, (self._wrench,), IDLE_NS):
                self._stop.wait(GATHER_S)
            with self.news:
                self._look()
                self.news.notify_all()
            self.on_look()
            bag = self.bag
            if bag is not None:
                bag.write()

    def _look(self) -> None:
        bag = self.bag
        self._wrench.take(bag)
        self._joint.take(bag)
        if self._state.take():
            record = self._state.record
            self.tension = np.array(record["tension"])
            self.zeroed = np.array(record["zeroed"], dtype=bool)
            self.zeroing = int(record["zeroing"])
        if self._pose.take():
            self.pose = np.array(self._pose.record["pose"])
        if self._mode.take():
            self.mode = OperatingMode(int(self._mode.record["mode"]))
            self.mode_zeroing = int(self._mode.record["zeroing"])
            self.reason = self._mode.strings()["reason"]
            if bag is not None:
                bag.add("mode", self._mode.raw, time.time_ns())
