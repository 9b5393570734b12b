"""The operator of the demo: leads the running graph through one session, step by step."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import rclpy
from cabols_msgs.action import MeasureReflector, MoveToConfiguration, RunProgram
from cabols_msgs.msg import LoopStatus, Mode
from cabols_msgs.srv import SetMode
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor

from cabols_control.errors import CabolsError
from cabols_control.naming import configuration_name, reflector_name
from cabols_control.rig import load_rig
from cabols_control.ros import topics, transport
from cabols_control.ros.loop import Input
from cabols_control.ros.qos import topic_qos
from cabols_control.supervision.modes import OperatingMode
from cabols_control.topics import NAMESPACE

NEEDED = ("supervisor", "plant", "limb_controller", "wrench_controller", "abb_tracker_bridge")
"""Nodes that must report RUNNING before anything moves."""
START_S = 180.0
"""The nodes must run within this; a first start compiles for a minute or two."""
CALM_S = 2.0
"""Between the nodes' start and the first motion: compiling and discovery stall a small machine."""
STEP_S = 40.0
"""Any other step may take so long, at speed 1."""
ANSWER_S = 5.0
RETRY_S = 0.3
SETTLE_S = 0.7
"""Between a change of mode and what needs it: every node hears of it at its own time."""
END_S = 1.0
ENDING_S = 6.0
"""The graph may take so long to end."""
POLL_S = 0.1
"""Every look at what has arrived takes time from the rig's loops on a small machine."""


class DemoSessionError(CabolsError):
    """A step did not come to its end."""


class _InterruptedError(Exception):
    """The graph is ending; the session ends with it."""


@dataclass(frozen=True)
class DemoPlan:
    """What the operator does.

    Attributes:
        program: load programme's name or path.
        duration_s: of the programme [s].
        speed: of the rig's clock; programmes keep the wall's time.
        rig: name or folder, see find_rig.
        configurations: of the robot, in this order; it starts in 0.
        reflector: that the tracker measures, from 0.
    """

    program: str
    duration_s: float
    speed: float = 1.0
    rig: str = ""
    configurations: tuple[int, ...] = (1, 0)
    reflector: int = 0


class DemoSession:
    """Runs in a thread beside the graph, as a node `operator` in a context of its own.

    Attributes:
        done: whether every step came to its end.
        error: why not; None if nothing went wrong, also after an interruption.
    """

    def __init__(
        self,
        plan: DemoPlan,
        domain: int,
        say: Callable[[str], None],
        load: Callable[[bool], None] = lambda _: None,
    ) -> None:
        """Plan; nothing runs yet.

        Args:
            plan: what the operator does.
            domain: DDS domain of the graph.
            say: called with one line for each step.
            load: called with True as a programme begins and with False as it has ended.
        """
        self._load = load
        self._plan = plan
        self._say = say
        self._domain = domain
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="demo_session", daemon=True)
        self._mode: OperatingMode | None = None
        self._reason = ""
        self._zeroing = 0
        self._running: set[str] = set()
        self.done = False
        self.error: Exception | None = None

    def start(self, pids: dict[str, int]) -> None:
        """Begin; for run_bench's on_start. The graph is ended by SIGTERM to this process."""
        del pids
        self._thread.start()

    def stop(self) -> None:
        """End, wherever it is; call when the graph has ended."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(ANSWER_S)

    def _run(self) -> None:
        try:
            self._open()
            self._play()
            self.done = True
        except _InterruptedError:
            pass
        except Exception as error:
            # Ctrl-C ends the plant first, of which the others complain: then it is no error.
            if not self._stop.wait(ENDING_S):
                self.error = error
        finally:
            self._close()
            if not self._stop.is_set():
                os.kill(os.getpid(), signal.SIGTERM)

    def _open(self) -> None:
        self._context = rclpy.Context()
        transport.init(context=self._context, domain_id=self._domain)
        node = rclpy.create_node("operator", namespace=NAMESPACE, context=self._context)
        self._node = node
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(node)
        node.create_subscription(Mode, "mode", self._hear_mode, topic_qos("mode"))
        self._layout = topics.limb_state_layout(load_rig(self._plan.rig).geometry)
        self._set_mode = node.create_client(SetMode, "set_mode")
        self._actions = {
            kind: ActionClient(node, kind, name)
            for kind, name in (
                (MoveToConfiguration, "move_to_configuration"),
                (MeasureReflector, "measure_reflector"),
                (RunProgram, "run_program"),
            )
        }

    def _close(self) -> None:
        with suppress(Exception):
            for client in self._actions.values():
                client.destroy()
            self._node.destroy_node()
        with suppress(Exception):
            self._context.try_shutdown()

    def _play(self) -> None:
        """All steps; see section 4.2.2 for what the modes are for."""
        self._await_nodes()
        self._pause(CALM_S)
        self._say("free-moving by the switches: no limb knows its zero yet")
        self._enter(OperatingMode.FREE_MOVING)
        self._pause(CALM_S)
        self._pretighten("pre-tightening: each limb winds in until its switch closes")
        self._say("free-moving with zeros: the cables follow at low tension")
        self._enter(OperatingMode.FREE_MOVING)
        self._pause(SETTLE_S)
        for index in self._plan.configurations:
            place = configuration_name(index)
            self._say(f"robot to {place}")
            result = self._act(MoveToConfiguration, MoveToConfiguration.Goal(index=index))
            self._expect(result.success, f"move to {place}: {result.message}")
        self._measure()
        self._pretighten("pre-tightening again, where the load will be")
        self._say(f"loading: {self._plan.program}, {self._plan.duration_s:g} s")
        self._enter(OperatingMode.LOADING)
        self._pause(SETTLE_S)
        goal = RunProgram.Goal(program=self._plan.program, scale=1.0)
        self._load(True)
        result = self._act(RunProgram, goal, self._plan.duration_s)
        self._load(False)
        self._expect(result.success, f"programme {self._plan.program}: {result.message}")
        self._say("unloading")
        self._enter(OperatingMode.STOPPED)
        self._pause(END_S)

    def _await_nodes(self) -> None:
        """Wait until every node that is needed reports that it runs."""
        reports = self._node.create_subscription(
            LoopStatus, "loop_status", self._hear_status, topic_qos("loop_status")
        )
        self._wait(lambda: self._running >= set(NEEDED), self._missing, START_S)
        self._node.destroy_subscription(reports)

    def _measure(self) -> None:
        name = reflector_name(self._plan.reflector)
        self._say(f"laser tracker measures {name}")
        goal = MeasureReflector.Goal(reflector=self._plan.reflector, search=True)
        result = self._act(MeasureReflector, goal)
        self._expect(result.success, f"measurement of {name}: {result.message}")
        found = result.measurement
        p = found.position
        self._say(
            f"{name} at ({p.x:.4f}, {p.y:.4f}, {p.z:.4f}) m in the tracker's frame, "
            f"scatter {1e6 * found.rms:.0f} um"
        )

    def _pretighten(self, text: str) -> None:
        self._say(text)
        self._enter(OperatingMode.PRETIGHTENING)
        # Only now, and without a callback: the samples come at 1 kHz, and the cores are few.
        state = Input(self._node, "limb_state", self._layout)

        def zeroed() -> bool:
            state.take()
            record = state.record
            if record is None or int(record["zeroing"]) != self._zeroing:
                return False
            return bool(record["zeroed"].all())

        try:
            self._wait(zeroed, lambda: "the zeros of all limbs", STEP_S)
        finally:
            self._node.destroy_subscription(state.subscription)

    def _enter(self, mode: OperatingMode) -> None:
        """Ask for a mode until it is granted, then wait until it is there."""
        refusal = "not asked yet"

        def granted() -> bool:
            nonlocal refusal
            request = self._set_mode.call_async(SetMode.Request(mode=int(mode)))
            until = time.monotonic() + ANSWER_S
            while not request.done() and time.monotonic() < until:
                self._spin(POLL_S)
            if not request.done():
                self._set_mode.remove_pending_request(request)
                refusal = "the supervisor does not answer"
                return False
            answer = request.result()
            if answer is not None and answer.success:
                return True
            refusal = "no answer" if answer is None else answer.message
            self._pause(RETRY_S)
            return False

        self._wait(granted, lambda: f"{mode.name} to be granted ({refusal})", STEP_S)
        self._wait(lambda: self._mode == mode, lambda: f"the mode to be {mode.name}", STEP_S)

    def _act(self, kind: Any, goal: Any, longer_s: float = 0.0) -> Any:
        """Run an action to its result."""
        client, name = self._actions[kind], kind.__name__
        self._wait(client.server_is_ready, lambda: f"the action {name}", STEP_S)
        sent = client.send_goal_async(goal)
        self._wait(sent.done, lambda: f"an answer of {name}", STEP_S)
        handle = sent.result()
        self._expect(handle.accepted, f"{name} was refused; its node's log says why")
        result = handle.get_result_async()
        # A programme keeps the wall's time, so `longer_s` does not stretch with slow motion.
        self._wait(result.done, lambda: f"the end of {name}", STEP_S + longer_s)
        return result.result().result

    def _expect(self, condition: bool, failure: str) -> None:
        if not condition:
            self._look_for_fault()
            raise DemoSessionError(failure)

    def _wait(self, condition: Callable[[], bool], what: Callable[[], str], seconds: float) -> None:
        """Wait for a condition.

        Raises:
            DemoSessionError: after so many seconds (at speed 1), or in FAULT.
        """
        seconds /= min(self._plan.speed, 1.0)
        give_up = time.monotonic() + seconds
        while not condition():
            self._look_for_fault()
            if not time.monotonic() < give_up:
                raise DemoSessionError(f"waited {seconds:.0f} s in vain for {what()}")
            self._spin(POLL_S)

    def _look_for_fault(self) -> None:
        if self._mode == OperatingMode.FAULT:
            raise DemoSessionError(f"the rig is in FAULT: {self._reason}")

    def _pause(self, seconds: float) -> None:
        until = time.monotonic() + seconds / min(self._plan.speed, 1.0)
        while (left := until - time.monotonic()) > 0.0:
            self._spin(min(left, POLL_S))
            self._look_for_fault()

    def _spin(self, seconds: float) -> None:
        """Serve one callback, or let so much time pass."""
        if self._stop.is_set() or not self._context.ok():
            raise _InterruptedError
        self._executor.spin_once(timeout_sec=seconds)

    def _missing(self) -> str:
        return f"reports of {', '.join(n for n in NEEDED if n not in self._running)}"

    def _hear_mode(self, message: Mode) -> None:
        self._zeroing = int(message.zeroing)
        self._mode, self._reason = OperatingMode(message.mode), message.reason

    def _hear_status(self, message: LoopStatus) -> None:
        if message.state == LoopStatus.RUNNING:
            self._running.add(message.node)
