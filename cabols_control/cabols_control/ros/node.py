# SPDX-License-Identifier: Apache-2.0
"""Base of all control nodes: configuration, loop, status reports, orderly shutdown."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import lru_cache

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from cabols_control import end_signals
from cabols_control.command_line import USAGE, fail
from cabols_control.errors import CabolsError
from cabols_control.realtime.kernel_signatures import compiled_since, specialisations
from cabols_control.realtime.scheduling import (
    apply_scheduling,
    collect_young,
    freeze_garbage,
    give_back,
)
from cabols_control.ros.lifetime.ending import (
    END_LIMIT_S,
    EndedEarly,
    EndRequest,
    go_on,
    take_requests,
)
from cabols_control.ros.lifetime.own_time import keep_own_time
from cabols_control.ros.lifetime.roles import RoleCheck
from cabols_control.ros.lifetime.slow_start import told_if_slow
from cabols_control.ros.live import LiveOutput
from cabols_control.ros.loop import Output
from cabols_control.ros.messages import topics, transport
from cabols_control.ros.parameters import (
    declare,
    declare_lockstep,
    declare_rig,
    declare_rig_folder,
    declare_scheduling,
)
from cabols_control.ros.status.diagnostics import Diagnostics, Health
from cabols_control.ros.status.loop_log import LoopLog
from cabols_control.ros.status.statistics import Durations
from cabols_control.ros.threads.executor_thread import hand_over
from cabols_control.ros.threads.node_executor import NodeExecutor
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.senders import LOCKSTEP_INSTANCE, draw_instance
from cabols_control.supervision.session import SessionFollower
from cabols_control.topics import NAMESPACE

RCLError = rclpy_implementation.RCLError
ROS_ARGUMENT_ERRORS = (
    rclpy_implementation.RCLInvalidROSArgsError,
    rclpy_implementation.UnknownROSArgsError,
)
WAITING, RUNNING, FAULT = 0, 1, 2
REPORT_EVERY = 100
READERS_PATIENCE_S = 60.0
READERS_QUIET_S = 5.0
"""How long a loop waits for the readers of its topics without a word [s]."""
LAST_CYCLES_S = 0.2
"""Time for which a node goes on when what kept it is over: the last currents, zero, go out [s]."""


class Status:
    """Counters of one loop, published as LoopStatus every 100 cycles and when the state changes.

    Attributes:
        log: of the loop.
        sessions: the supervisor's session that the node follows.
        on_change: called after each change of state or reason.
        counted: further counters for /diagnostics, by name.
        configuration: fingerprint of the rig's files, for /diagnostics.
        notice: told with every report in which the loop has nothing of its own to tell.
        stop: number of an emergency stop that the node holds; 0 for none.
    """

    def __init__(self, node: Node, lockstep: bool) -> None:
        """Advertise loop_status."""
        self._name = node.get_name()
        self._output = Output(node, "loop_status")
        self._lockstep = lockstep
        self._instance = LOCKSTEP_INSTANCE if lockstep else draw_instance()
        self._layout = lru_cache(maxsize=16)(topics.loop_status_layout)
        self._layout(self._name, "")
        self._reported: tuple[int, Fault | None, int] = (-1, None, 0)
        self.log = LoopLog(node)
        self.notice: Fault | None = None
        self.stop = 0
        self.on_change: Callable[[], object] = lambda: None
        self.sessions = SessionFollower()
        self.cycles = 0
        self.lost = 0
        self.late = 0
        self.infeasible = 0
        self.counted: dict[str, int] = {}
        self.configuration = ""
        self.work = Durations()
        self.round_trip = Durations()

    def cycle(self, stamp_ns: int, state: int, fault: Fault | None = None) -> None:
        """Count one cycle; publish when a report is due or the state has changed.

        Args:
            stamp_ns: of the newest sample that the loop has handled [ns].
            state: WAITING, RUNNING or FAULT.
            fault: what is wrong; it stops the loop only with state FAULT.
        """
        self.cycles += 1
        fault = fault or self.notice
        changed = (state, fault, self.stop) != self._reported
        if changed or self.cycles % REPORT_EVERY == 0:
            self.publish(stamp_ns, state, fault)
        if changed:
            self._log(state, fault)
            self._reported = (state, fault, self.stop)
            self.on_change()

    def publish(self, stamp_ns: int, state: int, fault: Fault | None = None) -> None:
        """Send one report; arguments as for cycle."""
        fault = fault or self.notice
        reason, name = ("", "") if fault is None else (fault.reason, fault.name.value)
        record = self._layout(self._name, reason, name).record()
        record.stamp(max(stamp_ns, 0))
        record["state"][0] = state
        for name in ("cycles", "lost", "late", "infeasible"):
            record[name][0] = getattr(self, name)
        record["dropped"][0] = self.sessions.dropped
        record["instance"][0] = self._instance
        record["stop"][0] = self.stop
        if not self._lockstep:
            record["work_time"][0], record["work_time_p99"][0] = self.work.summary()
            record["round_trip"][0], record["round_trip_p99"][0] = self.round_trip.summary()
        self._output.publish(record.raw())

    def snapshot(self) -> Health:
        """Return the newest state, fault and counters."""
        state, fault, _ = self._reported
        counted = ("cycles", "lost", "late", "infeasible")
        counters: dict[str, object] = {name: getattr(self, name) for name in counted}
        counters |= self.counted
        counters["configuration"] = self.configuration
        counters["dropped"] = self.sessions.dropped
        return Health(max(state, WAITING), fault, counters)

    def _log(self, state: int, fault: Fault | None) -> None:
        if state == FAULT:
            self.log.error("fault without a reason" if fault is None else fault.reason)
        elif self._reported[0] == FAULT:
            self.log.info("fault cleared")

    def output(self) -> Output:
        """Return the publisher, for the count of its readers."""
        return self._output


class ControlNode(Node):
    """A node of the control graph with the rig's configuration and a status.

    Attributes:
        hardware: what it stands for on /diagnostics: its device, or the rig.
    """

    role_topic = ""
    """Topic by which another node in the same role is heard; empty: there may be several."""
    end_limit_s = END_LIMIT_S
    """Longest time for which a load keeps it from ending [s]."""
    starts_harmlessly = False
    """Whether its start opens nothing that must be closed in order, so that it may be cut short."""

    def __init__(self, name: str) -> None:
        """Declare the common parameters and read the rig.

        Raises:
            ConfigError: if a configuration file cannot be used.
            EndedEarly: if the process is asked to end already.
        """
        go_on()
        super().__init__(name, namespace=NAMESPACE)
        keep_own_time(self)
        self.rig_folder = declare_rig_folder(self)
        self.rig = declare_rig(self, self.rig_folder)
        self.lockstep = declare_lockstep(self)
        beside = declare(
            self,
            "beside_clock",
            False,
            "lockstep: run at the computer's own pace, as the clock does not wait for this node",
        )
        self.paced = self.lockstep and not beside
        # From now on, so that listening costs no time of its own.
        listens = self.role_topic and not self.lockstep
        self._role = RoleCheck(self, self.role_topic) if listens else None
        self._scheduling = declare_scheduling(self)
        wanted = declare(
            self,
            "wait_for_readers",
            [""],
            "topic=node+node: start only when these nodes read the topic",
        )
        pairs = (item.partition("=") for item in wanted if item)
        self._wanted_readers = {topic: frozenset(names.split("+")) for topic, _, names in pairs}
        self.outputs: dict[str, Output] = {}
        self.status = Status(self, self.lockstep)
        self.outputs["loop_status"] = self.status.output()
        self._compiled: dict[str, int] | None = None
        self.hardware = f"rig {self.rig_folder.name}"
        self.status.configuration = self.rig_folder.fingerprint
        diagnostics = Diagnostics(self, self.status.snapshot, lambda: self.hardware)
        self.status.on_change = lambda: hand_over(self, diagnostics.tell)
        go_on()

    def advertise(self, topic: str) -> Output:
        """Return a publisher whose readers the control thread waits for."""
        self.outputs[topic] = output = Output(self, topic, self.lockstep)
        return output

    def advertise_live(self, topic: str) -> LiveOutput:
        """Return the same for a topic with a slow copy."""
        self.outputs[topic] = output = LiveOutput(self, topic, self.lockstep)
        return output

    def check_role(self) -> None:
        """Refuse to start beside another node in this role; called before begin().

        Raises:
            RoleTakenError: if there is one.
        """
        if self._role is not None:
            self._role.check()

    def leave_role(self) -> None:
        """Let another process have this node's role."""
        if self._role is not None:
            self._role.leave()

    def prepare_thread(self) -> None:
        """Prepare the control thread before its first cycle: readers, garbage, scheduling."""
        self._wait_for_readers()
        self.status.log.warm_up("running")
        freeze_garbage()
        self._compiled = specialisations()
        # Not earlier: a full collection takes 70 ms of a core that running nodes need.
        self.apply_scheduling()

    def apply_scheduling(self) -> None:
        """Request the parameters' scheduling from the kernel, for all present threads."""
        apply_scheduling(self._scheduling, self.get_logger().warning)

    def complain_of_compiling(self) -> None:
        """Warn of functions compiled while the control thread ran: the warm-up missed them."""
        late = [] if self._compiled is None else compiled_since(self._compiled)
        if late:
            self.get_logger().warning(f"compiled during operation: {', '.join(late)}")

    def tidy(self) -> None:
        """Collect young garbage; called once in many cycles."""
        if self.status.cycles % 200 == 0:
            collect_young()

    def _wait_for_readers(self) -> None:
        began, told = time.monotonic(), False
        for topic, names in self._wanted_readers.items():
            while missing := self._missing_readers(topic, names):
                if not self.context.ok():
                    return
                waited_s = time.monotonic() - began
                if waited_s > READERS_PATIENCE_S:
                    raise TimeoutError(
                        f"{topic}: expected it to be read within {READERS_PATIENCE_S:g} s by "
                        f"{', '.join(sorted(names))}, got no {missing}: did it not start?"
                    )
                if waited_s > READERS_QUIET_S and not told:
                    told = True
                    self.get_logger().info(
                        f"waits for {missing} to read {topic}; gives up after "
                        f"{READERS_PATIENCE_S:g} s"
                    )
                time.sleep(0.01)

    def _missing_readers(self, topic: str, names: frozenset[str]) -> str:
        """Name who does not read a topic yet; others who read it, such as tools, do not count."""
        found = self.get_subscriptions_info_by_topic(self.resolve_topic_name(topic))
        own = self.get_namespace()
        here = {each.node_name for each in found if each.node_namespace == own}
        # Known is not met: what is published before is lost.
        met = self.outputs[topic].readers >= len(found)
        return ", ".join(sorted(names - here)) or ("" if met else "other node")

    def begin(self) -> None:
        """Start threads; called after the executor was created."""
        self.apply_scheduling()

    def end(self) -> None:
        """Stop threads and leave outputs safe."""

    def end_asked(self) -> None:
        """Note, once, that this process is asked to end; called before any `may_end`."""

    def may_end(self) -> bool:
        """Whether this process may end now; one of the control path may not under load."""
        return True

    def announce_end(self) -> None:
        """Ask the supervisor, by the next report, to unload and stop the rig."""
        self.status.notice = Fault(FaultName.ENDING, "asked to end")

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended a thread of this node; None if there is none."""
        return None


def run_node(factory: Callable[[], ControlNode], arguments: list[str] | None = None) -> int:
    """Run one control node until a signal to end, its launcher's death or its own failure.

    A node of the control path goes on while there is a load, for at most its end_limit_s. One that
    is asked to end while it starts completes what it has opened, such as a bag, and ends with 0;
    one that has opened nothing ends at once.

    Args:
        factory: class of the node, or a function that makes it.
        arguments: for ROS; None: the process' own.

    Returns:
        Exit code: 0, or 1 after a failure, or 2 for a configuration that cannot be used.
    """
    end = take_requests()
    try:
        transport.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        with end.at_once(getattr(factory, "starts_harmlessly", False)), told_if_slow():
            node = factory()
            node.check_role()
    except (CabolsError, ParameterException, *ROS_ARGUMENT_ERRORS) as error:
        code = fail(str(error), USAGE)
        rclpy.try_shutdown()
        end_signals.ignore()
        return code
    except EndedEarly:
        rclpy.try_shutdown()
        end_signals.ignore()
        return 0
    executor = NodeExecutor()
    executor.add_node(node)
    try:
        node.begin()
        _spin(node, executor, end)
    except ExternalShutdownException:
        pass
    except RCLError:
        # A signal may end the context while the executor is about to use it.
        if node.context.ok():
            raise
    finally:
        node.end()
        give_back()
        node.complain_of_compiling()
        failure = node.failure
        executor.remove_node(node)
        node.destroy_node()
        node.leave_role()
        rclpy.try_shutdown()
        end_signals.ignore()
    if failure is not None:
        print(f"error: {type(failure).__name__}: {failure}", file=sys.stderr)
        return 1
    return 0


def _spin(node: ControlNode, executor: NodeExecutor, end: EndRequest) -> None:
    """Serve a node until its context ends, or it is asked to end and may."""
    told, moved_s = False, -LAST_CYCLES_S
    while node.context.ok():
        if end.asked:
            if not told:
                told = True
                node.end_asked()
            if not node.may_end():
                moved_s = time.monotonic()
            rests = time.monotonic() - moved_s >= LAST_CYCLES_S
            if rests or end.overdue(node.end_limit_s):
                node.context.try_shutdown()
                return
        executor.spin_once(timeout_sec=0.05 if told else 0.2)
