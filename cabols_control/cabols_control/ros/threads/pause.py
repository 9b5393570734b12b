# SPDX-License-Identifier: Apache-2.0
"""A wait inside an action's coroutine that leaves the executor to others."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.task import Future


async def pause(node: Node, seconds: float) -> None:
    """Wait without blocking the executor."""
    future: Future = Future()
    timer = node.create_timer(seconds, lambda: future.set_result(None))
    await future
    node.destroy_timer(timer)
