# SPDX-License-Identifier: Apache-2.0
"""Node: the rig as markers for RViz, ten times a second from the slow copies."""

from __future__ import annotations

import sys
import time
from typing import Any

from visualization_msgs.msg import Marker, MarkerArray

from cabols_control.console.latest import LatestValues
from cabols_control.console.view3d.scene import load_scene
from cabols_control.console.view3d.shapes import CYLINDER, Shape, rig_shapes
from cabols_control.ros.console.feed import Feed
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import RUNNING, run_node
from cabols_control.ros.parameters import declare
from cabols_control.ros.ticking_node import TickingNode

PERIOD_S = 0.1


class MarkersNode(TickingNode):
    """Publishes `markers` in the rig's base frame."""

    def __init__(self) -> None:
        """Subscribe and advertise."""
        super().__init__("markers", PERIOD_S)
        self._scene = load_scene(
            self.rig_folder,
            declare(self, "scene_file", "", "YAML of what is drawn"),
        )
        self._feed = Feed(self, self.rig, LatestValues(), self.rig_folder)
        self._publisher = self.create_publisher(MarkerArray, "markers", topic_qos("markers"))

    def tick(self) -> None:
        """Draw what has come."""
        frame = self._feed.look()
        stamp = self.get_clock().now().to_msg()
        shapes = rig_shapes(self.rig, self._scene, frame)
        base = self.rig.geometry.base_frame
        self._publisher.publish(
            MarkerArray(markers=[marker(s, i, base, stamp) for i, s in enumerate(shapes)])
        )
        self.status.cycle(time.time_ns(), RUNNING)


def marker(shape: Shape, number: int, frame: str, stamp: Any) -> Marker:
    """Convert one shape to a marker of RViz."""
    kind = Marker.CYLINDER if shape.kind == CYLINDER else Marker.SPHERE
    made = Marker(ns=shape.group, id=number, type=kind, action=Marker.ADD)
    made.header.frame_id, made.header.stamp = frame, stamp
    p, q = made.pose.position, made.pose.orientation
    p.x, p.y, p.z = map(float, shape.position)
    q.x, q.y, q.z, q.w = map(float, shape.quaternion)
    made.scale.x, made.scale.y, made.scale.z = shape.size
    made.color.r, made.color.g, made.color.b = shape.colour
    made.color.a = 1.0
    # A marker that is not renewed disappears, so that RViz shows no outdated shape.
    made.lifetime.sec = 1
    return made


def main() -> int:
    """Entry point."""
    return run_node(MarkersNode)


if __name__ == "__main__":
    sys.exit(main())
