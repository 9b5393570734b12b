# SPDX-License-Identifier: Apache-2.0
"""Goals that are refused: accepted and ended at once, so that the client reads why.

A goal that an action server rejects tells its client nothing else. Refused goals are therefore
aborted before anything has begun, with the code and the reason in the result.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from cabols_control.result_code import ResultCode


@dataclass(frozen=True)
class Refusal:
    """Why a goal is refused.

    Attributes:
        code: for programs; one of those of which nothing has begun.
        reason: for people.
    """

    code: ResultCode
    reason: str


def serve(
    node: Node,
    kind: Any,
    name: str,
    judge: Callable[[Any], Refusal | None],
    execute: Callable[[Any], Any],
) -> ActionServer:
    """Serve an action whose goals are judged first.

    Args:
        node: that serves.
        kind: class of the action; its result has `message` and `code`.
        name: of the action, relative to the namespace.
        judge: returns why a goal is refused; None: it is not.
        execute: coroutine that carries a goal out.
    """

    async def judged(handle: Any) -> Any:
        refusal = judge(handle.request)
        if refusal is None:
            return await execute(handle)
        node.get_logger().error(f"{name} refused: {refusal.reason}")
        handle.abort()
        return kind.Result(message=f"refused: {refusal.reason}", code=int(refusal.code))

    return ActionServer(
        node,
        kind,
        name,
        judged,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
        callback_group=ReentrantCallbackGroup(),
    )
