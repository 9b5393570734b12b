# SPDX-License-Identifier: Apache-2.0
"""A bridge whose platform hangs on its cables: it tells the pose, and hears where it is to go."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseStamped
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray
from cabols_control.rig import Rig
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import ControlNode
from cabols_control.rotations import read_pose
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.bridge.scaling import CLOSINGS
from cabols_hw.card.config import CardConfig
from cabols_hw.hanging.bridge import HangingBridge
from cabols_hw.hanging.guard import POSE_EVERY, HangingGuard
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.guard import BridgeGuard
from cabols_hw.safety.not_held import not_held


def make_bridge(
    rig: Rig, card: CardConfig, safety: SafetyConfig, watchdog_s: float
) -> tuple[Fault | None, Bridge, BridgeGuard]:
    """Build what a bridge's node samples and guards with.

    Args:
        rig: geometry, limbs, limits, what hangs.
        card: that gives the samples.
        safety: limits.
        watchdog_s: age of the newest command that cuts all currents [s].

    Returns:
        Why a platform that hangs must not move, None: it may, or something holds it; both parts.
    """
    unheld = not_held(rig, safety, card)
    if safety.platform_held or unheld is not None:
        return unheld, Bridge(rig, card, CLOSINGS), BridgeGuard(rig, safety, watchdog_s)
    return None, HangingBridge(rig, card, CLOSINGS), HangingGuard(rig, safety, watchdog_s)


class HangingPose:
    """Publishes platform_pose in a robot's place; hears desired_pose.

    A goal counts in LOADING alone; one that is refused is told with the next report.
    """

    def __init__(self, node: ControlNode, bridge: HangingBridge, guard: HangingGuard) -> None:
        """Advertise and subscribe.

        Args:
            node: owner.
            bridge: whose cables hold the platform.
            guard: that knows where it is.
        """
        self._node, self._bridge, self._guard = node, bridge, guard
        self._frame = node.rig.geometry.base_frame
        self._record = topics.pose_layout(node.rig.geometry).record()
        self._output = node.advertise_live("platform_pose")
        self._goal: tuple[FloatArray, FloatArray] | None = None
        self._refused: Fault | None = None
        self._lockstep = node.lockstep
        qos = topic_qos("desired_pose")
        node.create_subscription(PoseStamped, "desired_pose", self._hear, qos)
        self.warm_up()

    def warm_up(self) -> None:
        """Compile or load what a look at the platform calls."""
        geometry, platform = self._node.rig.geometry, self._bridge.platform
        pose = np.array(geometry.reference_position), np.array(geometry.reference_rotation)
        n = geometry.cables
        hang = platform.hang(np.zeros(n), *pose)
        platform.certified(hang, platform.stretched(np.zeros(n), hang), 2e-4, 0.05, 0.2)
        read_pose(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))

    def _hear(self, message: PoseStamped) -> None:
        """Take a goal, in the executor's thread; the sampling thread uses it."""
        p, q = message.pose.position, message.pose.orientation
        pose = read_pose(np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w]))
        if message.header.frame_id != self._frame:
            self._refuse(f"expected the frame {self._frame}, got {message.header.frame_id!r}")
        elif pose is None:
            self._refuse("expected a finite position and a unit quaternion")
        else:
            self._goal = pose

    def _refuse(self, reason: str) -> None:
        self._refused = Fault(FaultName.DESIRED, f"desired_pose: {reason}; the one before stays")

    def sample(self, stamp_ns: int, sequence: int, mode: OperatingMode) -> None:
        """Follow a goal, and publish where the platform is to be, in the sampling thread.

        Args:
            stamp_ns: of the sample.
            sequence: its number.
            mode: operating mode.
        """
        goal, self._goal = self._goal, None
        if goal is not None:
            loads = mode == OperatingMode.LOADING and self._guard.fault is None
            reason = self._guard.watch.go(*goal) if loads else "it moves in LOADING alone"
            self._refused = None
            if reason:
                self._refuse(reason)
        if not self._lockstep and sequence % POSE_EVERY:
            return
        hoist, record = self._guard.watch.hoist, self._record
        record.stamp(stamp_ns)
        record["pose"][:3] = hoist.position
        record["pose"][3:] = Rotation.from_matrix(hoist.rotation).as_quat()
        self._output.publish(record.raw())
        self._output.copy()

    def notice(self) -> Fault | None:
        """Return what keeps modes from beginning, or a goal that was refused; None: nothing."""
        return self._guard.notice(self._bridge) or self._refused


def hanging_pose(node: ControlNode, bridge: Bridge, guard: BridgeGuard) -> HangingPose | None:
    """Return the pose that a bridge tells itself; None where a robot does.

    Args:
        node: owner.
        bridge: of make_bridge.
        guard: likewise.
    """
    if isinstance(bridge, HangingBridge) and isinstance(guard, HangingGuard):
        return HangingPose(node, bridge, guard)
    return None
