# SPDX-License-Identifier: Apache-2.0
"""An executor that outlives messages whose bytes are none of their type.

DDS delivers what any participant sends on a topic. Where the bytes cannot be read, rclpy raises out
of the executor, which would end the node.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from rclpy._rclpy_pybind11 import RMWError
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger


class NodeExecutor(SingleThreadedExecutor):
    """SingleThreadedExecutor that drops messages, requests and answers that cannot be read.

    Attributes:
        unreadable: number of them so far.
    """

    unreadable = 0

    def _make_handler(
        self, entity: Any, node: Any, take_from_wait_list: Callable[[Any], Any]
    ) -> Any:
        def take(what: Any) -> Any:
            try:
                return take_from_wait_list(what)
            except RMWError as error:
                self._note(what, error)
                return None

        return super()._make_handler(entity, node, take)

    def _note(self, entity: Any, error: Exception) -> None:
        """Count, and tell the first one."""
        self.unreadable += 1
        if self.unreadable == 1:
            name = getattr(entity, "topic_name", getattr(entity, "srv_name", "an action"))
            get_logger("executor").warning(
                f"{name}: expected messages of its type, got bytes that are none; they are "
                f"dropped, also later ones ({error})"
            )


def taken_or_none(handle: Any, msg_type: type) -> Any:
    """Take the next message that can be read, and its information; None if none waits.

    Args:
        handle: of the subscription.
        msg_type: of its messages.
    """
    while True:
        with suppress(RMWError):
            return handle.take_message(msg_type, False)
