# SPDX-License-Identifier: Apache-2.0
"""Calls that any thread hands to the thread of a node's executor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.task import Future


def hand_over(node: Node, function: Callable[[], Any]) -> Future:
    """Let the executor's thread call a function; without an executor it is called at once.

    For calls that must not delay a control loop, such as a line for a terminal, and for requests of
    action clients: rclpy registers a request as pending only after sending it, so that an immediate
    answer to a request of another thread would be lost.

    Returns:
        A future of the function's result.
    """
    executor = node.executor
    if executor is not None:
        return executor.create_task(function)
    done = Future()
    done.set_result(function())
    return done
