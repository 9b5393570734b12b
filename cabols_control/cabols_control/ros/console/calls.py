# SPDX-License-Identifier: Apache-2.0
"""The console's commands: services and actions that any ROS client could call."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from rclpy.node import Node
from rclpy.task import Future

from cabols_control.console.dispatcher import Answer
from cabols_control.console.latest import NOTICE, WARNING, LatestValues
from cabols_control.result_code import REFUSALS
from cabols_control.ros.rig_client.calls import ACTIONS, ONCE, SERVICES, RigCalls
from cabols_control.ros.rig_client.running_action import JUDGED
from cabols_control.ros.stops import ALONE_S, StopSender
from cabols_control.supervision.supervision_config import SupervisionConfig

BRIDGES = SupervisionConfig.bridges
ANSWER_S = 5.0
"""Longest wait for an answer [s]."""
MATCH_S = 3.0
"""Longest wait for a server that is not matched: its node, or this one, may just have started."""
LOOK_AGAIN_S = 0.02
"""Between looks whether a server is matched [s]."""
REFUSED_S = 0.3
"""Time in which a goal that is accepted may still be refused [s]; see ros/refusal.py."""
REPEAT_S = 0.5
"""A request is sent again when there was no answer for this long [s]; some never are: ONCE."""
STOP = "emergency_stop"
TOLD_AFTER_S = 0.5
"""After a stop the page is told who has acknowledged it [s]."""
CAMPAIGN = {key: f"{key}_stiffness_test" for key in ("pause", "resume", "abort", "report")}
"""Names of services that the page calls by less."""


class Calls:
    """Clients of the rig's services and actions, for coroutines of the server's loop.

    Their answers arrive in the node's executor, which hands them to the loop that called.
    """

    def __init__(self, node: Node, latest: LatestValues) -> None:
        """Create the clients without calling them."""
        self._latest = latest
        self._calls = RigCalls(node)
        self._calls.prepare(tuple(SERVICES.keys() - {"inject_fault"}), tuple(ACTIONS))
        # A stand-in of a node, for tests of the services alone, has no topics.
        self._stops = StopSender(node) if isinstance(node, Node) else None
        self._activities: dict[str, dict[str, Any]] = {}
        self._handles: dict[str, Any] = {}

    def close(self) -> None:
        """Destroy the action clients."""
        self._calls.close()

    async def call(self, service: str, fields: dict[str, Any]) -> Answer:
        """Call a service until it answers; what does not answer in time is said.

        Args:
            service: its name, or a short one of a campaign's.
            fields: of the request.
        """
        if service == STOP and self._stops is not None:
            return await self._stop(self._stops)
        return await self._ask(service, fields)

    async def _stop(self, stops: StopSender) -> Answer:
        """Press the stop on its topic; ask the service where nobody acknowledges at once.

        A request beside an acknowledged press could reach a supervisor after the press's reset, and
        has no number by which it would know the two as one.
        """
        number = stops.press("the console")
        loop = asyncio.get_running_loop()
        alone, give_up = loop.time() + ALONE_S, loop.time() + ANSWER_S + MATCH_S
        while not stops.stopped(number) and loop.time() < alone:
            await asyncio.sleep(LOOK_AGAIN_S)
        answer = Answer(False, "the supervisor is silent")
        if not stops.stopped(number):
            asking = asyncio.ensure_future(self._ask(STOP, {}))
            while not (asking.done() or stops.stopped(number)) and loop.time() < give_up:
                await asyncio.sleep(LOOK_AGAIN_S)
            if asking.done():
                answer = asking.result()
            asking.cancel()
        await asyncio.sleep(LOOK_AGAIN_S)
        loop.call_later(TOLD_AFTER_S, lambda: self._tell_of_stop(stops.acknowledged(number)))
        if not stops.stopped(number):
            return answer
        nodes = ", ".join(stops.acknowledged(number))
        return Answer(True, f"stopped, acknowledged by {nodes}; call reset to go on")

    def _tell_of_stop(self, nodes: list[str]) -> None:
        level = NOTICE if set(BRIDGES) & set(nodes) else WARNING
        names = ", ".join(nodes) or "nobody"
        self._latest.tell(level, "emergency stop", f"acknowledged by {names}")

    async def _ask(self, service: str, fields: dict[str, Any]) -> Answer:
        name = CAMPAIGN.get(service, service)
        loop = asyncio.get_running_loop()
        if not await self._found(name):
            return Answer(False, f"no service {name}: its node is not running")
        asked: list[Future] = []
        give_up = loop.time() + ANSWER_S
        try:
            while (left := give_up - loop.time()) > 0.0:
                asked.append(self._calls.call(name, **fields))
                patience = left if name in ONCE else min(REPEAT_S, left)
                with suppress(asyncio.TimeoutError):
                    found = await _first(asked, patience)
                    return Answer(bool(found.success), str(found.message) or "done", found)
            return Answer(False, f"{name}: no answer within {ANSWER_S:g} s")
        finally:
            for future in asked:
                if not future.done():
                    self._calls.forget(name, future)

    async def start(self, action: str, fields: dict[str, Any]) -> Answer:
        """Send a goal; its end shows in the activities.

        Args:
            action: its name.
            fields: of the goal.
        """
        if not await self._found(action):
            return Answer(False, f"no action {action}: its node is not running")
        if self._activities.get(action, {}).get("busy"):
            return Answer(False, f"{action} is under way")
        self._set(action, busy=True, progress=0.0, text="asked")
        sent = self._calls.send_goal(action, lambda heard: self._hear(action, heard), **fields)
        try:
            handle = await _first([sent], ANSWER_S)
        except asyncio.TimeoutError:
            sent.add_done_callback(lambda answer: self._begin_late(action, answer))
            self._set(action, busy=False, progress=0.0, text=f"no answer within {ANSWER_S:g} s")
            return Answer(False, f"{action}: no answer within {ANSWER_S:g} s")
        if not handle.accepted:
            text = "refused: the log says why"
            self._set(action, busy=False, progress=0.0, text=text)
            return Answer(False, text)
        result = self._follow(action, handle)
        if action in JUDGED:
            with suppress(asyncio.TimeoutError):
                found = (await _first([result], REFUSED_S)).result
                if not found.success and found.code in REFUSALS:
                    return Answer(False, str(found.message), found)
        return Answer(True, "accepted")

    async def cancel(self, action: str) -> Answer:
        """Cancel an action that was started here."""
        handle = self._handles.get(action)
        if handle is None:
            return Answer(False, f"{action} is not under way")
        try:
            response = await _first([self._calls.cancel(handle)], ANSWER_S)
        except asyncio.TimeoutError:
            return Answer(False, f"{action}: no answer within {ANSWER_S:g} s")
        return Answer(bool(response.goals_canceling), "cancelling")

    async def _found(self, name: str) -> bool:
        """Wait until a service or an action's server is matched; whether it is."""
        clock = asyncio.get_running_loop().time
        give_up = clock() + MATCH_S
        while not self._calls.ready(name):
            if clock() >= give_up:
                return False
            await asyncio.sleep(LOOK_AGAIN_S)
        return True

    def _begin_late(self, action: str, sent: Future) -> None:
        """Take a late answer, so that an action that has begun can still be cancelled."""
        handle = sent.result()
        if handle is not None and handle.accepted:
            self._set(action, busy=True, text="accepted late")
            self._follow(action, handle)

    def _follow(self, action: str, handle: Any) -> Future:
        self._handles[action] = handle
        result: Future = self._calls.result(handle)
        result.add_done_callback(lambda done: self._end(action, done))
        return result

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


async def _first(futures: list[Future], seconds: float) -> Any:
    """Await in asyncio the first answer of rclpy's futures.

    Raises:
        asyncio.TimeoutError: if none has come within that time.
    """
    loop = asyncio.get_running_loop()
    arrived = asyncio.Event()
    for future in futures:
        future.add_done_callback(lambda _: loop.call_soon_threadsafe(arrived.set))
    await asyncio.wait_for(arrived.wait(), seconds)
    return next(future.result() for future in futures if future.done())


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
