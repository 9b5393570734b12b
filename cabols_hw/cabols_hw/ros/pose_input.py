# SPDX-License-Identifier: Apache-2.0
"""The platform's pose as the bridge reads it: judged as it comes, then extrapolated to samples."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.poses.track import pose_time
from cabols_control.ros.loop import SLOW_INPUT, Input
from cabols_control.ros.messages import topics
from cabols_control.ros.node import ControlNode
from cabols_control.ros.sessions import living, same_session
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
        self.judge = living(layout, node.status.sessions, node.lockstep)
        self._bridge, self._guard = bridge, guard
        self.used = False
        paths = topics.path_motion_layout(node.rig.geometry)
        self._paths = Input(node, "path_motion", paths, node.lockstep)
        # Also in lockstep: a robot has its own pace, and a path of another session moves nothing.
        self._paths.judge = same_session(paths, node.status.sessions, lockstep=False)
        self._newest_path = (0, 0)
        self._turns = 0
        # Compile or load it now: a control loop does not wait for a compiler.
        read_pose(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))

    def follow(self, now_s: float) -> None:
        """Take what has arrived; `now_s` is of the newest sample [s]."""
        if self.take() and (pose := read_pose(np.array(self.record["pose"]))) is not None:
            self.use(now_s, pose_time(1e-9 * self.stamp_ns, now_s), *pose)
        self._turns += 1
        if self._turns % SLOW_INPUT == 0 and self._paths.take():
            path = self._paths.record
            newest = int(path["session"]), self._paths.stamp_ns
            # A bag of this session, played while it lasts, allows no speed once more.
            if path["active"] and newest > self._newest_path:
                self._newest_path = newest
                speeds = float(path["speed"]), float(path["rotation_speed"])
                self._guard.safety.allow_path(now_s, *speeds)

    def use(self, now_s: float, stamp_s: float, position: FloatArray, rotation: FloatArray) -> None:
        """Use a pose if the safety envelope accepts it, which sees it as it came.

        Args:
            now_s: of the newest sample [s].
            stamp_s: of the pose, on the samples' clock [s].
            position: (3,) of the platform's origin, base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        if self._guard.safety.hear_pose(now_s, position, rotation, stamp_s):
            self._bridge.hear_pose(stamp_s, position, rotation)
            self.used = True
