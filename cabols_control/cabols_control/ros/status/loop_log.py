# SPDX-License-Identifier: Apache-2.0
"""Log of control loops, which must not wait for a terminal or a disk."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from rclpy.node import Node

from cabols_control.ros.threads.executor_thread import hand_over


class LoopLog:
    """A node's logger whose lines are written by the executor's thread, in their order.

    Each severity has a line of code of its own, because rclpy distinguishes callers by line.
    """

    def __init__(self, node: Node) -> None:
        """Use the node's logger."""
        self._node = node
        self._logger = node.get_logger()
        self._lines: deque[Callable[[], object]] = deque()

    def warm_up(self, line: str) -> None:
        """Write a line at once: a process's first line takes 20 ms and more."""
        self._logger.info(line)

    def info(self, line: str) -> None:
        """Log at level info."""
        self._put(lambda: self._logger.info(line))

    def error(self, line: str) -> None:
        """Log at level error."""
        self._put(lambda: self._logger.error(line))

    def _put(self, write: Callable[[], object]) -> None:
        # An executor takes its newest task first.
        self._lines.append(write)
        hand_over(self._node, self._write_oldest)

    def _write_oldest(self) -> None:
        self._lines.popleft()()
