# SPDX-License-Identifier: Apache-2.0
"""The rig's services and actions on one node, as futures: nothing here waits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cabols_msgs.action import (
    CommissionLimb,
    FollowPath,
    MeasureReflector,
    MoveToConfiguration,
    RunProgram,
    RunStiffnessTest,
)
from cabols_msgs.srv import CheckProgram, InjectFault, SetMode
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from cabols_control.ros.threads.executor_thread import hand_over

SERVICES: dict[str, Any] = {
    "set_mode": SetMode,
    "emergency_stop": Trigger,
    "reset": Trigger,
    "tare": Trigger,
    "record": SetBool,
    "check_program": CheckProgram,
    "pause_stiffness_test": Trigger,
    "resume_stiffness_test": Trigger,
    "abort_stiffness_test": Trigger,
    "report_stiffness_test": Trigger,
    "inject_fault": InjectFault,
}
ONCE = ("tare", "record", "report_stiffness_test")
"""Services that take a while, or do something else the second time: no request is repeated because
no answer has come yet."""
ASK_AGAIN_S = 1.0
"""Any other request is sent again when there was no answer for this long [s]."""
ACTIONS: dict[str, Any] = {
    "run_program": RunProgram,
    "commission_limb": CommissionLimb,
    "move_to_configuration": MoveToConfiguration,
    "follow_path": FollowPath,
    "measure_reflector": MeasureReflector,
    "run_stiffness_test": RunStiffnessTest,
}


class RigCalls:
    """Clients of the rig's services and actions, made when they are first used.

    Requests of actions leave from the executor's thread: rclpy notes one as pending only after it
    has been sent, so that from another thread an answer that comes at once would be lost.
    """

    def __init__(self, node: Node) -> None:
        """Use a node; its owner spins it."""
        self._node = node
        self._services: dict[str, Any] = {}
        self._actions: dict[str, ActionClient] = {}

    def prepare(self, services: tuple[str, ...] = (), actions: tuple[str, ...] = ()) -> None:
        """Make clients beforehand, so that their servers are known when they are needed."""
        for name in services:
            self._service(name)
        for name in actions:
            self._action(name)

    def ready(self, name: str) -> bool:
        """Whether the server of a service or an action is known."""
        if name in ACTIONS:
            return bool(self._action(name).server_is_ready())
        return bool(self._service(name).service_is_ready())

    def call(self, service: str, **fields: Any) -> Future:
        """Send one request; the future brings the response."""
        future: Future = self._service(service).call_async(SERVICES[service].Request(**fields))
        return future

    def forget(self, service: str, future: Future) -> None:
        """Drop a request that is no longer waited for."""
        self._service(service).remove_pending_request(future)

    def send_goal(
        self, action: str, on_feedback: Callable[[Any], object] | None = None, **fields: Any
    ) -> Future:
        """Send a goal; the future brings its handle, accepted or not."""
        client, goal = self._action(action), ACTIONS[action].Goal(**fields)

        def hear(message: Any) -> None:
            if on_feedback is not None:
                on_feedback(message.feedback)

        return self._sent(lambda: client.send_goal_async(goal, hear))

    def result(self, handle: Any) -> Future:
        """Ask for the result of an accepted goal; the future brings status and result."""
        return self._sent(handle.get_result_async)

    def cancel(self, handle: Any) -> Future:
        """Ask for the end of a goal; the future brings what the server answers."""
        return self._sent(handle.cancel_goal_async)

    def close(self) -> None:
        """Destroy the action clients; the others go with the node."""
        for client in self._actions.values():
            client.destroy()
        self._actions.clear()

    def _service(self, name: str) -> Any:
        if name not in self._services:
            self._services[name] = self._node.create_client(SERVICES[name], name)
        return self._services[name]

    def _action(self, name: str) -> ActionClient:
        if name not in self._actions:
            self._actions[name] = ActionClient(self._node, ACTIONS[name], name)
        return self._actions[name]

    def _sent(self, send: Callable[[], Future]) -> Future:
        """Send from the executor's thread; return the future of the answer itself."""
        answered = Future()

        def settle(answer: Future) -> None:
            error = answer.exception()
            if error is not None:
                answered.set_exception(error)
            else:
                answered.set_result(answer.result())

        def sent(task: Future) -> None:
            if task.exception() is not None:
                settle(task)
            else:
                task.result().add_done_callback(settle)

        hand_over(self._node, send).add_done_callback(sent)
        return answered
