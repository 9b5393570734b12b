# SPDX-License-Identifier: Apache-2.0
"""Node: owns the mode; services set_mode, emergency_stop and reset."""

from __future__ import annotations

import sys
import threading
import time
from typing import Any

from cabols_msgs.msg import LoopStatus, OperatorHeartbeat
from cabols_msgs.srv import SetMode
from std_srvs.srv import Trigger

from cabols_control.bringup_nodes import NODES as CONTROL_NODES
from cabols_control.naming import told
from cabols_control.ros.lifetime.roles import SINGLE, Seconds, publishers
from cabols_control.ros.live import live_name
from cabols_control.ros.loop import ControlLoop, Input
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.layout import Layout
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import FAULT, RUNNING, ControlNode, run_node
from cabols_control.ros.parameters import declare, declare_row
from cabols_control.ros.stops import PRESSED, StopReceiver
from cabols_control.ros.threads.ticker import Ticker
from cabols_control.supervision.faults import Fault, FaultName, fault_name
from cabols_control.supervision.modes import MOVING, Entry, OperatingMode
from cabols_control.supervision.operator_watchdog import OperatorWatchdog
from cabols_control.supervision.senders import SenderFollower
from cabols_control.supervision.session import LOCKSTEP_SESSION
from cabols_control.supervision.starvation import StarvationWatch
from cabols_control.supervision.supervision_config import SupervisionConfig
from cabols_control.supervision.supervisor import Supervision

PERIOD_S = 0.02
NAME_SIZE = 100
"""Of a node's name this much counts [characters]."""
NEWS_S = 0.06
"""Longest silence of the slow limb states, which come every 45 ms [s]."""
SECONDS_PERIOD_S = 1.0
"""Between looks for second publishers [s]."""
REPEAT_EVERY = 5
"""The mode is repeated at 10 Hz, so that its readers notice a silent supervisor."""


class SupervisorNode(ControlNode):
    """Thin node around Supervision: reads the limb states 50 times a second."""

    role_topic = "mode"

    def __init__(self) -> None:
        """Advertise mode and the services."""
        super().__init__("supervisor")
        needed = SupervisionConfig.controllers
        if declare(self, "robot", False, "a robot carries the platform: its bridge must run, too"):
            needed = (*needed, "abb_tracker_bridge")
        config = SupervisionConfig(
            auto_start=declare_row(self, CONTROL_NODES.argument("auto_start")),
            pretension_timeout_s=declare(
                self, "pretension_timeout", 15.0, "s, longest pre-tightening", (0.1, 600.0)
            ),
            state_timeout_s=declare_row(self, CONTROL_NODES.argument("state_timeout")),
            unloaded_tension=1.7 * self.rig.limbs.switch_tension,
            # In lockstep the clock itself waits for the controllers.
            controllers=() if self.paced else needed,
            bridges=() if self.paced else SupervisionConfig.bridges,
            hangs=self.rig.hanging is not None,
        )
        self._core = Supervision(config)
        self._operator_watchdog = OperatorWatchdog(
            declare_row(self, CONTROL_NODES.argument("operator_timeout"))
        )
        self._lock = threading.Lock()
        self._state = self._input("limb_state", topics.limb_state_layout(self.rig.geometry))
        self._pose = self._input("platform_pose", topics.pose_layout(self.rig.geometry))
        self._output = self.advertise("mode")
        # Later supervisors have larger numbers, as long as the computer's clock is not set back.
        self._session = LOCKSTEP_SESSION if self.lockstep else time.time_ns()
        self._published: Entry | None = None
        self._ticks = 0
        self._starvation = StarvationWatch(NEWS_S)
        self._seconds = Seconds()
        self._senders = SenderFollower(config.report_timeout_s)
        self._notice: Fault | None = None
        self.create_timer(SECONDS_PERIOD_S, self._look_for_seconds)
        self.create_subscription(
            LoopStatus, "loop_status", self._hear_status, topic_qos("loop_status")
        )
        beat = "operator_heartbeat"
        self.create_subscription(OperatorHeartbeat, beat, self._hear_operator, topic_qos(beat))
        self._stops = StopReceiver(self, self._hear_stop)
        self.create_service(SetMode, "set_mode", self._set_mode)
        self.create_service(Trigger, "emergency_stop", self._emergency_stop)
        self.create_service(Trigger, "reset", self._reset)
        self._loop: ControlLoop | Ticker
        if self.paced:
            self._loop = ControlLoop(self, self._state, [], self._answer, True)
            self._loop.prepare = self.prepare_thread
        else:
            self._loop = Ticker(self.context, PERIOD_S, self._tick)

    def _input(self, topic: str, layout: Layout) -> Input:
        """Subscribe to a topic's slow copy: a reader of every sample costs its writer's loop."""
        return Input(self, topic if self.paced else live_name(topic), layout, self.lockstep)

    def begin(self) -> None:
        """Start the loop."""
        self._loop.start()
        super().begin()

    def end(self) -> None:
        """Stop the loop; without a supervisor the limb controller stops a load."""
        self._loop.stop()

    def end_asked(self) -> None:
        """Unload, then stop."""
        with self._lock:
            self._core.hear_notice(self.get_name(), Fault(FaultName.ENDING, "asked to end"))
            self._publish_change()

    def may_end(self) -> bool:
        """Not while anything moves, unless no bridge is there."""
        with self._lock:
            silent = self.paced or not self._core.fresh(self._now_s())
            return silent or self._core.mode not in MOVING

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended the loop."""
        return self._loop.failure

    def _answer(self) -> None:
        with self._lock:
            self._hear_state()
            self._publish()

    def _tick(self) -> None:
        with self._lock:
            self._ticks += 1
            self._hear_news()
            if self._starvation.turn(time.monotonic()):
                self._core.check_silence(self._now_s())
            left = self._operator_watchdog.overdue(time.monotonic(), self._core.mode not in MOVING)
            if left:
                self._core.abandon(left)
            if self._ticks % REPEAT_EVERY == 0 or self._changed():
                self._publish()

    def _hear_news(self) -> None:
        if self._state.take():
            self._hear_state()

    def _hear_state(self) -> None:
        stamp_s = 1e-9 * self._state.stamp_ns
        if self._pose.take():
            self._core.hear_pose(1e-9 * self._pose.stamp_ns, self._pose.record["pose"][:3])
        record = self._state.record
        self._core.hear_state(
            stamp_s,
            record["zeroed"],
            record["tension"],
            zeroing=int(record["zeroing"]),
            followed=int(record["mode"]),
        )

    def _changed(self) -> bool:
        return self._core.entry != self._published

    def _now_s(self) -> float:
        """Present time on the clock of the limb states' stamps."""
        if self._state.count == 0:
            return 0.0
        since = 0 if self.paced else time.monotonic_ns() - self._state.received_ns
        return 1e-9 * (self._state.stamp_ns + since)

    def _publish(self) -> None:
        entry = self._core.entry
        if self._changed():
            self.status.log.info(f"mode {entry.mode.name}: {entry.reason}")
        self._published = entry
        record = topics.mode_layout(entry.reason, entry.fault or "").record()
        record.stamp(int(1e9 * self._now_s()) if not self.paced else self._state.stamp_ns)
        record["mode"][0] = int(entry.mode)
        record["cause"][0] = int(entry.cause)
        record["zeroing"][0] = entry.zeroing
        record["session"][0] = self._session
        record["lifted"][:] = self._core.stops.lifted
        self._output.publish(record.raw())
        if entry.mode == OperatingMode.FAULT:
            fault = Fault(entry.fault or FaultName.OTHER, entry.reason)
            self.status.cycle(self._state.stamp_ns, FAULT, fault)
        else:
            self.status.cycle(self._state.stamp_ns, RUNNING, self._notice)

    def _look_for_seconds(self) -> None:
        """Name nodes that publish what another one does."""
        found = [one for topic in SINGLE for one in publishers(self, topic)]
        names = self._seconds.look(found, time.monotonic())
        with self._lock:
            self._notice = Fault(FaultName.SECOND_PUBLISHER, names) if names else None

    def _hear_status(self, message: LoopStatus) -> None:
        node = told(message.node, NAME_SIZE)
        if node == self.get_name():
            return
        in_fault = message.state == LoopStatus.FAULT
        name = fault_name(message.fault, in_fault)
        said = Fault(name, told(message.reason)) if name is not None else None
        fault = said if in_fault else None
        stamp_s = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        with self._lock:
            now_s = self._now_s()
            if not self._senders.admit(node, message.instance, now_s):
                self.status.counted["strange_reports"] = self._senders.dropped
                return
            running = message.state == LoopStatus.RUNNING
            self._core.hear_notice(node, None if in_fault else said)
            self._core.hear_report(node, now_s, running, fault, stamp_s, message.stop)
            self._publish_change()

    def _hear_operator(self, message: OperatorHeartbeat) -> None:
        with self._lock:
            self._operator_watchdog.hear(time.monotonic(), message.attended, message.operator_name)

    def _set_mode(self, request: Any, response: Any) -> Any:
        with self._lock:
            # No wait for a request that is refused anyway: a flood of them must not hold the lock.
            if not self.paced and request.mode in self._core.following:
                self._await_news()
            verdict = self._core.request(request.mode, self._now_s())
            self._publish_change()
        response.success, response.message = verdict.allowed, verdict.reason
        response.code, response.fault = int(verdict.code), str(verdict.fault or "")
        return response

    def _await_news(self) -> None:
        """Wait for a limb state that is younger than a request: the client may have seen it."""
        heard, give_up = self._state.count, time.monotonic() + NEWS_S
        while self._state.count == heard and time.monotonic() < give_up:
            time.sleep(0.002)
            self._hear_news()

    def _hear_stop(self, sender: str, number: int) -> None:
        with self._lock:
            self.status.log.info(f"stop pressed by {sender or 'nobody named'}")
            self._core.emergency_stop(PRESSED, number)
            self._publish_change()

    def _emergency_stop(self, request: Any, response: Any) -> Any:
        del request
        with self._lock:
            self._core.emergency_stop("emergency stop")
            self._publish_change()
        response.success, response.message = True, "stopped; call reset to go on"
        return response

    def _reset(self, request: Any, response: Any) -> Any:
        del request
        with self._lock:
            verdict = self._core.reset()
            self._publish_change()
        response.success, response.message = verdict.allowed, verdict.reason
        return response

    def _publish_change(self) -> None:
        """Publish a change at once; in lockstep with the answer to the next state."""
        if not self.paced and self._changed():
            self._publish()


def main() -> int:
    """Entry point."""
    return run_node(SupervisorNode)


if __name__ == "__main__":
    sys.exit(main())
