# SPDX-License-Identifier: Apache-2.0
"""The robot bridge's heartbeat: what the rig says of itself, and whether the robot listens."""

from __future__ import annotations

import time
from collections.abc import Callable

from cabols_msgs.msg import LoopStatus

from cabols_control.cdr import LayoutError
from cabols_control.checks import FloatArray
from cabols_control.ros.live import live_name
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import ControlNode
from cabols_control.ros.parameters import declare_row
from cabols_control.supervision.held_load import taut_limbs
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.abb.configurations import RobotConfigurations
from cabols_hw.abb.heartbeat import Heartbeat, Motion, RigHealth
from cabols_hw.abb.speed_limit import check_speed
from cabols_hw.bringup_nodes import NODES as HW_NODES
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety


class RobotWatch:
    """Beats while limb states and modes arrive and no node of the control path is in FAULT.

    Attributes:
        joints: newest joints of the robot, (k,) [rad]; None: none.
    """

    def __init__(
        self,
        node: ControlNode,
        address: str,
        speed: float,
        configurations: RobotConfigurations,
        watched: bool = True,
    ) -> None:
        """Subscribe, and check the robot's speed.

        Args:
            node: of the robot's bridge.
            address: of the robot's controller.
            speed: of a simulated rig's time; 1 in real time.
            configurations: of the robot.
            watched: whether the controller has a port for the beats.

        Raises:
            ConfigError: if the robot is too fast for a watch of this silence.
        """
        self._node = node
        self._motion = Motion()
        self.joints: Callable[[], FloatArray | None] = lambda: None
        folder = node.rig_folder
        check_speed(node.rig, load_safety(folder), load_card(folder), configurations)
        port = declare_row(node, HW_NODES.argument("heartbeat_port"))
        self._health = RigHealth(1.0 / speed)
        self._heart = Heartbeat(address, port, self._trouble) if port and watched else None
        if node.lockstep:
            # A lockstep clock counts the readers of its topics; nothing is late there.
            return
        self._layout = topics.limb_state_layout(node.rig.geometry)
        name = live_name("limb_state")
        node.create_subscription(
            self._layout.msg_type, name, self._hear_state, topic_qos(name), raw=True
        )
        node.create_subscription(
            LoopStatus, "loop_status", self._hear_report, topic_qos("loop_status")
        )

    def start(self) -> None:
        """Begin to beat."""
        if self._heart is None:
            self._node.get_logger().warning("heartbeat_port is 0: the robot moves unwatched")
        else:
            self._heart.start()

    def stop(self) -> None:
        """End; a robot that moves stops."""
        if self._heart is not None:
            self._heart.stop()

    def hear_mode(self, mode: OperatingMode) -> None:
        """Note the rig's mode.

        Args:
            mode: newest.
        """
        self._health.hear_mode(time.monotonic(), mode)

    def unwatched(self) -> str:
        """Why the robot would not move for want of a heartbeat; empty if it would."""
        if self._heart is None:
            return ""
        if not self._heart.connected:
            return "the robot's watch does not answer: is cabols_watch.mod loaded, its port open?"
        return "" if self._node.lockstep else self._health.trouble(time.monotonic())

    def held(self) -> str:
        """Why the robot must not move where no cable follows it; empty if it may."""
        return self._health.held()

    def _trouble(self) -> str:
        if self._node.lockstep:
            return ""
        # In the heart's own thread alone, which looks at the joints again and again.
        now_s, joints = time.monotonic(), self.joints()
        moves = joints is not None and self._motion.hear(now_s, joints)
        return self._health.trouble(now_s, moves)

    def _hear_state(self, raw: bytes) -> None:
        try:
            state = self._layout.read(raw)
        except LayoutError:
            # Not of this rig: it says nothing of its limbs.
            return
        flags = (state[name].astype(bool) for name in ("zeroed", "switch_closed"))
        self._health.hear_state(time.monotonic(), taut_limbs(state["tension"], *flags))

    def _hear_report(self, message: LoopStatus) -> None:
        if message.node != self._node.get_name():
            in_fault = message.state == LoopStatus.FAULT
            self._health.hear_report(time.monotonic(), message.node, in_fault)
