# SPDX-License-Identifier: Apache-2.0
"""Services and actions of the rig, called from a thread that waits."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from cabols_control.result_code import REFUSALS
from cabols_control.ros.node import ControlNode
from cabols_control.ros.rig_client.calls import RigCalls
from cabols_control.supervision.modes import OperatingMode
from cabols_stiffness.errors import CampaignError
from cabols_stiffness.ros.intake import Intake

ANSWER_S = 10.0
"""Longest wall time of an answer that only says whether something was started [s]."""
RETRY_S = 0.1
REFUSED_S = 2.0
"""Longest time of refusals of a goal, in the rig's time [s]."""
STALL_S = 25.0
"""Wall time without a sample after which the rig counts as gone; a lockstep clock gives up after
20 s."""
SLICE_S = 0.1
ACTION_STRETCH = 20.0
"""Wall time that an action may take for each second of the rig's: lockstep may be slow."""


class InterruptedCampaignError(CampaignError):
    """The campaign cannot continue: an abort, a FAULT, a rig that does not answer."""


class Operator:
    """The operator's services and actions, for a campaign's thread.

    Every wait ends: after its time on the rig's clock, with FAULT, with an abort, or when samples
    stop.
    """

    def __init__(self, node: ControlNode, intake: Intake) -> None:
        """Make the clients."""
        self._node = node
        self._intake = intake
        self._calls = RigCalls(node)
        self._calls.prepare(("set_mode",), ("move_to_configuration", "measure_reflector"))
        self._aborted = ""
        self._goal: Any = None

    def abort(self, reason: str) -> None:
        """End every wait, now and later, with InterruptedCampaignError."""
        self._aborted = self._aborted or reason

    def forget_abort(self) -> None:
        """Allow waits again, so that the rig can be unloaded."""
        self._aborted = ""

    def until(
        self,
        condition: Callable[[], bool],
        seconds: float,
        loading: bool = False,
    ) -> bool:
        """Wait for a condition.

        Args:
            condition: checked after every turn of the intake.
            seconds: of the rig's time.
            loading: whether the mode must stay LOADING meanwhile.

        Returns:
            False when the time is over.

        Raises:
            InterruptedCampaignError: see the class.
        """
        intake = self._intake
        began_ns, seen_ns, seen_at = intake.now_ns, intake.now_ns, time.monotonic()
        while True:
            with intake.news:
                if condition():
                    return True
                intake.news.wait(SLICE_S)
                now_ns = intake.now_ns
            self._look_around(loading)
            if now_ns != seen_ns:
                seen_ns, seen_at = now_ns, time.monotonic()
            elif time.monotonic() - seen_at > STALL_S:
                raise InterruptedCampaignError(
                    f"no wrench for {STALL_S:g} s: is the bridge running?"
                )
            if 1e-9 * (now_ns - began_ns) > seconds:
                return condition()

    def _look_around(self, loading: bool) -> None:
        intake = self._intake
        if self._aborted:
            raise InterruptedCampaignError(self._aborted)
        if not self._node.context.ok():
            raise InterruptedCampaignError("the node ends")
        if intake.mode == OperatingMode.FAULT:
            raise InterruptedCampaignError(f"the rig is in FAULT: {intake.reason}")
        if loading and intake.mode != OperatingMode.LOADING:
            name = "unknown" if intake.mode is None else intake.mode.name
            raise InterruptedCampaignError(f"the mode became {name}: {intake.reason}")

    def pause(self, seconds: float) -> None:
        """Wait for an amount of the rig's time."""
        self.until(lambda: False, seconds)

    def enter(self, mode: OperatingMode, seconds: float) -> str:
        """Ask for a mode until it is granted and there; return why that failed, or nothing."""
        intake, refusal = self._intake, "not asked yet"
        until_ns = intake.now_ns + round(1e9 * seconds)
        while intake.now_ns < until_ns:
            answer = self._answer(self._calls.call("set_mode", mode=int(mode)))
            if answer is None:
                refusal = "the supervisor does not answer"
            elif answer.success:
                if self.until(lambda: intake.mode == mode, seconds):
                    return ""
                return f"{mode.name} was granted but did not come within {seconds:g} s"
            else:
                refusal = answer.message
            self.pause(RETRY_S)
        return f"{mode.name} was not granted: {refusal}"

    def move(self, configuration: int, seconds: float) -> str:
        """Move the robot; return why that failed, or nothing."""
        result, reason = self._act("move_to_configuration", seconds, index=configuration)
        return reason or ("" if result.success else result.message or "the motion failed")

    def measure(self, reflector: int, averaging_s: float, seconds: float) -> tuple[Any, str]:
        """Measure a reflector; return the ReflectorMeasurement, and why that failed, or nothing."""
        goal = {"reflector": reflector, "averaging_time": averaging_s, "search": True}
        result, reason = self._act("measure_reflector", seconds, loading=True, **goal)
        if reason:
            return None, reason
        return result.measurement, "" if result.success else result.message or "it failed"

    def _act(
        self, action: str, seconds: float, loading: bool = False, **goal: Any
    ) -> tuple[Any, str]:
        if not self._found(action):
            return None, "its node does not run: no action server"
        until_ns = self._intake.now_ns + round(1e9 * REFUSED_S)
        while True:
            handle = self._accepted(action, goal)
            if handle is None or not handle.accepted:
                refused = "refused; the node's log says why"
                return None, refused if handle else "no answer to the goal"
            result, reason = self._carried_out(handle, seconds, loading)
            refused_yet = not reason and not result.success and result.code in REFUSALS
            # The nodes receive a mode at different times.
            if not refused_yet or self._intake.now_ns >= until_ns:
                return result, reason
            self.pause(RETRY_S)

    def _carried_out(self, handle: Any, seconds: float, loading: bool) -> tuple[Any, str]:
        """Wait for an accepted goal's result; return it, or why there is none."""
        future = self._calls.result(handle)
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        give_up = time.monotonic() + ACTION_STRETCH * seconds
        try:
            while not done.wait(0.005):
                self._look_around(loading)
                if time.monotonic() > give_up:
                    self._calls.cancel(handle)
                    return None, f"no result within {ACTION_STRETCH * seconds:.0f} s"
        except InterruptedCampaignError:
            self._calls.cancel(handle)
            raise
        return future.result().result, ""

    def _found(self, action: str) -> bool:
        """Wait until an action's server is known; whether it is."""
        give_up = time.monotonic() + ANSWER_S
        while not self._calls.ready(action):
            self._look_around(loading=False)
            if time.monotonic() > give_up:
                return False
            time.sleep(RETRY_S)
        return True

    def _accepted(self, action: str, goal: dict[str, Any]) -> Any:
        """Send a goal until it is accepted: the nodes receive a mode at different times."""
        until_ns = self._intake.now_ns + round(1e9 * REFUSED_S)
        while True:
            handle = self._answer(self._calls.send_goal(action, **goal))
            if handle is None or handle.accepted or self._intake.now_ns >= until_ns:
                return handle
            self.pause(RETRY_S)

    def _answer(self, future: Any) -> Any:
        """Wait for a service's answer; None if there is none in time."""
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        give_up = time.monotonic() + ANSWER_S
        while not done.wait(SLICE_S):
            self._look_around(loading=False)
            if time.monotonic() > give_up:
                future.cancel()
                return None
        return future.result()

    def close(self) -> None:
        """Destroy the clients."""
        self._calls.close()
