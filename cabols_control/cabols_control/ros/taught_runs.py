# SPDX-License-Identifier: Apache-2.0
"""Runs of load programmes that teach the next ones: what the node hears goes to the School."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.load_programs.lessons import School
from cabols_control.load_programs.preview import ShapedProgram
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.ros.live import live_name
from cabols_control.ros.loop import Input
from cabols_control.ros.messages import topics
from cabols_control.ros.node import ControlNode
from cabols_control.rotations import read_pose


class TaughtRuns:
    """Learning for a node; with its own pose, as the loop's thread reads it."""

    def __init__(self, node: ControlNode, held_s: float) -> None:
        """Subscribe to the slow copy of platform_pose.

        Args:
            node: owner.
            held_s: for how long the wrench law holds each value of a reference [s].
        """
        self._node = node
        self._school = School(node.rig, held_s)
        poses = topics.pose_layout(node.rig.geometry)
        self._pose = Input(node, live_name("platform_pose"), poses)
        self._count = 0
        read_pose(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))  # compile now

    def apply(
        self,
        shaped: ShapedProgram,
        place: tuple[FloatArray, FloatArray],
        asked: tuple[LoadProgram, bytes],
    ) -> ShapedProgram:
        """Aim at what was learnt, and log what is wrong with it; see School.apply.

        Args:
            shaped: as it is followed without learning.
            place: (3,) position [m] and (3, 3) rotation of the platform.
            asked: the programme in its own frame, and that frame's definition.
        """
        taught = self._school.apply(shaped, *place, asked)
        while self._school.notes:
            self._node.get_logger().warning(self._school.notes.pop())
        return taught

    def begin(self, program: ShapedProgram) -> None:
        """Begin to keep a run of a programme that `apply` gave."""
        self._school.begin(program)

    def note(self, began_s: float, now_s: float, wrench: Input) -> None:
        """Keep the newest measured wrench, and look whether the platform stands.

        Args:
            began_s: when the smoothed command began [s].
            now_s: by the same clock [s].
            wrench: input of `wrench`.
        """
        if wrench.record is None:
            return
        stamp_s = 1e-9 * wrench.stamp_ns
        self._school.note(stamp_s - began_s, wrench.record["wrench"], now_s - stamp_s)
        self._pose.take()
        if self._pose.count == self._count or self._pose.record is None:
            return
        self._count = self._pose.count
        pose = read_pose(np.array(self._pose.record["pose"]))
        if pose is not None:
            self._school.note_pose(*pose)

    def finish(self) -> None:
        """Learn from a run that was completed, and log what came of it."""
        self._node.get_logger().info(self._school.finish())
