"""The console's commands: services and actions that any ROS client could call."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any

from cabols_msgs.action import (
    CommissionLimb,
    MeasureReflector,
    MoveToConfiguration,
    RunProgram,
    RunStiffnessTest,
)
from cabols_msgs.srv import CheckProgram, SetMode
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from cabols_control.console.dispatcher import Answer
from cabols_control.console.latest import NOTICE, WARNING, LatestValues
from cabols_control.ros.executor_thread import hand_over

ANSWER_S = 5.0
"""Longest wait for an answer [s]."""
MATCH_S = 3.0
"""Longest wait for a service that is not matched: its node, or this one, may just have started."""
LOOK_AGAIN_S = 0.02
"""Between looks whether a service is matched [s]."""
REPEAT_S = 0.5
"""A repeated request is sent again when there was no answer for this long [s]."""
REPEATED = ("emergency_stop", "check_program")
"""Services that may be asked twice: what is done already changes nothing, and a request that went
to a server which has just died must not be the last one."""
SERVICES: dict[str, tuple[Any, str]] = {
    "set_mode": (SetMode, "set_mode"),
    "emergency_stop": (Trigger, "emergency_stop"),
    "reset": (Trigger, "reset"),
    "tare": (Trigger, "tare"),
    "record": (SetBool, "record"),
    "check_program": (CheckProgram, "check_program"),
    "pause": (Trigger, "pause_stiffness_test"),
    "resume": (Trigger, "resume_stiffness_test"),
    "abort": (Trigger, "abort_stiffness_test"),
    "report": (Trigger, "report_stiffness_test"),
}
ACTIONS: dict[str, Any] = {
    "run_program": RunProgram,
    "commission_limb": CommissionLimb,
    "move_to_configuration": MoveToConfiguration,
    "measure_reflector": MeasureReflector,
    "run_stiffness_test": RunStiffnessTest,
}


class Calls:
    """Clients of the rig's services and actions, for coroutines of the server's loop.

    Their answers arrive in the node's executor, which hands them to the loop that called.
    """

    def __init__(self, node: Node, latest: LatestValues) -> None:
        """Create the clients without calling them."""
        self._node = node
        self._latest = latest
        self._services = {
            key: node.create_client(kind, name) for key, (kind, name) in SERVICES.items()
        }
        self._actions = {name: ActionClient(node, kind, name) for name, kind in ACTIONS.items()}
        self._activities: dict[str, dict[str, Any]] = {}
        self._handles: dict[str, Any] = {}

    def close(self) -> None:
        """Destroy the action clients."""
        for client in self._actions.values():
            client.destroy()

    async def call(self, service: str, fields: dict[str, Any]) -> Answer:
        """Call a service; the answer says so if it does not reply in time."""
        client, (kind, name) = self._services[service], SERVICES[service]
        if not await self._matched(client.service_is_ready):
            return Answer(False, f"no service {name}: its node is not running")
        try:
            response = await self._ask(client, kind.Request(**fields), service in REPEATED)
        except asyncio.TimeoutError:
            return Answer(False, f"{name}: no answer within {ANSWER_S:g} s")
        return Answer(bool(response.success), str(response.message) or "done", response)

    async def _matched(self, ready: Callable[[], bool]) -> bool:
        """Wait until a service or an action's server is matched; whether it is."""
        clock = asyncio.get_running_loop().time
        give_up = clock() + MATCH_S
        while not ready():
            if clock() >= give_up:
                return False
            await asyncio.sleep(LOOK_AGAIN_S)
        return True

    async def _ask(self, client: Any, request: Any, repeated: bool) -> Any:
        """Send a request, again and again if it may be repeated; the first answer counts.

        Raises:
            asyncio.TimeoutError: after ANSWER_S.
        """
        loop = asyncio.get_running_loop()
        arrived, sent = asyncio.Event(), []
        give_up = loop.time() + ANSWER_S
        try:
            while True:
                sent.append(client.call_async(request))
                sent[-1].add_done_callback(lambda _: loop.call_soon_threadsafe(arrived.set))
                left = give_up - loop.time()
                try:
                    await asyncio.wait_for(
                        arrived.wait(), min(REPEAT_S, left) if repeated else left
                    )
                except asyncio.TimeoutError:
                    if not repeated or loop.time() >= give_up:
                        raise
                else:
                    return next(future for future in sent if future.done()).result()
        finally:
            for future in sent:
                if not future.done():
                    client.remove_pending_request(future)

    async def start(self, action: str, fields: dict[str, Any]) -> Answer:
        """Send a goal; its end shows in the activities."""
        client, kind = self._actions[action], ACTIONS[action]
        if not await self._matched(client.server_is_ready):
            return Answer(False, f"no action {action}: its node is not running")
        if self._activities.get(action, {}).get("busy"):
            return Answer(False, f"{action} is under way")
        self._set(action, busy=True, progress=0.0, text="asked")
        goal = kind.Goal(**fields)
        sending = hand_over(
            self._node,
            lambda: client.send_goal_async(goal, lambda heard: self._hear(action, heard.feedback)),
        )
        try:
            handle = await self._arrive(await self._arrive(sending))
        except asyncio.TimeoutError:
            sending.add_done_callback(
                lambda late: late.result().add_done_callback(
                    lambda answer: self._begin_late(action, answer)
                )
            )
            self._set(action, busy=False, progress=0.0, text=f"no answer within {ANSWER_S:g} s")
            return Answer(False, f"{action}: no answer within {ANSWER_S:g} s")
        if not handle.accepted:
            text = "refused: the log says why"
            self._set(action, busy=False, progress=0.0, text=text)
            return Answer(False, text)
        self._follow(action, handle)
        return Answer(True, "accepted")

    async def cancel(self, action: str) -> Answer:
        """Cancel an action that was started here."""
        handle = self._handles.get(action)
        if handle is None:
            return Answer(False, f"{action} is not under way")
        try:
            sending = hand_over(self._node, handle.cancel_goal_async)
            response = await self._arrive(await self._arrive(sending))
        except asyncio.TimeoutError:
            return Answer(False, f"{action}: no answer within {ANSWER_S:g} s")
        return Answer(bool(response.goals_canceling), "cancelling")

    async def _arrive(self, future: Future) -> Any:
        """Await a future of rclpy in asyncio.

        Raises:
            asyncio.TimeoutError: after ANSWER_S.
        """
        loop = asyncio.get_running_loop()
        arrived = asyncio.Event()
        future.add_done_callback(lambda _: loop.call_soon_threadsafe(arrived.set))
        await asyncio.wait_for(arrived.wait(), ANSWER_S)
        return future.result()

    def _begin_late(self, action: str, sent: Future) -> None:
        """Take a late answer, so that an action that has begun can still be cancelled."""
        handle = sent.result()
        if handle is not None and handle.accepted:
            self._set(action, busy=True, text="accepted late")
            self._follow(action, handle)

    def _follow(self, action: str, handle: Any) -> None:
        self._handles[action] = handle
        asking = hand_over(self._node, handle.get_result_async)
        asking.add_done_callback(
            lambda asked: asked.result().add_done_callback(lambda done: self._end(action, done))
        )

    def _end(self, action: str, done: Future) -> None:
        self._handles.pop(action, None)
        result = done.result().result
        success = bool(result.success)
        text = _RESULTS.get(action, _plain)(result)
        self._set(action, busy=False, progress=1.0 if success else 0.0, text=text)
        self._latest.tell(NOTICE if success else WARNING, action.replace("_", " "), text or "ended")

    def _hear(self, action: str, feedback: Any) -> None:
        progress, text = _FEEDBACKS[action](feedback)
        self._set(action, busy=True, progress=progress, text=text)

    def _set(self, action: str, **parts: Any) -> None:
        self._activities[action] = {**self._activities.get(action, {}), **parts}
        self._latest.put_state(activities=dict(self._activities))


def _plain(result: Any) -> str:
    return str(result.message) or ("done" if result.success else "failed")


def _limb_result(result: Any) -> str:
    found = []
    if math.isfinite(result.gain):
        found.append(f"k {result.gain:.4f} m/s/A, T {result.time_constant:.4f} s")
    if math.isfinite(result.stiffness):
        found.append(f"k_e {result.stiffness:.0f} N/m")
    return "; ".join([*found, result.message])


def _campaign_result(result: Any) -> str:
    return f"{_plain(result)}: {result.loads} loads, {result.skipped} skipped, in {result.folder}"


def _program_feedback(f: Any) -> tuple[float, str]:
    left = max(f.duration - f.elapsed, 0.0)
    return f.elapsed / max(
        f.duration, 1e-9
    ), f"running: {f.elapsed:.0f} of {f.duration:.0f} s, {left:.0f} s left"


def _campaign_feedback(f: Any) -> tuple[float, str]:
    """Shorten the feedback: campaign_status holds the rest, for every page and console."""
    return f.done / max(f.total, 1), str(f.phase)


_RESULTS: dict[str, Callable[[Any], str]] = {
    "commission_limb": _limb_result,
    "run_stiffness_test": _campaign_result,
}
_FEEDBACKS: dict[str, Callable[[Any], tuple[float, str]]] = {
    "run_program": _program_feedback,
    "commission_limb": lambda f: (float(f.progress), str(f.phase)),
    "move_to_configuration": lambda f: (0.0, f"moving, {f.elapsed:.0f} s"),
    "measure_reflector": lambda f: (0.0, f"{f.phase}, {f.elapsed:.0f} s"),
    "run_stiffness_test": _campaign_feedback,
}
