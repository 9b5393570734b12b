# SPDX-License-Identifier: Apache-2.0
"""Node: records topics as they were sent, into bags that survive kill -9; service record."""

from __future__ import annotations

import math
import shutil
import sys
import time
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from cabols_msgs.msg import Mode
from std_msgs.msg import String
from std_srvs.srv import SetBool

from cabols_control.bags.errors import BagError
from cabols_control.bags.names import relative
from cabols_control.bags.writer import Split
from cabols_control.bringup.argument_text import listed
from cabols_control.bringup_nodes import NODES as CONTROL_NODES
from cabols_control.errors import ConfigError
from cabols_control.realtime.scheduling import be_ordinary
from cabols_control.recorded_configuration import configuration_texts
from cabols_control.ros.lifetime.ending import END_LIMIT_S
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import RUNNING, WAITING, ControlNode, RCLError, run_node
from cabols_control.ros.parameters import declare, declare_row
from cabols_control.ros.recording.bag_recording import Recording
from cabols_control.ros.recording.parameter_census import ParameterCensus
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import MOVING
from cabols_control.topics import RECORDED, Topic, foreign_row, topic_row

IDLE_REPORT_S = 1.0
SPACE_S = 1.0
"""Between two looks at the free space [s]."""
JOIN_S = 0.1
LAST_S = 0.5
"""Time from the last mode that moves anything in which the last currents, zero, come [s]."""


class RecorderNode(ControlNode):
    """Records from its start, or on request of the service `record`; one bag at a time.

    The latched topic `recording` holds the folder of the bag in progress; empty: none.
    """

    # The bridge's last current and what the cables still pull are recorded, too.
    end_limit_s = END_LIMIT_S + 1.0

    def __init__(self) -> None:
        """Subscribe to all topics and create the bag, unless recording starts on request.

        Raises:
            ConfigError: for an unknown topic.
            BagError: if the bag cannot be created, or exists.
        """
        super().__init__("recorder")
        self._given = declare_row(self, CONTROL_NODES.argument("output"))
        text = "topics to record, relative to /cabols"
        names = declare(self, "topics", list(RECORDED), text)
        self._period = declare(
            self, "flush_period", 0.5, "s, what a kill may lose at most", (0.05, 60.0)
        )
        self._description = declare_row(self, CONTROL_NODES.argument("description"))
        self._free_space = declare_row(self, CONTROL_NODES.argument("free_space"))
        size_gb = declare_row(self, CONTROL_NODES.argument("split_size"))
        duration_s = declare_row(self, CONTROL_NODES.argument("split_duration"))
        self._split = Split(int(1e9 * size_gb), duration_s)
        at_once = declare_row(self, CONTROL_NODES.argument("record_at_start"))
        also = declare_row(self, CONTROL_NODES.argument("record_also"))
        self._rows = [*_checked(names), *_further(also)]
        self._failure: BaseException | None = None
        self._no_space = False
        self._told = self.create_publisher(String, "recording", topic_qos("recording"))
        self.create_service(SetBool, "record", self._obey)
        self.create_timer(IDLE_REPORT_S, self._report_idle)
        self._mode: int = Mode.STOPPED
        self._moved_s = -math.inf
        if not self.lockstep:
            # A lockstep run does the same each time: nothing here goes by the wall clock then.
            self.create_subscription(Mode, "mode", self._hear_mode, topic_qos("mode"))
            self.create_timer(SPACE_S, self._watch_space)
        self._joining = self.create_timer(JOIN_S, self._join)
        self._census = ParameterCensus(self, self._describe)
        self._recording = self._new(self._first_folder()) if at_once else None
        self._tell()

    def _first_folder(self) -> Path:
        return Path(self._given) if self._given else self._next_folder()

    def _next_folder(self) -> Path:
        """Name a folder by the time, beside the first one."""
        now = datetime.now(timezone.utc).astimezone()
        parent = Path(self._given).parent if self._given else Path("bags")
        return parent / f"cabols_{now:%Y-%m-%d_%H-%M-%S}"

    def _hear_mode(self, message: Mode) -> None:
        self._mode = message.mode
        if message.mode in MOVING:
            self._moved_s = time.monotonic()

    def end_asked(self) -> None:
        """Ask for unloading, which is recorded, too."""
        if self._recording is not None:
            self.announce_end()

    def may_end(self) -> bool:
        """Not while something moves that is being recorded, nor before its last currents."""
        if self.lockstep or self._recording is None:
            return True
        return self._mode not in MOVING and time.monotonic() - self._moved_s > LAST_S

    def _watch_space(self) -> None:
        """Tell the supervisor before the disk is full; complete the bag once the rig rests."""
        if self._recording is None:
            if self._no_space and not lack_of_space(self._next_folder(), self._free_space):
                self._no_space, self.status.notice = False, None
            return
        lack = lack_of_space(self._recording.folder, self._free_space)
        if not lack:
            return
        if not self._no_space:
            self._no_space = True
            self.status.notice = Fault(FaultName.RECORDING, lack)
            self.status.publish(self.get_clock().now().nanoseconds, RUNNING)
            self.get_logger().error(lack)
        if self._mode not in MOVING:
            self._switch_off()

    def _new(self, folder: Path) -> Recording:
        if lack := lack_of_space(folder, self._free_space):
            raise BagError(lack)
        how = (self._texts(), self._period, self._ended, self._split)
        return Recording(self, folder, self._rows, *how)

    def begin(self) -> None:
        """Start recording."""
        if self._recording is not None:
            self._recording.start()

    def end(self) -> None:
        """Complete the bag."""
        if self._recording is not None:
            self._describe()
            self._recording.close()
            self._failure = self._failure or self._recording.failure

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended a thread or left a bag incomplete."""
        return self._failure

    def _ended(self, failed: bool) -> None:
        """Handle the end of a recording's thread: after a failure, the node ends, too."""
        if failed:
            reason = f"the bag ends early: {self._recording and self._recording.failure}"
            self.status.notice = Fault(FaultName.RECORDING, reason)
            with suppress(RCLError):
                self.status.publish(self.get_clock().now().nanoseconds, WAITING)
            self.context.try_shutdown()
        # rclpy's signal handler wakes executors before it ends the context: on a busy machine one
        # can be back in its wait by then, and would stay there for ever.
        if self.executor is not None:
            self.executor.wake()

    def _obey(self, request: Any, response: Any) -> Any:
        """Service record: true begins a bag, false completes it."""
        # Either takes 70 ms of a core: too long for processes of lower or no priority on it.
        be_ordinary()
        if request.data == (self._recording is not None):
            response.message = (
                f"recording already: {self._recording.folder}"
                if self._recording is not None
                else "nothing is being recorded"
            )
            return response
        if self._recording is None:
            return self._switch_on(response)
        done = self._switch_off()
        response.success = done.failure is None
        response.message = str(done.failure or done.summary().partition("\n")[0])
        if not response.success:
            self.get_logger().error(response.message)
        return response

    def _switch_off(self) -> Recording:
        """Complete the bag."""
        assert self._recording is not None
        self._describe()
        done, self._recording = self._recording, None
        done.close()
        done.forget()
        self._tell()
        return done

    def _switch_on(self, response: Any) -> Any:
        folder = self._next_folder()
        try:
            self._recording = self._new(folder)
        except BagError as error:
            response.message = str(error)
            self.get_logger().error(response.message)
            return response
        self._recording.start()
        self._joining.reset()
        self._tell()
        response.success, response.message = True, f"recording into {folder}"
        return response

    def _join(self) -> None:
        """Subscribe to the loop's topics once their join policy allows it."""
        be_ordinary()
        if self._recording is None or self._recording.join():
            self._joining.cancel()

    def _tell(self) -> None:
        folder = "" if self._recording is None else str(self._recording.folder)
        self._told.publish(String(data=folder))

    def _report_idle(self) -> None:
        if self._recording is None and not self.lockstep:
            self.status.publish(self.get_clock().now().nanoseconds, WAITING)

    def _texts(self) -> dict[str, str]:
        """Return what the bag's metadata says of the run."""
        here = self.get_namespace()
        return {
            "description": self._description,
            "namespace": here,
            **configuration_texts(self.rig_folder, self._census.parameters),
        }

    def _describe(self) -> None:
        """Put what further nodes have answered into the bag."""
        if self._recording is not None:
            self._recording.describe(self._texts())


def lack_of_space(folder: Path, least_gb: float) -> str:
    """Why a bag must not be written into a folder; empty if there is space enough.

    Args:
        folder: of the bag; need not exist yet.
        least_gb: space that must be free [GB].
    """
    there = next(path for path in [folder.absolute(), *folder.absolute().parents] if path.is_dir())
    free_gb = 1e-9 * shutil.disk_usage(there).free
    if free_gb >= least_gb:
        return ""
    return (
        f"{folder}: expected at least {least_gb:g} GB of free space for a bag, got {free_gb:.2f}; "
        "delete old bags, or set free_space"
    )


def _further(text: str) -> list[Topic]:
    """Rows of topics beside the graph's.

    Raises:
        ConfigError: if one has no such name or type, or its type is not installed here.
    """
    try:
        rows = [foreign_row(name) for name in listed(text)]
        for row in rows:
            topics.class_of(row.type_name)
    except (ValueError, ImportError, AttributeError) as error:
        raise ConfigError(f"record_also: {error}; is its package installed?") from error
    return rows


def _checked(names: list[str]) -> list[Topic]:
    chosen = list(dict.fromkeys(relative(name) for name in names if name))
    unknown = [name for name in chosen if name not in topics.TYPES]
    if unknown or not chosen:
        raise ConfigError(
            f"topics: expected some of {', '.join(topics.TYPES)}, "
            f"got {', '.join(unknown) or 'none'}; correct the parameter"
        )
    return [topic_row(name) for name in chosen]


def main() -> int:
    """Entry point."""
    return run_node(RecorderNode)


if __name__ == "__main__":
    sys.exit(main())
