# SPDX-License-Identifier: Apache-2.0
"""Node: the rig's frames on /tf and /tf_static, and its URDF on robot_description."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from scipy.spatial.transform import Rotation
from std_msgs.msg import String

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError
from cabols_control.placement import Frame
from cabols_control.rig_tools.rig_urdf import ROBOT_URDF, rig_urdf, urdf_text
from cabols_control.ros.live import live_name
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import quality_qos
from cabols_control.ros.node import RUNNING, WAITING, run_node
from cabols_control.ros.parameters import declare, declare_robot
from cabols_control.ros.reader import Reader
from cabols_control.ros.ticking_node import TickingNode
from cabols_control.rotations import read_pose
from cabols_control.serial_arms.frame_tree import read_links
from cabols_control.stamps import set_time, time_ns
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.topics import FOREIGN

PERIOD_S = 0.04
FARTHEST = 1e3
"""No position of a joint is larger [m], [rad]."""


class FramesNode(TickingNode):
    """Publishes where the rig's frames are, from the slow copies of joints and pose.

    With a robot the platform hangs on its flange, as in the URDF: the robot's own pose of it comes
    from the same encoders. Without one it stands at platform_pose in the rig's base.
    """

    def __init__(self) -> None:
        """Advertise.

        Raises:
            ConfigError: if tf2_msgs is not installed, or a file of the rig cannot be used.
        """
        super().__init__("frames", PERIOD_S)
        robot = declare_robot(self) and self.rig_folder.has(ROBOT_URDF)
        self._prefix = declare(self, "frame_prefix", "", "before each frame's name: rig2/")
        base = Frame(
            list(declare(self, "robot_position", [0.0] * 3, "m, robot's base in the rig's")),
            list(declare(self, "robot_rotation_xyz_deg", [0.0] * 3, "x-y-z, of its base")),
        )
        try:
            kind: Any = topics.class_of(FOREIGN["/tf"].type_name)
        except ImportError as error:
            raise ConfigError(
                "frames: expected the package tf2_msgs, found none; install ros-jazzy-tf2-msgs"
            ) from error
        self._kind = kind
        urdf = rig_urdf(str(self.rig_folder.path), base)
        geometry = self.rig.geometry
        links = read_links(urdf)
        if not robot:
            links = [link for link in links if link.child != geometry.platform_frame]
        self._moving = [link for link in links if link.moves]
        self._refused: Fault | None = None
        self._platform = "" if robot else geometry.platform_frame
        self._joints = Reader(self, live_name("joint_states"))
        self._poses = Reader(self, live_name("platform_pose"))
        self._tf = publisher(self, kind, "/tf")
        self._static = publisher(self, kind, "/tf_static")
        described = self.create_publisher(
            String, "robot_description", quality_qos(FOREIGN["/robot_description"].quality)
        )
        described.publish(String(data=urdf_text(urdf)))
        now = self.get_clock().now().nanoseconds
        self._static.publish(
            kind(
                transforms=[
                    self._transform(link.parent, link.child, now, *link.at(0.0))
                    for link in links
                    if not link.moves
                ]
            )
        )

    def _transform(
        self, parent: str, child: str, stamp_ns: int, position: FloatArray, rotation: FloatArray
    ) -> TransformStamped:
        made = TransformStamped(child_frame_id=self._prefix + child)
        made.header.frame_id = self._prefix + parent
        set_time(made.header.stamp, stamp_ns)
        made.transform.translation.x, made.transform.translation.y = map(float, position[:2])
        made.transform.translation.z = float(position[2])
        x, y, z, w = (float(part) for part in Rotation.from_matrix(rotation).as_quat())
        turn = made.transform.rotation
        turn.x, turn.y, turn.z, turn.w = x, y, z, w
        return made

    def tick(self) -> None:
        """Publish what has come."""
        found = [*self._robot_frames(), *self._platform_frames()]
        if found:
            self._tf.publish(self._kind(transforms=found))
        self.status.cycle(time.time_ns(), RUNNING if found else WAITING, self._refused)

    def _refuse(self, expected: str) -> None:
        """Draw nothing by a message; the frames that were published grow old."""
        self._refused = Fault(FaultName.MESSAGE, f"expected {expected}; it is not used")

    def _robot_frames(self) -> Iterable[TransformStamped]:
        for message in self._joints.take()[-1:]:
            at = dict(zip(message.name, message.position, strict=False))
            usable = len(message.name) == len(message.position)
            if not (usable and all(abs(value) <= FARTHEST for value in at.values())):
                self._refuse("joint_states with a finite position for each name")
                return
            self._refused = None
            for link in self._moving:
                yield self._transform(
                    link.parent,
                    link.child,
                    time_ns(message.header.stamp),
                    *link.at(at.get(link.joint, 0.0)),
                )

    def _platform_frames(self) -> Iterable[TransformStamped]:
        for message in self._poses.take()[-1:]:
            if not self._platform:
                return
            p, q = message.pose.position, message.pose.orientation
            pose = read_pose(np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w]))
            if pose is None:
                self._refuse("platform_pose with finite numbers and a quaternion of length one")
                return
            self._refused = None
            base = self.rig.geometry.base_frame
            yield self._transform(base, self._platform, time_ns(message.header.stamp), *pose)


def publisher(node: Node, kind: Any, topic: str) -> Any:
    """Advertise one of ROS's own topics.

    Args:
        node: that publishes.
        kind: class of its messages.
        topic: its absolute name.
    """
    return node.create_publisher(kind, topic, quality_qos(FOREIGN[topic].quality))


def main() -> int:
    """Entry point."""
    return run_node(FramesNode)


if __name__ == "__main__":
    sys.exit(main())
