# SPDX-License-Identifier: Apache-2.0
"""One bag being recorded: topics are taken as they were sent, in one thread, written in another."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from operator import itemgetter
from pathlib import Path
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation

from cabols_control.bags.errors import BagError
from cabols_control.bags.metadata import OfferedQos
from cabols_control.bags.writer import BagWriter, Split
from cabols_control.realtime.scheduling import be_ordinary, collect_young
from cabols_control.ros.loop import IDLE_NS, make_wait_set, wait_for
from cabols_control.ros.node import RUNNING, WAITING, ControlNode
from cabols_control.ros.recording.recorded_topic import Item, RecordedTopic
from cabols_control.stamps import first_stamp
from cabols_control.topics import Topic

GATHER_S = 0.02
"""Period in which waiting messages are taken [s]; the middleware stamps their reception."""
STATUS_S = 1.0
END_S = 5.0
"""Longest wait for a slow disk at the end [s]; normally it takes a quarter of a second."""


class Recording:
    """Takes messages in one thread, writes and flushes them in another, until it is closed.

    Attributes:
        failure: the error that ended a thread or left the bag incomplete; None without one.
    """

    def __init__(
        self,
        node: ControlNode,
        folder: Path,
        rows: list[Topic],
        texts: dict[str, str],
        period_s: float,
        on_end: Callable[[bool], None],
        split: Split | None = None,
    ) -> None:
        """Create the bag and subscribe, on the loop's topics in join(); start() begins.

        Args:
            node: owner of subscriptions and status.
            folder: of the bag; new or empty.
            rows: of the topics.
            texts: for the bag's metadata.
            period_s: between two flushes [s].
            on_end: called by each thread at its end, with whether it failed.
            split: when another file of the bag begins; None: never.

        Raises:
            BagError: if the bag cannot be created, or exists.
        """
        self._node = node
        self._period = period_s
        self._on_end = on_end
        self._writer = BagWriter(folder, texts, split)
        self._topics = [RecordedTopic(node, row) for row in rows]
        for topic in self._topics:
            qos = OfferedQos(
                topic.offered.depth,
                topic.offered.reliability.name.lower(),
                topic.offered.durability.name.lower(),
            )
            self._writer.add_topic(topic.name, topic.type_name, qos)
        self._taken: deque[Item] = deque()
        self._newest_raw = b""
        self._texts: dict[str, str] | None = None
        self.failure: BaseException | None = None
        self._stop = threading.Event()
        self._wait_set = make_wait_set(node, len(self._topics))
        self._threads = [
            threading.Thread(target=self._guarded, args=(run,), name=run.__name__, daemon=True)
            for run in (self._take_all, self._write_all)
        ]

    @property
    def folder(self) -> Path:
        """Of the bag."""
        return self._writer.folder

    def start(self) -> None:
        """Begin."""
        for thread in self._threads:
            thread.start()
        self._node.get_logger().info(f"recording {len(self._topics)} topics into {self.folder}")

    def join(self) -> bool:
        """Subscribe to the loop's topics as their join policy allows; return whether to all."""
        waiting = [topic for topic in self._topics if not topic.join(time.monotonic())]
        return not waiting

    def describe(self, texts: dict[str, str]) -> None:
        """Replace what the bag's metadata says of the run, by the next flush.

        Args:
            texts: free text by key.
        """
        self._texts = texts

    def _tell_texts(self) -> None:
        texts, self._texts = self._texts, None
        if texts is not None:
            self._writer.describe(texts)

    def close(self) -> None:
        """Take the remaining messages, complete the bag and print its content."""
        give_up = time.monotonic() + END_S
        self._stop.set()
        for thread in self._threads:
            if thread.is_alive():
                thread.join(timeout=max(0.0, give_up - time.monotonic()))
        if self.failure is None and any(thread.is_alive() for thread in self._threads):
            self.failure = BagError(
                f"{self.folder}: expected the disk to take the last messages within "
                f"{END_S:g} s, got no answer; run `ros2 run cabols_control recover` on it"
            )
        if self.failure is not None:
            self._writer.abandon()
            return
        try:
            self._take()
            self._write()
            self._tell_texts()
            self._writer.close()
        except BagError as error:
            self.failure = error
            self._writer.abandon()
            return
        with suppress(OSError):
            # The terminal, or the launcher that read this, may be gone.
            print(self.summary(), flush=True)

    def forget(self) -> None:
        """Unsubscribe, after close()."""
        for topic in self._topics:
            topic.close()

    def summary(self) -> str:
        """Return the bag's content as text, topic by topic; silent topics are left out."""
        total = sum(topic.count for topic in self._topics)
        lost = sum(topic.missing.lost for topic in self._topics)
        lines = [f"{self.folder}: {total} messages, {lost} lost"]
        lines += [
            f"  {topic.count:9d}  {topic.name}  (lost {topic.missing.lost})"
            for topic in self._topics
            if topic.count or topic.missing.lost
        ]
        return "\n".join(lines)

    def _guarded(self, run: Any) -> None:
        try:
            run()
        except BaseException as error:
            # After the context has shut down, rcl refuses pending calls; that is no failure.
            if self._node.context.ok() or not isinstance(error, rclpy_implementation.RCLError):
                self.failure = self.failure or error
            self._stop.set()
        finally:
            self._on_end(self.failure is not None)

    def _take_all(self) -> None:
        self._node.prepare_thread()
        report_at = time.monotonic() + STATUS_S
        while not self._stop.is_set() and self._node.context.ok():
            joined = [topic for topic in self._topics if topic.joined]
            if wait_for(self._wait_set, joined, IDLE_NS):
                self._stop.wait(GATHER_S)
                self._take()
            if not self._node.lockstep and time.monotonic() >= report_at:
                report_at += STATUS_S
                self._report()

    def _take(self) -> None:
        for topic in self._topics:
            self._newest_raw = topic.take(self._taken) or self._newest_raw

    def _write_all(self) -> None:
        due = time.monotonic() + self._period
        while not self._stop.wait(max(0.0, due - time.monotonic())):
            due = max(due + self._period, time.monotonic())
            # Taking must not wait, or the middleware drops messages; writing may.
            be_ordinary()
            self._write()
            if not self._node.lockstep:
                # In lockstep at the end: the same bytes for the same seed.
                self._tell_texts()
            self._writer.flush()
            collect_young()

    def _write(self) -> None:
        started = time.monotonic()
        batch = [self._taken.popleft() for _ in range(len(self._taken))]
        batch.sort(key=itemgetter(0))
        for log_time_ns, topic, publish_time_ns, data, number in batch:
            self._writer.write(topic, log_time_ns, publish_time_ns, data, number)
        self._node.status.work.add(time.monotonic() - started)

    def _report(self) -> None:
        status = self._node.status
        status.cycles = sum(topic.count for topic in self._topics)
        status.lost = sum(topic.missing.lost for topic in self._topics)
        stamp_ns = first_stamp(self._newest_raw) if self._newest_raw else 0
        status.publish(stamp_ns, RUNNING if self._newest_raw else WAITING)
