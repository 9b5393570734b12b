# SPDX-License-Identifier: Apache-2.0
"""RigClient: what an operator does, from a script or a tool."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Any

from cabols_msgs.msg import LoopStatus

from cabols_control.result_code import ResultCode
from cabols_control.ros.rig_client.calls import ASK_AGAIN_S, ONCE
from cabols_control.ros.rig_client.connection import RigConnection
from cabols_control.ros.rig_client.errors import (
    AbandonedError,
    RefusedError,
    RigError,
    RigTimeoutError,
)
from cabols_control.ros.rig_client.running_action import JUDGED, RunningAction, refusal
from cabols_control.ros.stops import ALONE_S
from cabols_control.supervision.modes import MOVING, OperatingMode
from cabols_control.supervision.supervision_config import SupervisionConfig

NODES = ("supervisor", "limb_controller", "wrench_controller")
"""Nodes of the control path, beside a bridge."""
BRIDGES = SupervisionConfig.bridges
START_S = 180.0
"""Longest wait for nodes to run [s]; a first start compiles for a minute or two."""
STEP_S = 40.0
"""Longest wait for a step of the rig, in its own time [s]."""
ANSWER_S = 10.0
"""Longest wait for an answer [s]."""
RETRY_S = 0.1
"""Between a refusal and the next request [s]."""
FINAL = (ResultCode.BAD_REQUEST, ResultCode.FAULT_LATCHED)
"""Refusals that asking again does not lift."""


class RigClient(RigConnection):
    """One client of a running rig, simulated or not; its methods wait, and every wait has an end.

    As a context manager it is a program of its own:

        with RigClient() as rig:
            rig.wait_running()
            rig.pretighten()
            rig.enter(OperatingMode.LOADING)
            rig.run_program("ramps")
            rig.enter(OperatingMode.STOPPED)

    If the block fails, or is interrupted, while the rig moves, the client requests a stop.

    A request is repeated until it is answered, as a server may not be matched yet, or may just have
    been restarted. Methods are for one thread at a time, never the executor's; only `abandon` is
    for another one.
    """

    _moved = False

    def __enter__(self) -> RigClient:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the graph; after an error, request a stop if this client moved the rig."""
        try:
            if error is not None and self._moved and self.mode in MOVING:
                with suppress(RigError, AbandonedError):
                    self.ask("set_mode", mode=int(OperatingMode.STOPPED))
        finally:
            self.close()

    def wait_running(self, *nodes: str, timeout_s: float = START_S) -> None:
        """Wait until nodes report that they run.

        Args:
            nodes: their names; none: the control path and a bridge.
            timeout_s: longest wait [s].

        Raises:
            RigTimeoutError: naming the nodes that are missing, with what they report.
        """

        def missing() -> list[str]:
            reports = self.reports.items()
            running = {name for name, report in reports if report.state == LoopStatus.RUNNING}
            found = [name for name in nodes or NODES if name not in running]
            if not nodes and not running & set(BRIDGES):
                found.append(" or ".join(BRIDGES))
            return found

        def what() -> str:
            return "reports of " + ", ".join(f"{n}{self._trouble(n)}" for n in missing())

        self.wait(lambda: not missing(), what, timeout_s, even_in_fault=True)

    def _trouble(self, name: str) -> str:
        report = self.reports.get(name)
        return "" if report is None or not report.reason else f" ({report.reason})"

    def call(self, service: str, timeout_s: float = ANSWER_S, **fields: Any) -> Any:
        """Call a service until it answers.

        Args:
            service: its name, out of rig_client.calls.SERVICES.
            timeout_s: longest wait [s].
            fields: of the request.

        Returns:
            The response, with success or without.

        Raises:
            RigTimeoutError: if there is no answer.
        """
        give_up = time.monotonic() + timeout_s
        asked: list[Any] = []

        def left() -> float:
            return max(give_up - time.monotonic(), 0.0)

        def answered() -> bool:
            return any(future.done() for future in asked)

        what = f"an answer of the service {service}"
        try:
            while not answered():
                if not left():
                    raise RigTimeoutError(what, timeout_s, self._standing())
                self.wait(
                    lambda: self.calls.ready(service),
                    f"the service {service}: its node is not running",
                    left(),
                    even_in_fault=True,
                )
                asked.append(self.watched(self.calls.call(service, **fields)))
                patience = left() if service in ONCE else min(ASK_AGAIN_S, left())
                with suppress(RigTimeoutError):
                    self.wait(answered, what, patience, even_in_fault=True)
            return next(future.result() for future in asked if future.done())
        finally:
            for future in asked:
                if not future.done():
                    self.calls.forget(service, future)

    def ask(self, service: str, timeout_s: float = ANSWER_S, **fields: Any) -> Any:
        """Call a service that must succeed; as call().

        Raises:
            RefusedError: if it answers without success.
            RigTimeoutError: if there is no answer.
        """
        answer = self.call(service, timeout_s, **fields)
        if not answer.success:
            fault = str(getattr(answer, "fault", ""))
            code = int(getattr(answer, "code", ResultCode.UNKNOWN))
            raise RefusedError(service, str(answer.message), code, fault)
        return answer

    def enter(self, mode: OperatingMode, timeout_s: float | None = None) -> None:
        """Request a mode until it is granted, then wait until it is reached.

        A refusal that lasts, as a node does not run yet or a limb is slack, is raised at the end.

        Args:
            mode: that is wanted.
            timeout_s: longest wait [s]; None: 40 s of the rig's time.

        Raises:
            RefusedError: with the code of the last refusal; at once where asking again is in vain.
            RigFaultError: if the rig is in FAULT.
            RigTimeoutError: if the supervisor does not answer, or the mode does not come.
        """
        seconds = STEP_S / self._speed if timeout_s is None else timeout_s
        give_up = time.monotonic() + seconds
        self._moved = self._moved or mode in MOVING
        while True:
            self.check_fault()
            left = max(give_up - time.monotonic(), RETRY_S)
            answer = self.call("set_mode", min(left, ANSWER_S), mode=int(mode))
            if answer.success:
                break
            if answer.code in FINAL or self._lasts(answer.code) or time.monotonic() >= give_up:
                self.check_fault()
                request = f"mode {mode.name}"
                raise RefusedError(request, answer.message, answer.code, answer.fault)
            self.pause(RETRY_S * self._speed)
        self.wait(lambda: self.mode == mode, f"the mode {mode.name}", seconds)

    def _lasts(self, code: int) -> bool:
        return code == ResultCode.WRONG_MODE and self.mode != OperatingMode.UNLOADING

    def pretighten(self, timeout_s: float | None = None) -> None:
        """Enter PRETIGHTENING, and wait until every limb has a zero of this pre-tightening.

        Args:
            timeout_s: longest wait for either [s]; None: 40 s of the rig's time.

        Raises:
            RigError: as enter() and wait().
        """
        self.enter(OperatingMode.PRETIGHTENING, timeout_s)
        seconds = STEP_S / self._speed if timeout_s is None else timeout_s

        def zeroed() -> bool:
            state, mode = self.newest_if_any("limb_state"), self._mode
            if state is None or mode is None or state.zeroing != mode.zeroing:
                return False
            return all(state.zeroed)

        self.wait(zeroed, "the zeros of all limbs", seconds)

    def bring_to(self, mode: OperatingMode, timeout_s: float | None = None) -> None:
        """Go to a mode from wherever the rig is: reset FAULT, pre-tighten before LOADING.

        Args:
            mode: that is wanted.
            timeout_s: longest wait for each step [s]; None: 40 s of the rig's time.

        Raises:
            RigError: as enter().
        """
        if self.mode == OperatingMode.FAULT:
            self.reset()
        if mode == OperatingMode.LOADING and self.mode != OperatingMode.LOADING:
            self.pretighten(timeout_s)
        self.enter(mode, timeout_s)

    def start(
        self,
        action: str,
        on_feedback: Callable[[Any], object] | None = None,
        accept_s: float = ANSWER_S,
        **fields: Any,
    ) -> RunningAction:
        """Start an action; a goal that is refused is sent again for a while.

        Args:
            action: its name, out of rig_client.calls.ACTIONS.
            on_feedback: called with each feedback, in the executor's thread.
            accept_s: longest wait until it is accepted [s].
            fields: of the goal.

        Returns:
            The accepted goal.

        Raises:
            RefusedError: if it was refused until the end, or is no goal that could be accepted.
            RigTimeoutError: if there is no server, or no answer.
        """
        give_up = time.monotonic() + accept_s
        while True:
            left = max(give_up - time.monotonic(), RETRY_S)
            absent = f"the action {action}: its node is not running"
            self.wait(lambda: self.calls.ready(action), absent, left)
            began = threading.Event()

            def hear(feedback: Any, began: threading.Event = began) -> None:
                began.set()
                if on_feedback is not None:
                    on_feedback(feedback)

            sent = self.watched(self.calls.send_goal(action, hear, **fields))
            try:
                self.wait(sent.done, f"an answer of {action}", left)
            except BaseException:
                sent.add_done_callback(self._cancel_late)
                raise
            handle = sent.result()
            refused = RefusedError(action, "its node's log says why")
            if handle.accepted:
                running = RunningAction(self, action, handle)
                found = refusal(running, began) if action in JUDGED else None
                if found is None:
                    return running
                refused = RefusedError(action, str(found.message), found.code)
            if refused.code == ResultCode.BAD_REQUEST or time.monotonic() >= give_up:
                raise refused
            self.pause(RETRY_S * self._speed)

    def _cancel_late(self, sent: Any) -> None:
        """Cancel a goal that was accepted too late, after the wait for it had ended."""
        handle = sent.result()
        if handle is not None and handle.accepted:
            self.calls.cancel(handle)

    def run(
        self,
        action: str,
        on_feedback: Callable[[Any], object] | None = None,
        timeout_s: float = 3600.0,
        accept_s: float = ANSWER_S,
        **fields: Any,
    ) -> Any:
        """Run an action to its end; cancelled if the wait ends before; as start() and result().

        Raises:
            ActionFailedError: if the action ended without success; its result is in the error.
            RefusedError: if it was not accepted.
            RigError: as wait().
        """
        return self.start(action, on_feedback, accept_s, **fields).result(timeout_s)

    def run_program(
        self,
        program: str,
        scale: float = 1.0,
        checked: bool = False,
        on_feedback: Callable[[Any], object] | None = None,
    ) -> Any:
        """Run a load programme, in LOADING.

        Args:
            program: a built-in programme's name, or the path of a CSV file on the rig's computer.
            scale: factor on forces and torques.
            checked: refuse it unless it is feasible at the present pose.
            on_feedback: called with elapsed and whole time, in the executor's thread.

        Raises:
            RigError: as run().
        """
        return self.run("run_program", on_feedback, program=program, scale=scale, checked=checked)

    def emergency_stop(self, timeout_s: float = ANSWER_S) -> None:
        """Cut all currents, stop the robot and latch FAULT.

        Sent on the topic `stop` until it is acknowledged; where nobody does so at once, asked of
        the supervisor besides.

        Raises:
            RigError: if no bridge has acknowledged it, and the supervisor does not answer, or
                refuses.
        """
        number = self.stops.press(self.node.get_name())
        give_up = time.monotonic() + timeout_s
        alone = time.monotonic() + ALONE_S
        while time.monotonic() < alone:
            if self.stops.stopped(number):
                return
            time.sleep(self._poll_s)
        while (left := give_up - time.monotonic()) > ASK_AGAIN_S:
            with suppress(RigTimeoutError):
                self.ask("emergency_stop", min(ASK_AGAIN_S, left))
                return
            if self.stops.stopped(number):
                return
        self.ask("emergency_stop", max(left, 0.0))

    def reset(self, timeout_s: float = ANSWER_S) -> None:
        """Leave FAULT for STOPPED, and wait for it.

        Raises:
            RigError: if the supervisor does not answer, or refuses.
        """
        self.ask("reset", timeout_s)
        self.wait(
            lambda: self.mode not in (None, OperatingMode.FAULT),
            "the end of FAULT",
            timeout_s,
            even_in_fault=True,
        )

    def tare(self, timeout_s: float = ANSWER_S) -> None:
        """Take the force/torque sensor's present reading as its zero.

        Raises:
            RigError: if the bridge does not answer, or refuses.
        """
        self.ask("tare", timeout_s)

    def record(self, on: bool, timeout_s: float = ANSWER_S) -> str:
        """Begin or complete a bag; return what the recorder says of it.

        Raises:
            RigError: if the recorder does not answer, or refuses.
        """
        return str(self.ask("record", timeout_s, data=on).message)
