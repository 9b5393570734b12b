"""RigClient: what an operator does, from a script or a tool."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Any

import rclpy
from cabols_msgs.msg import LoopStatus, Mode, ResultCode
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from cabols_control.ros import transport
from cabols_control.ros.qos import topic_qos
from cabols_control.ros.reader import Reader
from cabols_control.ros.rig_client.calls import RigCalls
from cabols_control.ros.rig_client.errors import (
    AbandonedError,
    RefusedError,
    RigError,
    RigFaultError,
    RigTimeoutError,
)
from cabols_control.ros.rig_client.running_action import RunningAction
from cabols_control.supervision.modes import MOVING, OperatingMode
from cabols_control.topics import LIVE, NAMESPACE, Quality, topic_row

NODES = ("supervisor", "limb_controller", "wrench_controller")
"""Nodes of the control path, beside a bridge."""
BRIDGES = ("plant", "q8_ati_bridge")
START_S = 180.0
"""Longest wait for nodes to run [s]; a first start compiles for a minute or two."""
STEP_S = 40.0
"""Longest wait for a step of the rig, in its own time [s]."""
ANSWER_S = 10.0
"""Longest wait for an answer [s]."""
ASK_AGAIN_S = 1.0
"""A request without an answer is sent again after so long [s]."""
RETRY_S = 0.1
"""Between a refusal and the next request [s]."""
FRESH_S = 1.0
"""A sample of a topic at the control rate is newest no longer than this [s]."""
FINAL = (ResultCode.BAD_REQUEST, ResultCode.FAULT_LATCHED)
"""Refusals that asking again does not lift."""


class RigClient:
    """One client of a running rig, simulated or not; its methods wait, and every wait has an end.

    As a context manager it is a program of its own:

        with RigClient() as rig:
            rig.wait_running()
            rig.pretighten()
            rig.enter(OperatingMode.LOADING)
            rig.run_program("ramps")
            rig.enter(OperatingMode.STOPPED)

    If the block fails, or is interrupted, while the rig moves, the rig is asked to stop.

    A request is repeated until it is answered, as a server may not be matched yet, or may just have
    been restarted. Methods are for one thread at a time, never the executor's; only `abandon` is
    for another one.
    """

    def __init__(
        self,
        node: Node | None = None,
        *,
        name: str = "rig_client",
        domain: int | None = None,
        speed: float = 1.0,
        poll_s: float = 0.02,
    ) -> None:
        """Join the graph.

        Args:
            node: an existing node in the rig's namespace, which its owner lets spin in another
                thread; None: a node, an executor and a context of its own.
            name: of the client's own node.
            domain: DDS domain of the client's own context; None: ROS_DOMAIN_ID.
            speed: of the rig's time, below 1 in simulated slow motion: waits for the rig stretch.
            poll_s: between two looks at what no callback tells [s].
        """
        self._speed = min(speed, 1.0)
        self._poll_s = poll_s
        self._news = threading.Condition()
        self._abandoned = threading.Event()
        self._mode: Mode | None = None
        self._moved = False
        self._readers: dict[str, tuple[Reader, Any, int]] = {}
        self.reports: dict[str, LoopStatus] = {}
        """Newest report of each node."""
        self._owned = node is None
        self._node = self._own_node(name, domain) if node is None else node
        self.calls = RigCalls(self._node)
        """Services and actions as futures, for what has no method here."""
        subscribe = self._node.create_subscription
        self._subscriptions = [
            subscribe(Mode, "mode", self._hear_mode, topic_qos("mode")),
            subscribe(LoopStatus, "loop_status", self._hear_status, topic_qos("loop_status")),
        ]
        if self._owned:
            self._thread.start()

    def _own_node(self, name: str, domain: int | None) -> Node:
        self._context = rclpy.Context()
        transport.init(context=self._context, domain_id=domain)
        node = rclpy.create_node(name, namespace=NAMESPACE, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._spin, name=name, daemon=True)
        return node

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            while self._context.ok():
                self._executor.spin_once(timeout_sec=0.2)

    def __enter__(self) -> RigClient:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the graph; after an error the rig is asked to stop if this client moved it."""
        try:
            if error is not None and self._moved and self.mode in MOVING:
                with suppress(RigError, AbandonedError):
                    self.ask("set_mode", mode=int(OperatingMode.STOPPED))
        finally:
            self.close()

    def close(self) -> None:
        """Leave the graph."""
        self.calls.close()
        for reader, *_ in self._readers.values():
            self._node.destroy_subscription(reader.subscription)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._readers, self._subscriptions = {}, []
        if self._owned:
            self._context.try_shutdown()
            self._thread.join(timeout=5.0)
            self._node.destroy_node()

    def abandon(self) -> None:
        """Let whoever waits now, or later, get an AbandonedError; for another thread."""
        self._abandoned.set()
        self._tell()

    @property
    def node(self) -> Node:
        """The client's node, for what has no method here."""
        return self._node

    @property
    def mode(self) -> OperatingMode | None:
        """Newest mode; None before the first."""
        message = self._mode
        return None if message is None else OperatingMode(message.mode)

    @property
    def mode_message(self) -> Mode | None:
        """The same with reason, cause and number of its pre-tightening."""
        return self._mode

    def _hear_mode(self, message: Mode) -> None:
        with self._news:
            self._mode = message
            self._news.notify_all()

    def _hear_status(self, message: LoopStatus) -> None:
        with self._news:
            self.reports[message.node] = message
            self._news.notify_all()

    def wait(
        self,
        condition: Callable[[], bool],
        what: str | Callable[[], str],
        timeout_s: float,
        even_in_fault: bool = False,
    ) -> None:
        """Wait for a condition.

        Args:
            condition: looked at with every mode, report and answer, and every `poll_s`.
            what: that is waited for, for the error.
            timeout_s: longest wait [s].
            even_in_fault: do not give up in FAULT.

        Raises:
            RigTimeoutError: when the time is over.
            RigFaultError: if the rig is in FAULT, unless `even_in_fault`.
            AbandonedError: if the client is abandoned, or its context has ended.
        """
        give_up = time.monotonic() + timeout_s
        while not condition():
            if self._abandoned.is_set() or not self._node.context.ok():
                raise AbandonedError
            if not even_in_fault:
                self.check_fault()
            if not time.monotonic() < give_up:
                text = what if isinstance(what, str) else what()
                raise RigTimeoutError(text, timeout_s, self._standing())
            with self._news:
                self._news.wait(self._poll_s)

    def pause(self, seconds: float) -> None:
        """Let time pass on the rig's clock [s]; raises as wait() does."""
        until = time.monotonic() + seconds / self._speed
        self.wait(
            lambda: time.monotonic() >= until, "time to pass", 2.0 * seconds / self._speed + 1
        )

    def check_fault(self) -> None:
        """Raise a RigFaultError if the rig is in FAULT."""
        message = self._mode
        if message is not None and message.mode == Mode.FAULT:
            raise RigFaultError(message)

    def _standing(self) -> str:
        message = self._mode
        if message is None:
            return "no mode has arrived: is the supervisor running, in this DDS domain?"
        return f"the mode is {OperatingMode(message.mode).name}: {message.reason}"

    def wait_running(self, *nodes: str, timeout_s: float = START_S) -> None:
        """Wait until nodes report that they run.

        Args:
            nodes: their names; none: the control path and a bridge.
            timeout_s: longest wait [s].

        Raises:
            RigTimeoutError: naming the nodes that are missing, with what they report.
        """

        def missing() -> list[str]:
            running = {n for n, r in self.reports.items() if r.state == LoopStatus.RUNNING}
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
                with suppress(RigTimeoutError):
                    self.wait(answered, what, min(ASK_AGAIN_S, left()), even_in_fault=True)
            return next(future.result() for future in asked if future.done())
        finally:
            for future in asked:
                if not future.done():
                    self.calls.forget(service, future)

    def watched(self, future: Any) -> Any:
        """Let wait() look at once when a future is done; return the future."""
        future.add_done_callback(lambda _: self._tell())
        return future

    def _tell(self) -> None:
        with self._news:
            self._news.notify_all()

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
        """Ask for a mode until it is granted, then wait until it is there.

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
            RefusedError: if it was refused until the end.
            RigTimeoutError: if there is no server, or no answer.
        """
        give_up = time.monotonic() + accept_s
        while True:
            left = max(give_up - time.monotonic(), RETRY_S)
            absent = f"the action {action}: its node is not running"
            self.wait(lambda: self.calls.ready(action), absent, left)
            sent = self.watched(self.calls.send_goal(action, on_feedback, **fields))
            try:
                self.wait(sent.done, f"an answer of {action}", left)
            except BaseException:
                sent.add_done_callback(self._cancel_late)
                raise
            handle = sent.result()
            if handle.accepted:
                return RunningAction(self, action, handle)
            if time.monotonic() >= give_up:
                raise RefusedError(action, "its node's log says why")
            self.pause(RETRY_S * self._speed)

    def _cancel_late(self, sent: Any) -> None:
        """Cancel a goal that was accepted when nobody waited for it any more."""
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

    def newest(self, topic: str, timeout_s: float = 5.0, live: bool | None = None) -> Any:
        """Return the newest message of a topic; of a sample, one that is at most a second old.

        Args:
            topic: its name in cabols_control.topics.
            timeout_s: longest wait for one [s].
            live: of the topic's slow copy, which costs the control loop nothing; None: where there
                is one.

        Raises:
            RigTimeoutError: if none comes.
        """
        found: list[Any] = []

        def came() -> bool:
            message = self.newest_if_any(topic, live)
            if message is not None:
                found.append(message)
            return bool(found)

        self.wait(came, f"a message of {topic}", timeout_s, even_in_fault=True)
        return found[0]

    def newest_if_any(self, topic: str, live: bool | None = None) -> Any:
        """Return the same without waiting; None if there is none."""
        row = topic_row(topic)
        name = LIVE + topic if (row.live if live is None else live) else topic
        if name not in self._readers:
            self._readers[name] = (Reader(self._node, name), None, 0)
        reader, message, received_ns = self._readers[name]
        for newer, when_ns in reader.take_timed():
            message, received_ns = newer, when_ns
        self._readers[name] = (reader, message, received_ns)
        if message is None or row.quality != Quality.CONTROL:
            return message
        return message if time.time_ns() - received_ns <= 1e9 * FRESH_S / self._speed else None

    def emergency_stop(self, timeout_s: float = ANSWER_S) -> None:
        """Cut all currents and latch FAULT.

        Raises:
            RigError: if the supervisor does not answer, or refuses.
        """
        self.ask("emergency_stop", timeout_s)

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
