# SPDX-License-Identifier: Apache-2.0
"""Node: publishes a load programme's wrenches; action run_program, service check_program."""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
from cabols_msgs.action import RunProgram
from cabols_msgs.srv import CheckProgram, SetMode

from cabols_control.bringup_nodes import NODES as CONTROL_NODES
from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_control.frames import load_wrench_frames
from cabols_control.load_programs.feasibility import ProgramCheck, check_shaped
from cabols_control.load_programs.learning import is_same_place
from cabols_control.load_programs.motor_demand import fastest_preview
from cabols_control.load_programs.preview import ShapedProgram, as_given, check_length
from cabols_control.load_programs.programs import load_program
from cabols_control.realtime.scheduling import be_ordinary
from cabols_control.result_code import ResultCode
from cabols_control.ros.live import live_name
from cabols_control.ros.loop import ControlLoop, Input
from cabols_control.ros.messages import topics
from cabols_control.ros.node import RUNNING, ControlNode, run_node
from cabols_control.ros.parameters import declare, declare_row
from cabols_control.ros.refusal import Refusal, serve
from cabols_control.ros.sessions import ModeInput
from cabols_control.ros.taught_runs import TaughtRuns
from cabols_control.ros.threads.pause import pause
from cabols_control.ros.threads.ticker import Ticker
from cabols_control.rotations import read_pose
from cabols_control.supervision.modes import OperatingMode
from cabols_control.wrench_control.frames import place_frame, wrench_from_base

Place = tuple[FloatArray, FloatArray]
FEEDBACK_S = 0.2
STOP_S = 8.0
"""Longest time from the programme's end to STOPPED [s]."""
POSE_AGE_S = 1.0
"""Largest age of the pose at which a programme is checked [s]."""


class NoPoseError(CabolsError):
    """No platform_pose arrives: a programme cannot be checked."""


class LoadProgramNode(ControlNode):
    """Runs one programme at a time, only in LOADING; leaving LOADING ends it.

    In real time it publishes at its own rate; the wrench controller holds each value, and unloads
    by itself when they stop. In lockstep this node answers every wrench.
    """

    starts_harmlessly = True

    def __init__(self) -> None:
        """Subscribe to mode (and to wrench, in lockstep); advertise desired_wrench."""
        super().__init__("load_program")
        name = declare_row(self, CONTROL_NODES.argument("program"))
        scale = declare_row(self, CONTROL_NODES.argument("scale"))
        self._exit_when_done = declare_row(self, CONTROL_NODES.argument("exit_when_done"))
        self._preview = declare_row(self, CONTROL_NODES.argument("preview"))
        rate = declare(self, "rate", 250.0, "Hz, of desired_wrench in real time", (1.0, 1000.0))
        self._held_s = 0.0 if self.paced else 1.0 / rate
        self._epoch_ns = time.time_ns() - time.monotonic_ns()
        learns = declare_row(self, CONTROL_NODES.argument("learn"))
        self._taught = TaughtRuns(self, self._held_s) if learns and self._preview else None
        geometry = self.rig.geometry
        self._frames = load_wrench_frames(geometry, self.rig_folder)
        self._reference: Place = (geometry.reference_position, geometry.reference_rotation)
        self._first_asked = (name, scale)
        self._first = self._shape(name, scale, self._reference) if name else None
        self._records = {
            frame: topics.wrench_layout(frame).record() for frame in self._frames.names
        }
        self._frame, self._placed = geometry.base_frame, None
        self._moved = np.zeros(6)
        self._output = self.advertise("desired_wrench")
        self._asked = {
            frame: topics.program_wrench_layout(frame).record() for frame in self._frames.names
        }
        self._told = self.advertise_live("program_wrench")
        self._mode = ModeInput(self, self.status.sessions, self.lockstep)
        # The slow copy: nothing here needs the pose at the control rate.
        poses = topics.pose_layout(self.rig.geometry)
        self._pose = Input(self, live_name("platform_pose"), poses)
        place = self._reference
        check_shaped(self.rig, self._shape("ramps", 1.0, place), *place)  # compile now
        self._lock = threading.Lock()
        self._running: ShapedProgram | None = None
        self._began_s = 0.0
        self._now_s = 0.0
        self._verdict = ""
        self._code = ResultCode.UNKNOWN
        self.done = False
        self._stopper = self.create_client(SetMode, "set_mode")
        self._asked_s: float | None = None
        self._loop: ControlLoop | Ticker
        if self.paced:
            layout = topics.wrench_layout(self.rig.geometry.platform_frame)
            self._wrench = Input(self, "wrench", layout, self.lockstep)
            self._loop = ControlLoop(self, self._wrench, [self._mode], self._answer, True)
            self._loop.prepare = self.prepare_thread
        else:
            if self._taught is not None:
                platform = topics.wrench_layout(self.rig.geometry.platform_frame)
                self._wrench = Input(self, "wrench", platform)
            self._loop = Ticker(self.context, 1.0 / rate, self._tick)
        self.create_service(CheckProgram, "check_program", self._check)
        self._server = serve(self, RunProgram, "run_program", self._judge, self._execute)

    def _shape(self, name: str, scale: float, place: Place, frame: str = "") -> ShapedProgram:
        """Load a programme as it is followed at a pose, about the platform's origin, base axes.

        Raises:
            CabolsError: if it cannot be used.
        """
        # Ten minutes of a programme take a second to shape: not before the supervisor, which then
        # would be silent for too long.
        be_ordinary()
        program = asked = load_program(name).scaled(scale or 1.0)
        if frame:
            # Linear, so that smoothing and preview are the same in every frame.
            program = replace(program, wrench=self._frames.to_base(frame, program.wrench, *place))
        if not self._preview:
            return as_given(program)
        shaped = fastest_preview(program, self.rig, *place, self._held_s)
        if self._taught is None:
            return shaped
        definition = self._frames.record(frame).tobytes() if frame else b""
        return self._taught.apply(shaped, place, (asked, definition))

    def begin(self) -> None:
        """Start publishing."""
        self._loop.start()
        super().begin()

    def end(self) -> None:
        """Stop the loop and the action."""
        self._running = None
        self._loop.stop()
        self._server.destroy()

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended the loop or the programme."""
        if self._loop.failure is not None:
            return self._loop.failure
        if self._exit_when_done and self._verdict:
            return RuntimeError(self._verdict)
        return None

    def _tick(self) -> None:
        # Not the computer's clock: a programme must not jump when somebody sets it.
        now_ns = self._epoch_ns + time.monotonic_ns()
        self._mode.take()
        with self._lock:
            self._advance(1e-9 * now_ns)
            if self._running is not None:
                self._publish(now_ns)
                if self._taught is not None:
                    self._wrench.take()
                    self._taught.note(self._began_s, self._now_s, self._wrench)
        self._end_if_asked()

    def _answer(self) -> None:
        stamp_ns = self._wrench.stamp_ns
        with self._lock:
            self._advance(1e-9 * stamp_ns)
            self._publish(stamp_ns)
            if self._taught is not None and self._running is not None:
                self._taught.note(self._began_s, self._now_s, self._wrench)
        self.status.cycle(stamp_ns, RUNNING)
        self._end_if_asked()

    def _end_if_asked(self) -> None:
        """After the programme request STOPPED; end when it is reached, or after a second."""
        if not self._exit_when_done:
            return
        if self._in_fault():
            self.context.try_shutdown()
        elif self.done and self._asked_s is None:
            self._asked_s = time.monotonic()
            self._stopper.call_async(SetMode.Request(mode=int(OperatingMode.STOPPED)))
        elif self.done and (self._stopped() or time.monotonic() - self._asked_s > STOP_S):
            self.context.try_shutdown()

    def _loading(self) -> bool:
        record = self._mode.record
        return record is not None and int(record["mode"]) == OperatingMode.LOADING

    def _stopped(self) -> bool:
        record = self._mode.record
        return record is not None and int(record["mode"]) == OperatingMode.STOPPED

    def _in_fault(self) -> bool:
        """Whether the rig has stopped, so that the programme cannot be completed."""
        record = self._mode.record
        if record is None or int(record["mode"]) != OperatingMode.FAULT:
            return False
        reason = self._mode.strings()["reason"]
        self._verdict = self._verdict or f"the rig is in FAULT: {reason}"
        return True

    def _advance(self, now_s: float) -> None:
        """Begin or end a programme."""
        self._now_s = now_s
        if self._first is not None and self._loading():
            self._start(self._first_here(self._first))
            self._first = None
        if self._running is None:
            return
        if not self._loading():
            self._finish("interrupted: the mode is no longer LOADING", ResultCode.INTERRUPTED)
        elif now_s - self._began_s > self._running.duration:
            self._finish("", ResultCode.DONE)

    def _place(self, name: str, place: Place) -> None:
        """Publish the next programme's wrenches in a frame; empty: the rig's base frame."""
        self._frame, self._placed = name or self._frames.names[0], None
        if self._frame != self._frames.names[0]:
            self._placed = self._frames.record(self._frame)
            place_frame(self._placed, *(np.array(part) for part in place))

    def _first_here(self, program: ShapedProgram) -> ShapedProgram:
        """Shape the programme of the start again if the platform is not where the drawing has it.

        What is learnt belongs to a pose, and measured wrenches are turned by it.
        """
        if self._taught is None:
            return program
        try:
            place = self._pose_now()
        except CabolsError:
            return program
        if is_same_place(place, self._reference):
            return program
        return self._shape(*self._first_asked, place)

    def _start(self, program: ShapedProgram) -> None:
        self._running, self._began_s, self._verdict = program, self._now_s, ""
        if self._taught is not None:
            self._taught.begin(program)
        self.get_logger().info(f"programme {program.name}: {program.duration:g} s")

    def _finish(self, verdict: str, code: ResultCode) -> None:
        if self._taught is not None and code == ResultCode.DONE:
            # Before anybody hears of the end: the next run may begin at once, and aims by it.
            self._taught.finish()
        self._running, self._verdict, self.done = None, verdict, True
        self._frame, self._placed = self._frames.names[0], None
        self._code = code
        self.get_logger().info(verdict or "programme done")

    def _publish(self, stamp_ns: int) -> None:
        program, time_s = self._running, self._now_s - self._began_s
        wanted, asked = self._records[self._frame], self._asked[self._frame]
        wanted.stamp(stamp_ns)
        asked.stamp(stamp_ns)
        if program is None:
            wanted["wrench"][:] = asked["command"][:] = asked["smoothed"][:] = 0.0
            asked["lead"][0] = 0.0
        else:
            self._fill(wanted["wrench"], program.reference.at(time_s))
            self._fill(asked["command"], program.command.at(time_s - program.lead))
            self._fill(asked["smoothed"], program.smoothed.at(time_s))
            asked["lead"][0] = program.lead
        self._output.publish(wanted.raw())
        self._told.publish(asked.raw())
        self._told.copy()

    def _fill(self, field: FloatArray, wrench: FloatArray) -> None:
        """Fill a field (6,) of a message in the programme's frame of a wrench (6,) in base axes."""
        if self._placed is None:
            field[:] = wrench
        else:
            # In its own frame again: the wrench controller takes it along with the platform.
            wrench_from_base(self._placed, np.array(wrench), self._moved)
            field[:] = self._moved

    def _check_here(self, name: str, scale: float, frame: str) -> ProgramCheck:
        """Check a programme at the platform's present pose.

        Raises:
            CabolsError: if the programme cannot be used, or no pose arrives.
        """
        load_program(name)
        place = self._pose_now()
        return check_shaped(self.rig, self._shape(name, scale, place, frame), *place)

    def _pose_now(self) -> Place:
        """Platform's present position and rotation.

        Raises:
            NoPoseError: if no pose arrives.
            CabolsError: if it is none.
        """
        self._pose.take()
        record, age_ns = self._pose.record, time.monotonic_ns() - self._pose.received_ns
        if record is None or not 1e-9 * age_ns <= POSE_AGE_S:
            raise NoPoseError("no platform_pose arrives: is the robot's bridge running?")
        pose = read_pose(np.array(record["pose"]))
        if pose is None:
            raise CabolsError(f"platform_pose: expected a pose, got {record['pose']}")
        return pose

    def _check(self, request: Any, response: Any) -> Any:
        try:
            found = self._check_here(request.program, request.scale, request.frame)
        except CabolsError as error:
            refused = isinstance(error, NoPoseError)
            response.code = int(ResultCode.NOT_READY if refused else ResultCode.BAD_REQUEST)
            response.message = str(error)
            return response
        rows = found.preview()
        response.success, response.message = True, found.sentence()
        response.code = int(ResultCode.DONE)
        response.feasible, response.name = found.feasible, found.program.name
        response.duration = found.program.duration
        response.tension_min = float(found.tension.min())
        response.tension_max = float(found.tension.max())
        worst = found.worst
        response.worst_time = float("nan") if worst is None else float(found.program.time[worst])
        response.time = found.program.time[rows].tolist()
        response.wrench = found.program.wrench[rows].ravel().tolist()
        response.tension = found.tension[rows].ravel().tolist()
        return response

    def _judge(self, request: Any) -> Refusal | None:
        try:
            program = load_program(request.program).scaled(request.scale or 1.0)
            if self._preview:
                check_length(program)
            self._frames.record(request.frame)
            found = (
                self._check_here(request.program, request.scale, request.frame)
                if request.checked
                else None
            )
        except NoPoseError as error:
            return Refusal(ResultCode.NOT_READY, str(error))
        except CabolsError as error:
            return Refusal(ResultCode.BAD_REQUEST, str(error))
        if found is not None and not found.feasible:
            return Refusal(ResultCode.INFEASIBLE, found.sentence())
        if self._running is not None:
            return Refusal(ResultCode.BUSY, "a programme is running")
        if self._loading():
            return None
        record = self._mode.record
        latched = record is not None and int(record["mode"]) == OperatingMode.FAULT
        code = ResultCode.FAULT_LATCHED if latched else ResultCode.WRONG_MODE
        return Refusal(code, "the mode is not LOADING")

    async def _execute(self, handle: Any) -> Any:
        request = handle.request
        try:
            place = self._pose_now()
        except CabolsError:
            # Without a robot's bridge the platform is where the drawing has it.
            place = self._reference
        program = self._shape(request.program, request.scale, place, request.frame)
        with self._lock:
            self._place(request.frame, place)
            self._start(program)
        feedback = RunProgram.Feedback(duration=program.duration)
        while self._running is program:
            if handle.is_cancel_requested:
                with self._lock:
                    self._finish("cancelled: unloading", ResultCode.CANCELLED)
                handle.canceled()
                return RunProgram.Result(message=self._verdict, code=int(self._code))
            feedback.elapsed = self._now_s - self._began_s
            handle.publish_feedback(feedback)
            await pause(self, FEEDBACK_S)
        done = self._code == ResultCode.DONE
        if done:
            handle.succeed()
        else:
            handle.abort()
        return RunProgram.Result(
            success=done, message=self._verdict or "done", code=int(self._code)
        )


def main() -> int:
    """Entry point."""
    return run_node(LoadProgramNode)


if __name__ == "__main__":
    sys.exit(main())
