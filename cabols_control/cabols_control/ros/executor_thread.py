"""Work that any thread hands to the one in which a node's executor runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.task import Future


def hand_over(node: Node, function: Callable[[], Any]) -> Future:
    """Let the executor's thread call a function; at once, here, for a node without an executor.

    For what must not keep a control loop waiting, as a line for a terminal; and for the requests of
    action clients: rclpy notes one as pending only after it has been sent, so that from another
    thread an answer that comes at once would find nobody waiting.

    Returns:
        What becomes of the call; its result is the function's.
    """
    executor = node.executor
    if executor is not None:
        return executor.create_task(function)
    done = Future()
    done.set_result(function())
    return done
