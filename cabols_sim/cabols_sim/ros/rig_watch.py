# SPDX-License-Identifier: Apache-2.0
"""A simulated rig seen from outside: its truth kept, faults injected."""

from __future__ import annotations

import threading
import time

import numpy as np
from cabols_msgs.msg import LoopStatus, Mode
from geometry_msgs.msg import WrenchStamped

from cabols_control.checks import FloatArray
from cabols_control.rig import load_rig
from cabols_control.ros.loop import Input, make_wait_set, wait
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.rig_client import ActionFailedError, RigClient
from cabols_control.stamps import time_ns
from cabols_control.supervision.faults import FaultName, fault_name
from cabols_control.supervision.modes import OperatingMode
from cabols_sim.fault_campaign.judgement import Report, TrialData

IN_PATH = ("plant", "limb_controller", "wrench_controller")
BEFORE_S = 0.005
DEPTH = 5000
"""The watcher must see every sample, also when it is late itself."""
ASK_S = 0.05
"""Between two requests of a mode [s]."""


class RigWatch(RigClient):
    """Watches a simulated rig that publishes its truth."""

    def __init__(self, domain: int, speed: float = 1.0, rig: str = "") -> None:
        """Join a DDS domain.

        Args:
            domain: of the rig.
            speed: of its time in this computer's.
            rig: its name or folder, see find_rig.
        """
        super().__init__(name="rig_watch", domain=domain, speed=speed, poll_s=0.002)
        self._arrived = 0.0
        self._lock = threading.Lock()
        self._states: list[tuple[float, FloatArray, FloatArray]] = []
        self._wrenches: list[tuple[float, FloatArray]] = []
        self._complaints: list[Report] = []
        self._heard: dict[str, tuple[bool, FaultName | None]] = {}
        geometry = load_rig(rig).geometry
        layout = topics.limb_state_layout(geometry)
        self._state_input = Input(self.node, "true_limb_state", layout, depth=DEPTH)
        layout = topics.wrench_layout(geometry.base_frame)
        self._wrench_input = Input(self.node, "true_wrench", layout, depth=DEPTH)
        self._before: OperatingMode | None = None
        subscribe = self.node.create_subscription
        subscribe(LoopStatus, "loop_status", self._hear_complaint, topic_qos("loop_status"))
        subscribe(Mode, "mode", self._hear_change, topic_qos("mode"))
        self._desired = self.node.create_publisher(
            WrenchStamped, "desired_wrench", topic_qos("desired_wrench")
        )
        # The truth comes at the control rate: taken raw, in a thread of its own.
        self._taker = threading.Thread(target=self._take, daemon=True)
        self._taker.start()

    def close(self) -> None:
        """Leave."""
        self.node.context.try_shutdown()
        self._taker.join(timeout=5.0)
        super().close()

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

    def _hear_complaint(self, message: LoopStatus) -> None:
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

    def _hear_change(self, message: Mode) -> None:
        before, self._before = self._before, OperatingMode(message.mode)
        unasked = before == OperatingMode.LOADING and self._before == OperatingMode.STOPPED
        if before != self._before and (self._before == OperatingMode.FAULT or unasked):
            # STOPPED out of LOADING: a supervisor was restarted and stops the rig.
            name = fault_name(message.fault, True)
            self.complain(Report(self.now_s, "supervisor", message.reason, True, name))

    def forget(self) -> None:
        """Drop all data but the newest."""
        with self._lock:
            self._states, self._wrenches = self._states[-1:], self._wrenches[-1:]
            self._complaints = []

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
    def complaints(self) -> list[Report]:
        """What nodes complained of."""
        with self._lock:
            return list(self._complaints)

    def trial(self, fault_s: float) -> TrialData:
        """Return what was seen from an instant on, and the sample just before it."""
        with self._lock:
            states = [row for row in self._states if row[0] >= fault_s - BEFORE_S]
            wrenches = [row[1] for row in self._wrenches if row[0] >= fault_s]
            reports = tuple(self._complaints)
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

    def inject(self, fault: str, limb: int = -1, value: float = 0.0) -> float:
        """Inject a fault; return the plant's time of it [s].

        Args:
            fault: a name of cabols_sim.faults.
            limb: index from 0, where the fault has one.
            value: of the fault, in its unit; 0: its default.

        Raises:
            RigError: if the plant refuses, or does not answer.
        """
        return float(self.ask("inject_fault", fault=fault, limb=limb, value=value).time)

    def bring_to(self, mode: OperatingMode, timeout_s: float | None = None) -> None:
        """Go to a mode, through as many FAULTs as come: the faults are this campaign's own.

        Args:
            mode: that is wanted.
            timeout_s: longest wait [s]; None: 10 s and 20 s of the rig's time.

        Raises:
            RigTimeoutError: with the last answer.
        """
        said = ""

        def there() -> bool:
            nonlocal said
            present = self.mode
            if present == mode:
                return True
            if present == OperatingMode.FAULT:
                self.call("reset")
            elif present != OperatingMode.UNLOADING:
                loose = mode == OperatingMode.LOADING and present != OperatingMode.PRETIGHTENING
                step = OperatingMode.PRETIGHTENING if loose else mode
                said = self.call("set_mode", mode=int(step)).message
            time.sleep(ASK_S)
            return False

        seconds = 10.0 + 20.0 / self._speed if timeout_s is None else timeout_s
        self.wait(there, lambda: f"{mode.name}; last answer: {said}", seconds, even_in_fault=True)

    def demand(self, wrench: FloatArray) -> None:
        """Publish one desired wrench (6,), base axes."""
        message = WrenchStamped()
        message.header.frame_id = "rig_base"
        force, torque = message.wrench.force, message.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = map(float, wrench)
        self._desired.publish(message)

    def measure(self, timeout_s: float = 60.0) -> str:
        """Measure the first reflector; return why it failed, empty if it did not.

        Args:
            timeout_s: longest wait [s].

        Raises:
            RigError: if the bridge does not answer.
        """
        action = self.start("measure_reflector", accept_s=timeout_s, reflector=0, search=True)
        try:
            action.result(timeout_s, even_in_fault=True)
        except ActionFailedError as error:
            return str(error.result.message)
        return ""

    def complain(self, report: Report) -> None:
        """Note what was learned in another way than by loop_status."""
        with self._lock:
            self._complaints.append(report)
