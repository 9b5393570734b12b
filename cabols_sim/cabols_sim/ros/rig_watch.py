"""A rig seen from outside: its topics kept, its services and actions called."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import rclpy
from cabols_msgs.action import MeasureReflector, RunProgram
from cabols_msgs.msg import LoopStatus, Mode
from cabols_msgs.srv import InjectFault, SetMode
from geometry_msgs.msg import WrenchStamped
from rclpy.action import ActionClient
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from std_srvs.srv import Trigger

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_control.rig import load_rig
from cabols_control.ros import topics, transport
from cabols_control.ros.executor_thread import hand_over
from cabols_control.ros.loop import Input, make_wait_set, wait
from cabols_control.ros.qos import topic_qos
from cabols_control.stamps import time_ns
from cabols_control.supervision.faults import FaultName, fault_name
from cabols_control.supervision.modes import OperatingMode
from cabols_control.topics import NAMESPACE
from cabols_sim.fault_campaign.judgement import Report, TrialData

IN_PATH = ("plant", "limb_controller", "wrench_controller")
BEFORE_S = 0.005
DEPTH = 5000
"""The watcher must see every sample, also when it is late itself."""


ASK_AGAIN_S = 2.0


class RigError(CabolsError):
    """The rig did not do what was asked, in time."""


class AbandonedError(Exception):
    """The watch was abandoned: whatever is under way ends, and is not tried again."""


class RigWatch:
    """Watches a simulated rig that publishes its truth.

    Attributes:
        mode: newest mode; None before the first.
        mode_reason: why it was entered.
    """

    def __init__(self, domain: int, speed: float = 1.0, rig: str = "") -> None:
        """Join a DDS domain; the rig's time passes at `speed` of this computer's."""
        self._speed = speed
        self._arrived = 0.0
        self._context = rclpy.Context()
        transport.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("rig_watch", namespace=NAMESPACE, context=self._context)
        self._lock = threading.Lock()
        self._abandoned = threading.Event()
        self._states: list[tuple[float, FloatArray, FloatArray]] = []
        self._wrenches: list[tuple[float, FloatArray]] = []
        self._reports: list[Report] = []
        self._zeroed = False
        self._heard: dict[str, tuple[bool, FaultName | None]] = {}
        self.mode: OperatingMode | None = None
        self.mode_reason = ""
        geometry = load_rig(rig).geometry
        layout = topics.limb_state_layout(geometry)
        self._state_input = Input(self._node, "true_limb_state", layout, depth=DEPTH)
        layout = topics.wrench_layout(geometry.base_frame)
        self._wrench_input = Input(self._node, "true_wrench", layout, depth=DEPTH)
        subscribe = self._node.create_subscription
        subscribe(LoopStatus, "loop_status", self._hear_status, topic_qos("loop_status"))
        subscribe(Mode, "mode", self._hear_mode, topic_qos("mode"))
        self._desired = self._node.create_publisher(
            WrenchStamped, "desired_wrench", topic_qos("desired_wrench")
        )
        self._set_mode = self._node.create_client(SetMode, "set_mode")
        self._reset = self._node.create_client(Trigger, "reset")
        self._inject = self._node.create_client(InjectFault, "inject_fault")
        self._program = ActionClient(self._node, RunProgram, "run_program")
        self._measure = ActionClient(self._node, MeasureReflector, "measure_reflector")
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        # The truth comes at the control rate: taken raw, in a thread of its own.
        self._threads = [
            threading.Thread(target=target, daemon=True) for target in (self._spin, self._take)
        ]
        for thread in self._threads:
            thread.start()

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            while self._context.ok():
                self._executor.spin_once(timeout_sec=0.2)

    def abandon(self) -> None:
        """Let whoever waits now, or later, get an AbandonedError; for another thread."""
        self._abandoned.set()

    def close(self) -> None:
        """Leave."""
        self._context.try_shutdown()
        for thread in self._threads:
            thread.join(timeout=5.0)
        self._node.destroy_node()

    def _take(self) -> None:
        inputs = (self._state_input, self._wrench_input)
        wait_set = make_wait_set(self._node, len(inputs))
        while self._context.ok():
            wait(wait_set, inputs, 100_000_000)
            while self._state_input.take_one():
                record = self._state_input.record
                row = (np.array(record["tension"]), np.array(record["current"]))
                with self._lock:
                    self._arrived = time.monotonic()
                    self._states.append((1e-9 * self._state_input.stamp_ns, *row))
            while self._wrench_input.take_one():
                wrench = np.array(self._wrench_input.record["wrench"])
                with self._lock:
                    self._wrenches.append((1e-9 * self._wrench_input.stamp_ns, wrench))

    def _hear_status(self, message: LoopStatus) -> None:
        fault = message.state == LoopStatus.FAULT
        name = fault_name(message.fault, fault)
        now = (fault, name)
        new = now != self._heard.get(message.node)
        self._heard[message.node] = now
        if new and name is not None:
            # Nodes beside the path of samples stamp by clocks of their own.
            stamp_s = (
                1e-9 * time_ns(message.header.stamp) if message.node in IN_PATH else self.now_s
            )
            self.complain(Report(stamp_s, message.node, message.reason, fault, name))

    def _hear_mode(self, message: Mode) -> None:
        before, self.mode = self.mode, OperatingMode(message.mode)
        self.mode_reason = message.reason
        unasked = before == OperatingMode.LOADING and self.mode == OperatingMode.STOPPED
        if before != self.mode and (self.mode == OperatingMode.FAULT or unasked):
            # STOPPED out of LOADING: a supervisor that has begun anew, and stops the rig.
            name = fault_name(message.fault, True)
            self.complain(Report(self.now_s, "supervisor", message.reason, True, name))

    def forget(self) -> None:
        """Forget what was seen so far, but the newest."""
        with self._lock:
            self._states, self._wrenches = self._states[-1:], self._wrenches[-1:]
            self._reports = []

    @property
    def now_s(self) -> float:
        """The rig's time: newest stamp, and what has passed since [s]; 0 before the first."""
        with self._lock:
            if not self._states:
                return 0.0
            return self._states[-1][0] + self._speed * (time.monotonic() - self._arrived)

    @property
    def newest_s(self) -> float:
        """Stamp of the newest state [s]; 0 before the first."""
        with self._lock:
            return self._states[-1][0] if self._states else 0.0

    @property
    def tension(self) -> FloatArray:
        """(n,) newest true tensions [N]."""
        with self._lock:
            return self._states[-1][1] if self._states else np.zeros(0)

    @property
    def wrench(self) -> FloatArray:
        """(6,) newest true wrench [N, N m]."""
        with self._lock:
            return self._wrenches[-1][1] if self._wrenches else np.full(6, np.nan)

    @property
    def reports(self) -> list[Report]:
        """What nodes complained of."""
        with self._lock:
            return list(self._reports)

    def trial(self, fault_s: float) -> TrialData:
        """Return what was seen from an instant on, and the sample just before it."""
        with self._lock:
            states = [row for row in self._states if row[0] >= fault_s - BEFORE_S]
            wrenches = [row[1] for row in self._wrenches if row[0] >= fault_s]
            reports = tuple(self._reports)
            n = self._states[-1][1].size if self._states else 0
        count = len(states)
        return TrialData(
            fault_s,
            np.array([row[0] for row in states]),
            np.array([row[1] for row in states]).reshape(count, n),
            np.array([row[2] for row in states]).reshape(count, n),
            np.array(wrenches).reshape(len(wrenches), 6),
            reports,
        )

    def wait_unharmed(self, condition: Callable[[], bool], what: str, seconds: float) -> None:
        """Wait for a condition, but not in FAULT."""
        self.wait(lambda: condition() or self.mode == OperatingMode.FAULT, what, seconds)
        if self.mode == OperatingMode.FAULT:
            raise RigError(f"FAULT while waiting for {what}: {self.mode_reason}")

    def wait(self, condition: Callable[[], bool], what: str, seconds: float) -> None:
        """Wait for a condition.

        Raises:
            RigError: after `seconds`, naming what was waited for and the rig's mode.
            AbandonedError: if the watch is abandoned.
        """
        give_up = time.monotonic() + seconds
        while not condition():
            if self._abandoned.is_set():
                raise AbandonedError
            if time.monotonic() > give_up:
                mode = self.mode.name if self.mode is not None else "unknown"
                raise RigError(
                    f"waited {seconds:g} s in vain for {what}; mode {mode}: {self.mode_reason}"
                )
            time.sleep(0.002)

    def call(self, client: Any, request: Any, seconds: float = 10.0) -> Any:
        """Call a service; RigError if it is not there or does not answer.

        It is asked again after a while: a server that was killed is known for some time, and one
        that has just begun may not know where to answer.
        """
        if not client.wait_for_service(timeout_sec=seconds):
            raise RigError(f"no service {client.srv_name} within {seconds:g} s")
        futures: list[Any] = []
        give_up = time.monotonic() + seconds
        while time.monotonic() < give_up:
            futures.append(client.call_async(request))
            with suppress(RigError):
                self.wait(lambda: any(f.done() for f in futures), "an answer", ASK_AGAIN_S)
                return next(f.result() for f in futures if f.done())
        raise RigError(f"no answer of {client.srv_name} within {seconds:g} s")

    def _ask(self, send: Callable[[], Any], what: str, seconds: float) -> Any:
        """Send an action's request; return the answer."""
        task = hand_over(self._node, send)
        self.wait(lambda: task.done() and task.result().done(), what, seconds)
        return task.result().result()

    def inject(self, fault: str, limb: int = -1, value: float = 0.0) -> float:
        """Inject a fault; return the plant's time of it [s]."""
        request = InjectFault.Request(fault=fault, limb=limb, value=value)
        answer = self.call(self._inject, request)
        if not answer.success:
            raise RigError(answer.message)
        return float(answer.time)

    def bring_to(self, mode: OperatingMode) -> None:
        """Go to a mode from wherever the rig is, resetting a FAULT, tightening before LOADING."""
        said = ""
        seconds = 10.0 + 20.0 / self._speed

        def there() -> bool:
            nonlocal said
            present = self.mode
            if present == mode:
                return True
            if present == OperatingMode.FAULT:
                self.call(self._reset, Trigger.Request())
            elif present != OperatingMode.UNLOADING:
                loose = mode == OperatingMode.LOADING and present != OperatingMode.PRETIGHTENING
                step = OperatingMode.PRETIGHTENING if loose else mode
                said = self.call(self._set_mode, SetMode.Request(mode=int(step))).message
            time.sleep(0.05)
            return False

        try:
            self.wait(there, f"{mode.name}", seconds)
        except RigError as error:
            raise RigError(f"{error}; last answer: {said}") from error

    def run_program(self, path: str, seconds: float = 5.0) -> Any:
        """Start a load programme; return the goal's handle."""
        if not self._program.wait_for_server(timeout_sec=seconds):
            raise RigError(f"no action run_program within {seconds:g} s")
        goal = RunProgram.Goal(program=path)
        handle = self._ask(
            lambda: self._program.send_goal_async(goal), "run_program's acceptance", seconds
        )
        if not handle.accepted:
            raise RigError(f"run_program refused {path}")
        return handle

    def cancel(self, handle: Any, seconds: float = 10.0) -> None:
        """Cancel a goal."""
        self._ask(handle.cancel_goal_async, "the cancellation", seconds)

    def demand(self, wrench: FloatArray) -> None:
        """Publish one desired wrench (6,), base axes."""
        message = WrenchStamped()
        message.header.frame_id = "rig_base"
        force, torque = message.wrench.force, message.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = map(float, wrench)
        self._desired.publish(message)

    def leave_for(self, mode: OperatingMode) -> None:
        """Ask once for a mode; RigError if it is refused."""
        answer = self.call(self._set_mode, SetMode.Request(mode=int(mode)))
        if not answer.success:
            raise RigError(answer.message)

    def measure(self, seconds: float = 60.0) -> str:
        """Measure reflector 0; return why it failed, empty if it did not."""
        if not self._measure.wait_for_server(timeout_sec=seconds):
            raise RigError(f"no action measure_reflector within {seconds:g} s")
        goal = MeasureReflector.Goal(reflector=0, search=True)
        handle = self._ask(
            lambda: self._measure.send_goal_async(goal), "measure_reflector's acceptance", seconds
        )
        answer = self._ask(handle.get_result_async, "the measurement", seconds).result
        return "" if answer.success else str(answer.message)

    def complain(self, report: Report) -> None:
        """Note what was learned in another way than by loop_status."""
        with self._lock:
            self._reports.append(report)
