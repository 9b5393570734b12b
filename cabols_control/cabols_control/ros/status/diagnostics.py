# SPDX-License-Identifier: Apache-2.0
"""Every node's report on /diagnostics, named as diagnostic_updater does: node, colon, task."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from cabols_control.supervision.faults import Fault

PERIOD_S = 1.0
"""Period of the reports [s]; each delays its process's control loop by 0.7 ms."""
LEVELS = {0: DiagnosticStatus.WARN, 1: DiagnosticStatus.OK, 2: DiagnosticStatus.ERROR}
"""By the state of LoopStatus: waiting, running, fault."""
RUNNING = 1
TASK = "loop"
"""What a status is about, behind the node's name."""


class Health(NamedTuple):
    """State of a node.

    Attributes:
        state: LoopStatus' number.
        fault: what is wrong; None for nothing.
        values: more to show, by name.
    """

    state: int
    fault: Fault | None
    values: dict[str, object]


class Diagnostics:
    """Publishes one DiagnosticStatus of a node at 1 Hz and on demand."""

    def __init__(self, node: Node, read: Callable[[], Health], hardware: Callable[[], str]) -> None:
        """Advertise /diagnostics.

        Args:
            node: owner; its executor calls.
            read: returns the node's state.
            hardware: returns what the node stands for: a device, or the rig.
        """
        self._node = node
        self._read = read
        self._hardware = hardware
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        node.create_timer(PERIOD_S, self.tell)

    def tell(self) -> None:
        """Publish the present state; to be called in the executor's thread."""
        health = self._read()
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = [self._status(health)]
        self._publisher.publish(message)

    def _status(self, health: Health) -> DiagnosticStatus:
        state, fault, values = health
        level = LEVELS.get(state, DiagnosticStatus.STALE)
        if state == RUNNING and fault is not None:
            level = DiagnosticStatus.WARN
        said = "running" if state == RUNNING else "waiting for its inputs"
        if fault is not None:
            said = fault.reason
        shown = {"fault": "" if fault is None else fault.name.value, **values}
        return DiagnosticStatus(
            level=level,
            # As diagnostic_updater with use_fqn: rigs of several namespaces share the topic.
            name=f"{self._node.get_fully_qualified_name()}: {TASK}",
            message=said,
            hardware_id=self._hardware(),
            values=[KeyValue(key=key, value=str(value)) for key, value in shown.items()],
        )
