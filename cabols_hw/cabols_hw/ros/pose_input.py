"""The platform's pose as the bridge reads it: judged as it comes, then extrapolated to samples."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.pose_track import pose_time
from cabols_control.ros import topics
from cabols_control.ros.loop import Input
from cabols_control.ros.node import ControlNode
from cabols_control.rotations import read_pose
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.safety.guard import BridgeGuard


class PoseInput(Input):
    """Input of platform_pose.

    Attributes:
        used: whether a pose has been used yet.
    """

    def __init__(self, node: ControlNode, bridge: Bridge, guard: BridgeGuard) -> None:
        """Subscribe.

        Args:
            node: owner.
            bridge: that uses the poses.
            guard: that judges them first.
        """
        layout = topics.pose_layout(node.rig.geometry)
        super().__init__(node, "platform_pose", layout, node.lockstep)
        self._bridge, self._guard = bridge, guard
        self.used = False

    def follow(self, now_s: float) -> None:
        """Take what has arrived; `now_s` is of the newest sample [s]."""
        if self.take() and (pose := read_pose(np.array(self.record["pose"]))) is not None:
            self.use(now_s, pose_time(1e-9 * self.stamp_ns, now_s), *pose)

    def use(self, now_s: float, stamp_s: float, position: FloatArray, rotation: FloatArray) -> None:
        """Use a pose if the safety envelope accepts it, which sees it as it came.

        Args:
            now_s: of the newest sample [s].
            stamp_s: of the pose, on the samples' clock [s].
            position: (3,) of the platform's origin, base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        if self._guard.safety.hear_pose(now_s, position, rotation):
            self._bridge.hear_pose(stamp_s, position, rotation)
            self.used = True
