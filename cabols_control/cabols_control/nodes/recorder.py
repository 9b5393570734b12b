"""Node: records topics as they were sent, into a bag that survives kill -9."""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from datetime import datetime, timezone
from hashlib import sha256
from operator import itemgetter
from pathlib import Path
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import QoSProfile

from cabols_control.bags.errors import BagError
from cabols_control.bags.gaps import Gaps
from cabols_control.bags.metadata import OfferedQos
from cabols_control.bags.names import relative
from cabols_control.bags.scan import first_stamp
from cabols_control.bags.writer import BagWriter
from cabols_control.configuration import packaged
from cabols_control.errors import ConfigError
from cabols_control.realtime import collect_young
from cabols_control.ros import topics
from cabols_control.ros.loop import IDLE_NS, LoopGroup, make_wait_set, wait_for
from cabols_control.ros.node import RUNNING, WAITING, ControlNode, run_node
from cabols_control.ros.parameters import declare
from cabols_control.ros.qos import control_qos, latched_qos, status_qos

QUEUE_DEPTH = 4000
GATHER_S = 0.02
"""How long messages gather before all are taken; the middleware stamps their reception."""
STATUS_S = 1.0
END_S = 5.0
"""How long a slow disk may keep the end waiting; normally it takes a quarter of a second."""
RIG_FILES = ("geometry", "limbs", "control")

Item = tuple[int, str, int, bytes, int]


class Tap:
    """One recorded topic."""

    def __init__(self, node: ControlNode, topic: str) -> None:
        """Subscribe, whether or not anybody publishes yet."""
        self.topic = topic
        self._type = topics.TYPES[topic]
        self.offered = _offered_qos(topic, node.lockstep)
        wanted = QoSProfile(
            depth=QUEUE_DEPTH,
            reliability=self.offered.reliability,
            durability=self.offered.durability,
        )
        self._subscription = node.create_subscription(
            self._type, topic, _unused, wanted, callback_group=LoopGroup(), raw=True
        )
        self._handle = self._subscription.handle
        self.gaps = Gaps(lambda: node.count_publishers(topic))
        self.count = 0
        self._log_time_ns = 0

    @property
    def type_name(self) -> str:
        """Name as in `cabols_msgs/msg/LimbState`."""
        package, *_ = self._type.__module__.split(".")
        return f"{package}/msg/{self._type.__name__}"

    def take(self, into: deque[Item]) -> bytes:
        """Take all that waits, in order; returns the newest, empty if there was none."""
        handle, msg_type, add = self._handle, self._type, self.gaps.add
        newest = b""
        while (taken := handle.take_message(msg_type, True)) is not None:
            newest, info = taken
            number = info["publication_sequence_number"]
            add(number)
            received = info["received_timestamp"] or time.time_ns()
            # A clock that is set back must not turn the order of a topic around.
            self._log_time_ns = max(received, self._log_time_ns)
            self.count += 1
            into.append((self._log_time_ns, self.topic, info["source_timestamp"], newest, number))
        return newest


class RecorderNode(ControlNode):
    """Takes messages in one thread, writes and flushes them in another."""

    def __init__(self) -> None:
        """Subscribe to all topics and create the bag.

        Raises:
            ConfigError: for an unknown topic.
            BagError: if the bag cannot be created, or is there already.
        """
        super().__init__("recorder")
        now = datetime.now(timezone.utc).astimezone()
        output = declare(self, "output", "", "folder of the bag; empty: bags/cabols_<date-time>")
        text = "topics to record, relative to /cabols"
        names = declare(self, "topics", list(topics.RECORDED), text)
        self._period = declare(
            self, "flush_period", 0.5, "s, what a kill may lose at most", (0.05, 60.0)
        )
        text = declare(self, "description", "", "text about the run for the bag's metadata")
        folder = Path(output or f"bags/cabols_{now:%Y-%m-%d_%H-%M-%S}")
        wanted = _checked(names)
        self._writer = BagWriter(folder, {"description": text, **self._rig_texts()})
        self._taps = [Tap(self, name) for name in wanted]
        for tap in self._taps:
            qos = OfferedQos(
                tap.offered.depth,
                tap.offered.reliability.name.lower(),
                tap.offered.durability.name.lower(),
            )
            self._writer.add_topic(tap.topic, tap.type_name, qos)
        self._taken: deque[Item] = deque()
        self._newest_raw = b""
        self._failure: BaseException | None = None
        self._stop = threading.Event()
        self._wait_set = make_wait_set(self, len(self._taps))
        self._threads = [
            threading.Thread(target=self._guarded, args=(run,), name=run.__name__, daemon=True)
            for run in (self._take_all, self._write_all)
        ]

    def begin(self) -> None:
        """Start recording."""
        for thread in self._threads:
            thread.start()
        self.get_logger().info(f"recording {len(self._taps)} topics into {self._writer.folder}")

    def end(self) -> None:
        """Take what has arrived, complete the bag and say what is in it."""
        give_up = time.monotonic() + END_S
        self._stop.set()
        for thread in self._threads:
            if thread.is_alive():
                thread.join(timeout=max(0.0, give_up - time.monotonic()))
        if self._failure is None and any(thread.is_alive() for thread in self._threads):
            self._failure = BagError(
                f"{self._writer.folder}: expected the disk to take the last messages within "
                f"{END_S:g} s, got no answer; run `ros2 run cabols_control recover` on it"
            )
        if self._failure is not None:
            self._writer.abandon()
            return
        try:
            self._take()
            self._write()
            self._writer.close()
        except BagError as error:
            self._failure = error
            self._writer.abandon()
            return
        self._summarise()

    @property
    def failure(self) -> BaseException | None:
        """What ended a thread, or kept the bag from being completed."""
        return self._failure

    def _guarded(self, run: Any) -> None:
        try:
            run()
        except BaseException as error:
            # Once the context has ended, rcl refuses what was under way: no failure of its own.
            if self.context.ok() or not isinstance(error, rclpy_implementation.RCLError):
                self._failure = self._failure or error
            self._stop.set()
            self.context.try_shutdown()
        finally:
            self._wake_executor()

    def _wake_executor(self) -> None:
        """Let the executor see that the context has ended.

        rclpy's signal handler wakes executors before it ends the context: on a busy machine one
        can be back in its wait by then, and would stay there for ever.
        """
        if self.executor is not None:
            self.executor.wake()

    def _take_all(self) -> None:
        self.prepare_thread()
        report_at = time.monotonic() + STATUS_S
        while not self._stop.is_set() and self.context.ok():
            if wait_for(self._wait_set, self._taps, IDLE_NS):
                self._stop.wait(GATHER_S)
                self._take()
            if not self.lockstep and time.monotonic() >= report_at:
                report_at += STATUS_S
                self._report()

    def _take(self) -> None:
        for tap in self._taps:
            self._newest_raw = tap.take(self._taken) or self._newest_raw

    def _write_all(self) -> None:
        due = time.monotonic() + self._period
        while not self._stop.wait(max(0.0, due - time.monotonic())):
            due = max(due + self._period, time.monotonic())
            self._write()
            self._writer.flush()
            collect_young()

    def _write(self) -> None:
        started = time.monotonic()
        batch = [self._taken.popleft() for _ in range(len(self._taken))]
        batch.sort(key=itemgetter(0))
        for log_time_ns, topic, publish_time_ns, data, number in batch:
            self._writer.write(topic, log_time_ns, publish_time_ns, data, number)
        self.status.work.add(time.monotonic() - started)

    def _report(self) -> None:
        self.status.cycles = sum(tap.count for tap in self._taps)
        self.status.lost = sum(tap.gaps.lost for tap in self._taps)
        stamp_ns = first_stamp(self._newest_raw) if self._newest_raw else 0
        self.status.publish(stamp_ns, RUNNING if self._newest_raw else WAITING, "")

    def _rig_texts(self) -> dict[str, str]:
        """Return content and hash of the rig's files."""
        found = {}
        for name in RIG_FILES:
            given = self.get_parameter(f"{name}_file").value
            path = Path(given or packaged("cabols_control", f"bench_{name}.yaml"))
            content = path.read_bytes()
            found[f"{name}_file"] = path.name
            found[f"{name}_yaml"] = content.decode()
            found[f"{name}_sha256"] = sha256(content).hexdigest()
        return found

    def _summarise(self) -> None:
        total = sum(tap.count for tap in self._taps)
        lost = sum(tap.gaps.lost for tap in self._taps)
        lines = [f"{self._writer.folder}: {total} messages, {lost} lost"]
        lines += [f"  {tap.count:9d}  {tap.topic}  (lost {tap.gaps.lost})" for tap in self._taps]
        print("\n".join(lines), flush=True)


def _offered_qos(topic: str, lockstep: bool) -> QoSProfile:
    """Return the quality with which the topic's publishers offer it."""
    if topic in topics.CONTROL_TOPICS:
        return control_qos(lockstep)
    return latched_qos(lockstep) if topic in topics.LATCHED_TOPICS else status_qos()


def _checked(names: list[str]) -> list[str]:
    wanted = list(dict.fromkeys(relative(name) for name in names if name))
    unknown = [name for name in wanted if name not in topics.TYPES]
    if unknown or not wanted:
        raise ConfigError(
            f"topics: expected some of {', '.join(topics.TYPES)}, "
            f"got {', '.join(unknown) or 'none'}; correct the parameter"
        )
    return wanted


def _unused(_: bytes) -> None:
    """Stand in for the callback that rclpy demands."""


def main() -> int:
    """Entry point."""
    return run_node(RecorderNode)


if __name__ == "__main__":
    sys.exit(main())
