# SPDX-License-Identifier: Apache-2.0
"""The bridge as a managed node of ROS 2: only while it is active may its amplifiers be on."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable

from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node

from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import MOVING, OperatingMode

INACTIVE = Fault(
    FaultName.INACTIVE,
    "inactive: the amplifiers stay off until `ros2 lifecycle set` of this node says activate",
)
DONE, REFUSED = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


def why_busy(mode: OperatingMode, recovering: bool) -> str:
    """Why amplifiers may not be kept off now; empty if they may.

    Args:
        mode: that the bridge follows.
        recovering: whether it takes a load off by itself.
    """
    if mode in MOVING:
        return mode.name
    return "a load that comes off" if recovering else ""


class ManagedBridge(LifecycleNodeMixin):
    """States of `ros2 lifecycle` (ROS 2 design, "Managed nodes"): inactive, and active.

    The devices are open from the start to the end of the process, so that an inactive bridge goes
    on to measure. It enables no amplifier and follows no mode that moves. Being active moves
    nothing either: that takes a mode of the supervisor's.

    Attributes:
        active: whether amplifiers may be on.
    """

    def __init__(self) -> None:
        """Nothing yet: manage() begins, once there is a node."""
        self.active = False
        self._busy: Callable[[], str] = str

    def manage(self, activate: bool, busy: Callable[[], str]) -> None:
        """Serve the transitions.

        Args:
            activate: whether the bridge becomes active at once.
            busy: why it must not become inactive now; empty if it may.
        """
        LifecycleNodeMixin.__init__(self)
        self._busy = busy
        self.trigger_configure()
        if activate:
            self.trigger_activate()

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let modes enable the amplifiers."""
        del state
        self.active = True
        return DONE

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Keep the amplifiers off; refused while anything moves or a load comes off."""
        del state
        why = self._busy()
        if why:
            self._say(f"deactivate: expected a rig at rest, got {why}; enter STOPPED first")
            return REFUSED
        self.active = False
        return DONE

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Refuse: what is measured is what tells whether a load is left."""
        del state
        self._say("cleanup: the devices stay open as long as the process lives; end it instead")
        return REFUSED

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the process as SIGTERM does: in order, and without a load."""
        del state
        os.kill(os.getpid(), signal.SIGTERM)
        return DONE

    def _say(self, text: str) -> None:
        if isinstance(self, Node):
            self.get_logger().warning(text)
