"""What every node tells on /diagnostics, for the tools that ROS users have."""

from __future__ import annotations

from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

PERIOD_S = 1.0
LOOK_S = 0.1
"""A change is told within this time; it never makes the control loop wait."""
LEVELS = {0: DiagnosticStatus.WARN, 1: DiagnosticStatus.OK, 2: DiagnosticStatus.ERROR}
"""By the state of LoopStatus: waiting, running, fault."""
RUNNING = 1


class Diagnostics:
    """Publishes one DiagnosticStatus of a node: at 1 Hz, and soon after each change."""

    def __init__(
        self, node: Node, read: Callable[[], tuple[int, str, dict[str, object]]], hardware: str
    ) -> None:
        """Advertise /diagnostics.

        Args:
            node: owner; its executor calls.
            read: returns LoopStatus' state, the reason, and values to show.
            hardware: what the node stands for.
        """
        self._node = node
        self._read = read
        self._hardware = hardware
        self._told: tuple[int, str] = (-1, "")
        self._looks = 0
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        node.create_timer(LOOK_S, self._look)

    def _look(self) -> None:
        state, reason, values = self._read()
        self._looks += 1
        if (state, reason) == self._told and self._looks * LOOK_S < PERIOD_S:
            return
        self._told, self._looks = (state, reason), 0
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = [self._status(state, reason, values)]
        self._publisher.publish(message)

    def _status(self, state: int, reason: str, values: dict[str, object]) -> DiagnosticStatus:
        level = LEVELS.get(state, DiagnosticStatus.STALE)
        if state == RUNNING and reason:
            level = DiagnosticStatus.WARN
        said = reason or ("running" if state == RUNNING else "waiting for its inputs")
        fault = reason.partition(":")[0] if level == DiagnosticStatus.ERROR else ""
        shown = {"fault": fault, **values}
        return DiagnosticStatus(
            level=level,
            name=f"cabols: {self._node.get_name()}",
            message=said,
            hardware_id=self._hardware,
            values=[KeyValue(key=key, value=str(value)) for key, value in shown.items()],
        )
