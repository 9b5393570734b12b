# SPDX-License-Identifier: Apache-2.0
"""The console's inputs, read twenty times a second from slow copies of the topics."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from cabols_msgs.msg import (
    CampaignStatus,
    LoopStatus,
)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from cabols_control.console.error_meter import ErrorMeter
from cabols_control.console.latest import FAULT, INFO, NOTICE, WARNING, LatestValues
from cabols_control.console.view_models import (
    LoopReport,
    Measured,
    campaign_view,
    device_rows,
    estimate_rows,
    first_report,
    loop_rows,
    mode_view,
    numbers,
)
from cabols_control.frames import load_wrench_frames
from cabols_control.naming import reflector_name, told
from cabols_control.rig import Rig
from cabols_control.rig_folder import RigFolder
from cabols_control.ros.framed_wrench import FramedInput
from cabols_control.ros.live import live_name
from cabols_control.ros.loop import Input
from cabols_control.ros.messages import topics
from cabols_control.ros.reader import Reader
from cabols_control.ros.sessions import ModeFilter
from cabols_control.rotations import read_pose
from cabols_control.supervision.faults import fault_name
from cabols_control.supervision.held_load import held_text
from cabols_control.supervision.modes import Cause, Entry, OperatingMode
from cabols_control.supervision.senders import make_room

STALE_S = 0.5
"""Longest age of a value that is shown [s]."""
NAME_SIZE, PATH_SIZE = 100, 4096
"""Of names and paths this much is kept [characters]."""
STATE_EVERY = 10
"""Frames between two updates of the loops' health: half a second."""
LEVELS = {DiagnosticStatus.OK: 1, DiagnosticStatus.WARN: 0, DiagnosticStatus.ERROR: 2}
"""Level on /diagnostics to state of LoopStatus."""
MOST_JOINTS = 64
"""Of more joints none is shown."""
LOUD = 30
"""Level of a warning on rosout; lower ones stay in the nodes' own logs."""


class Feed:
    """Turns received messages into the newest frame, the state and the events."""

    def __init__(
        self, node: Node, rig: Rig, latest: LatestValues, rig_folder: str | RigFolder = ""
    ) -> None:
        """Subscribe; only one thread may call `look`."""
        self._latest = latest
        self._own = node.get_name()
        self._namespace = node.get_namespace()
        self._loggers = self._namespace.strip("/").replace("/", ".") + "."
        geometry = rig.geometry

        def live(topic: str, layout: Any) -> Input:
            return Input(node, live_name(topic), layout)

        self._state = live("limb_state", topics.limb_state_layout(geometry))
        self._wrench = live("wrench", topics.wrench_layout(geometry.platform_frame))
        self._hangs = rig.hanging is not None
        self._frames = load_wrench_frames(geometry, rig_folder)
        self._program = FramedInput(
            node, live_name("program_wrench"), topics.program_wrench_layout, self._frames
        )
        self._told = FramedInput(
            node, live_name("frame_wrench"), topics.frame_wrench_layout, self._frames
        )
        self._errors = ErrorMeter()
        self._command = live("tension_command", topics.tension_command_layout(geometry))
        self._pose = live("platform_pose", topics.pose_layout(geometry))
        self._joints = Reader(node, live_name("joint_states"))
        self._modes = Reader(node, "mode")
        self._filter = ModeFilter()
        self._status = Reader(node, "loop_status")
        self._diagnostics = Reader(node, "/diagnostics")
        self._measured = Reader(node, "reflector_measurement")
        self._estimates = Reader(node, "stiffness_estimate")
        self._campaigns = Reader(node, "campaign_status")
        self._recordings = Reader(node, "recording")
        self._spoken = Reader(node, "/rosout")
        self._reports: dict[str, LoopReport] = {}
        self._beam: Measured | None = None
        self._mode: Entry | None = None
        self._mode_s = 0.0
        self._joint_values: tuple[float, list[float]] = (0.0, [])
        self._turns = 0

    def frame_inputs(self) -> tuple[Input, ...]:
        """Inputs of a frame, for other viewers of the same thread."""
        return self._state, self._wrench, self._command, self._pose

    def look(self) -> dict[str, Any]:
        """Take what has arrived, store it as the newest values; return the frame."""
        for source in (*self.frame_inputs(), self._program, self._told):
            source.take()
        for message in self._joints.take():
            self._joint_values = (time.monotonic(), list(message.position[:MOST_JOINTS]))
        self._hear_modes()
        for message in self._status.take():
            self._hear_status(message)
        for message in self._diagnostics.take():
            self._hear_diagnostics(message)
        self._hear_rare()
        frame = self._frame()
        self._latest.put_frame(frame)
        self._turns += 1
        if self._turns % STATE_EVERY == 0:
            self._tell_health()
        return frame

    def _frame(self) -> dict[str, Any]:
        now_ns = time.monotonic_ns()
        frame: dict[str, Any] = {}

        def fresh(source: Input) -> bool:
            age = 1e-9 * (now_ns - source.received_ns)
            return source.record is not None and age <= STALE_S

        if fresh(self._state):
            record = self._state.record
            frame["T"] = numbers(record["tension"], 2)
            frame["C"] = numbers(record["current"], 3)
            frame["S"] = _bits(record["switch_closed"])
            frame["Z"] = _bits(record["zeroed"])
        runs = fresh(self._program)
        if fresh(self._wrench):
            frame["w"] = numbers(self._in_frame(self._wrench.record["wrench"], runs), 3)
        if runs and self._program.frame is not None:
            frame["f"] = self._program.frame_name
        if fresh(self._command):
            record = self._command.record
            frame["A"] = numbers(record["tension"], 2)
            frame["F"] = bool(record["feasible"])
            # A preview's reference runs ahead of what was asked for.
            asked = self._program.record["command"] if runs else record["desired"]
            frame["d"] = numbers(asked, 3)
        if fresh(self._pose) and read_pose(self._pose.record["pose"]) is not None:
            frame["P"] = numbers(self._pose.record["pose"], 5)
        heard_s, values = self._joint_values
        if values and time.monotonic() - heard_s <= STALE_S:
            frame["J"] = numbers(values, 5)
        return frame

    def _in_frame(self, wrench: np.ndarray, runs: bool) -> np.ndarray:
        """Turn a wrench from the sensor's platform axes to those in which the load is given.

        Args:
            wrench: (6,) about the platform's origin, platform axes [N, N m].
            runs: whether a programme runs: then in its frame; base axes otherwise.
        """
        pose = None if self._pose.record is None else read_pose(self._pose.record["pose"])
        if self._pose.record is not None and pose is None:
            return np.full(6, np.nan)
        turned = wrench if pose is None else (wrench.reshape(2, 3) @ pose[1].T).ravel()
        if not runs:
            return turned
        if pose is not None and self._program.frame is not None:
            turned = self._frames.from_base(self._program.frame_name, turned, *pose)
        told = self._told.record if self._told.frame_name == self._program.frame_name else None
        self._errors.know(None if told is None else told["uncertainty"])
        self._errors.measure(1e-9 * self._wrench.stamp_ns, turned)
        self._errors.command(1e-9 * self._program.stamp_ns, self._program.record["command"])
        return turned

    def _hear_modes(self) -> None:
        for message in self._modes.take():
            if not self._filter.admits(message):
                continue
            self._mode_s = time.monotonic()
            mode = OperatingMode(message.mode)
            entry = Entry(
                mode,
                Cause(message.cause),
                told(message.reason),
                fault_name(message.fault, mode == OperatingMode.FAULT),
                int(message.zeroing),
            )
            if entry == self._mode:
                continue
            self._mode = entry
            level = FAULT if mode == OperatingMode.FAULT else NOTICE
            if entry.cause == Cause.UNATTENDED:
                level = WARNING
            self._latest.tell(level, "supervisor", f"mode {mode.name}: {entry.reason}")
            self._tell_mode()

    def _hear_status(self, message: LoopStatus) -> None:
        now_s, name = time.monotonic(), told(message.node, NAME_SIZE)
        report = LoopReport(
            node=name,
            state=int(message.state),
            reason=told(message.reason),
            cycles=int(message.cycles),
            lost=int(message.lost),
            late=int(message.late),
            infeasible=int(message.infeasible),
            work_s=(float(message.work_time), float(message.work_time_p99)),
            round_trip_s=(float(message.round_trip), float(message.round_trip_p99)),
            received_s=now_s,
            heard_s=now_s,
            fault=fault_name(message.fault, message.state == LoopStatus.FAULT),
        )
        before = self._reports.get(name)
        changed = before is None or before.health != report.health
        if changed and report.fault is not None:
            level = FAULT if report.state == LoopStatus.FAULT else WARNING
            self._latest.tell(level, name, report.reason)
        elif changed and before is not None and before.fault is not None:
            self._latest.tell(INFO, name, "cleared")
        make_room(self._reports, name)
        self._reports[name] = report.after(before)

    def _hear_diagnostics(self, message: DiagnosticArray) -> None:
        """Every node's sign of life; loop_status has the numbers."""
        now_s = time.monotonic()
        for status in message.status:
            owner, _, task = status.name.partition(": ")
            space, _, node = owner.rpartition("/")
            node = told(node, NAME_SIZE)
            if space != self._namespace or not (node and task):
                continue  # of another rig, or of no rig
            known = self._reports.get(node)
            make_room(self._reports, node)
            self._reports[node] = (
                known.heard(now_s)
                if known is not None
                else first_report(node, LEVELS.get(status.level, 0), "", now_s)
            )

    def _hear_rare(self) -> None:
        for message in self._measured.take():
            self._beam = Measured(
                int(message.reflector), bool(message.success), told(message.reason), message.rms
            )
            name = reflector_name(message.reflector)
            if message.success:
                p = message.position
                text = f"{name} at {p.x:.5f}, {p.y:.5f}, {p.z:.5f} m in the tracker's frame"
                self._latest.tell(NOTICE, "tracker", text)
            else:
                self._latest.tell(WARNING, "tracker", f"{name}: {told(message.reason)}")
        for message in self._estimates.take():
            self._latest.put_state(
                estimate=estimate_rows(
                    message.stiffness,
                    message.standard_deviation,
                    message.identifiable,
                    int(message.loads),
                    float(message.relative_deviation_max),
                )
            )
        for message in self._campaigns.take():
            self._latest.put_state(campaign=_campaign(message))
        for message in self._recordings.take():
            self._latest.put_state(recording=told(message.data, PATH_SIZE))
        for message in self._spoken.take():
            loud = message.level >= LOUD and message.name.startswith(self._loggers)
            if loud and not message.name.endswith(self._own):
                level = FAULT if message.level > LOUD else WARNING
                name = told(message.name.rpartition(".")[2], NAME_SIZE)
                self._latest.tell(level, name, told(message.msg))

    def _tell_mode(self) -> None:
        """Tell the mode, and what load remains where nothing moves: also of a silent bridge."""
        if self._mode is None:
            self._latest.put_state(mode=mode_view(None, ""))
            return
        held = ""
        state, wrench = self._state.record, self._wrench.record
        if state is not None:
            force = np.nan if wrench is None else float(np.linalg.norm(wrench["wrench"][:3]))
            flags = (state[name].astype(np.bool_) for name in ("zeroed", "switch_closed"))
            held = held_text(state["tension"], *flags, force)
        self._latest.put_state(
            mode=mode_view(int(self._mode.mode), self._mode.reason, held, self._hangs)
        )

    def _tell_health(self) -> None:
        now_s = time.monotonic()
        if self._mode is None or now_s - self._mode_s > 2.0 * STALE_S:
            self._mode = None
        self._tell_mode()
        self._latest.put_state(
            loops=loop_rows(self._reports, now_s),
            devices=device_rows(self._reports, self._beam, now_s),
            error=self._errors.text(),
        )


def _campaign(message: CampaignStatus) -> dict[str, Any]:
    return campaign_view(
        bool(message.active),
        bool(message.paused),
        told(message.phase),
        (int(message.done), int(message.skipped), int(message.total)),
        (int(message.configuration), int(message.reflector), int(message.load)),
        float(message.remaining),
        told(message.note),
    )


def _bits(flags: np.ndarray) -> int:
    """Flags as one number, the first one lowest."""
    return sum(1 << i for i, flag in enumerate(flags) if flag)
