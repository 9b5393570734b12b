# SPDX-License-Identifier: Apache-2.0
"""Node: the ABB robot and the laser tracker as topics and actions."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from cabols_msgs.action import FollowPath, MeasureReflector, MoveToConfiguration
from cabols_msgs.msg import ReflectorMeasurement
from rclpy.serialization import serialize_message

from cabols_control.checks import FloatArray
from cabols_control.result_code import ResultCode
from cabols_control.ros.node import ControlNode, run_node
from cabols_control.ros.parameters import declare, declare_row
from cabols_control.ros.refusal import Refusal, serve
from cabols_control.ros.stops import PRESSED, StopLatch
from cabols_control.ros.threads.pause import pause
from cabols_control.supervision.modes import MOVING, OperatingMode
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.abb.errors import MoveAbortedError, RobotError
from cabols_hw.abb.robot import AbbRobot
from cabols_hw.bringup_nodes import NODES as HW_NODES
from cabols_hw.ros.path_follower import PathFollower
from cabols_hw.ros.robot_access import open_robot
from cabols_hw.ros.robot_stream import MOTORS_OFF, BaseFrame, RobotStream
from cabols_hw.ros.robot_watch import RobotWatch
from cabols_hw.ros.tracker_messages import measurement_message, status_notes, warm_up_note
from cabols_hw.ros.worker import Worker
from cabols_hw.tracker.client import TrackerClient
from cabols_hw.tracker.config import load_tracker_config

MAY_MOVE = (OperatingMode.STOPPED, OperatingMode.FREE_MOVING)
FEEDBACK_S = 0.05
END_S = 0.8
MOVES = Refusal(ResultCode.BUSY, "a motion is under way")
AIM_SHARE = 0.1
"""Share of a measured offset of the tracker that the next aim takes over."""


class AbbTrackerBridge(ControlNode):
    """Publishes the robot's stream, moves the robot, and commands the tracker.

    platform_pose is EGM's Cartesian feedback of the RAPID program's tool, whose frame is the
    platform's; it comes from the encoders and does not contain the joints' deflection.
    """

    role_topic = "live/joint_states"

    def __init__(self) -> None:
        """Open the robot's stream; advertise topics and actions.

        Raises:
            ConfigError, RobotError: if a file or the port cannot be used.
        """
        super().__init__("abb_tracker_bridge")
        speed = self._declare_robot()
        self._tracker_address = declare_row(self, HW_NODES.argument("tracker_address"))
        if self._tracker_address:
            self.hardware += f", laser tracker at {self._tracker_address}"
        tracker = load_tracker_config(
            self.rig_folder,
            declare_row(self, HW_NODES.argument("tracker_file")),
        )
        self._tracker_config = replace(tracker, time_stretch=tracker.time_stretch / speed)
        self._tracker_frame = declare(self, "tracker_frame", "tracker", "frame of measurements")
        self._tracker: Any = None
        self._aim_offset = np.zeros(3)
        self._measured = self.advertise("reflector_measurement")
        self._ending = False
        self._motion: Worker | PathFollower | None = None
        self._measurement: Worker | None = None
        self._servers = [
            serve(self, MoveToConfiguration, "move_to_configuration", self._judge_move, self._move),
            serve(self, FollowPath, "follow_path", self._judge_path, self._follow_path),
            serve(self, MeasureReflector, "measure_reflector", self._judge_measure, self._measure),
        ]

    def _declare_robot(self) -> float:
        """Open the robot's stream; return the speed of the controller's clock."""
        address = declare_row(self, HW_NODES.argument("robot_address"))
        self._timeout_s = declare(self, "move_timeout", 60.0, "s, for one motion", (0.1, 3600.0))
        self._configurations = load_configurations(
            self.rig_folder,
            declare_row(self, HW_NODES.argument("robot_configurations_file")),
        )
        speed = declare_row(self, HW_NODES.argument("speed"))
        stale = declare_row(self, HW_NODES.argument("stale_after"))
        self._robot, source = open_robot(self, address, speed, stale)
        maker = self.get_parameter("robot_maker").value
        self.hardware = f"{maker} robot at {address}"
        base = BaseFrame(
            declare_row(self, HW_NODES.argument("robot_position")),
            declare_row(self, HW_NODES.argument("robot_rotation_xyz_deg")),
        )
        robot_clock = declare(
            self, "robot_clock", False, "stamps are the controller's time: simulation only"
        )
        self._stream = RobotStream(self, source, base, stale, robot_clock)
        self._stream.on_fault = lambda: Worker(self._halt)
        self._stops = self._stream.stops = StopLatch(self, lambda: Worker(self._halt))
        self._robot_clock = robot_clock
        self._path = PathFollower(self, self._robot, self._configurations, self._obstacle)
        self._path.mode = lambda: self._stream.mode
        # UR's own watchdog hears the beats that come with each command.
        watched = isinstance(self._robot, AbbRobot)
        self._watch = RobotWatch(self, address, speed, self._configurations, watched)
        self._stream.on_mode = self._watch.hear_mode
        self._watch.joints = self._newest_joints
        return speed

    def begin(self) -> None:
        """Start publishing."""
        super().begin()
        self._watch.start()
        self._stream.start()

    def end(self) -> None:
        """Stop a motion under way, then everything."""
        self._ending = True
        if self._motion is not None:
            self._motion.join(END_S)
        self._watch.stop()
        self._stream.stop()
        self._robot.close()
        for server in self._servers:
            server.destroy()

    def end_asked(self) -> None:
        """Ask for unloading; the robot stops, its pose still comes."""
        self.announce_end()
        self._ending = True

    def may_end(self) -> bool:
        """Not under load, which needs the pose, and not before the robot's motion has ended."""
        mode = self._stream.mode
        if self.lockstep or self._stream.stale:
            return True
        return (mode is None or mode not in MOVING) and self._motion is None

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended the stream."""
        return self._stream.failure

    def _halt(self) -> None:
        """Stop a motion that another client may have begun; this node's own ends by itself."""
        if self._motion is not None:
            return
        try:
            self._robot.stop()
        except RobotError as error:
            self.get_logger().error(f"in FAULT: {error}")

    def _joints(self) -> list[float]:
        newest = self._newest_joints()
        return [] if newest is None else newest.tolist()

    def _newest_joints(self) -> FloatArray | None:
        newest = self._stream.newest
        return None if newest is None else newest.joints

    def _forbidden(self) -> str:
        """Why the robot may not move in this mode; empty if it may."""
        if self._stops.number:
            return f"{PRESSED}: call reset"
        present = self._stream.mode
        if present is None:
            return "no mode received: is the supervisor running?"
        if present not in MAY_MOVE:
            allowed = " or ".join(mode.name for mode in MAY_MOVE)
            return f"the mode is {present.name}, expected {allowed}"
        return self._watch.held()

    def _judge_move(self, request: Any) -> Refusal | None:
        if self._motion is not None:
            return MOVES
        if not request.index < len(self._configurations):
            last = len(self._configurations) - 1
            reason = f"expected an index from 0 to {last}, got {request.index}"
            return Refusal(ResultCode.BAD_REQUEST, reason)
        if unwatched := self._watch.unwatched():
            return Refusal(ResultCode.NOT_READY, unwatched)
        forbidden = self._forbidden()
        return Refusal(self._code_of_mode(), forbidden) if forbidden else None

    def _code_of_mode(self) -> ResultCode:
        """Code of a refusal that the mode, or a stop, causes."""
        if self._stops.number or self._stream.mode == OperatingMode.FAULT:
            return ResultCode.FAULT_LATCHED
        return ResultCode.NOT_READY if self._stream.mode is None else ResultCode.WRONG_MODE

    async def _move(self, handle: Any) -> Any:
        if self._motion is not None:
            handle.abort()
            return MoveToConfiguration.Result(
                message="a motion is under way", code=int(ResultCode.BUSY)
            )
        code, began_in = ResultCode.UNKNOWN, self._stream.mode

        def interrupted() -> str:
            nonlocal code
            if handle.is_cancel_requested and not self._ending:
                code = ResultCode.CANCELLED
                return "cancelled"
            reason = "the node ends" if self._ending else self._forbidden()
            if not reason and self._stream.mode != began_in == OperatingMode.FREE_MOVING:
                reason = "the cables follow no longer: FREE_MOVING was left"
            code = ResultCode.INTERRUPTED if reason else code
            return reason

        worker = self._motion = Worker(lambda: self._drive(handle.request.index, interrupted))
        began = time.monotonic()
        while worker.busy:
            handle.publish_feedback(
                MoveToConfiguration.Feedback(
                    elapsed=time.monotonic() - began, joints=self._joints()
                )
            )
            await pause(self, FEEDBACK_S)
        self._motion = None
        self._finish(handle, worker)
        return MoveToConfiguration.Result(
            success=worker.failure is None,
            message=str(worker.failure or "done"),
            joints=self._joints(),
            code=int(_code_of(worker.failure, code)),
        )

    def _obstacle(self) -> str:
        """Why the robot may not move in any mode; empty if it may."""
        if self._stops.number:
            return f"{PRESSED}: call reset"
        return self._watch.unwatched()

    def _judge_path(self, request: Any) -> Refusal | None:
        if self._motion is not None:
            return MOVES
        return self._path.judge(request, self._code_of_mode())

    async def _follow_path(self, handle: Any) -> Any:
        if self._motion is not None:
            handle.abort()
            busy = int(ResultCode.BUSY)
            return FollowPath.Result(message="a motion is under way", code=busy)
        self._motion = self._path
        try:
            result = await self._path.execute(handle, lambda: self._ending, self._timeout_s)
        finally:
            self._motion = None
        result.joints = self._joints()
        return result

    def _drive(self, index: int, interrupted: Callable[[], str]) -> None:
        self._robot.move(index, self._timeout_s, interrupted, poll_s=0.05)

    def _finish(self, handle: Any, worker: Worker) -> None:
        """End a goal as its worker ended."""
        if worker.failure is None:
            handle.succeed()
            return
        self.get_logger().error(str(worker.failure))
        if handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()

    def _judge_measure(self, request: Any) -> Refusal | None:
        del request
        if self._measurement is not None:
            return Refusal(ResultCode.BUSY, "a measurement is under way")
        if not self._tracker_address:
            return Refusal(ResultCode.NOT_READY, "no tracker: set tracker_address")
        newest = self._stream.newest
        if newest is not None and not newest.motors_on:
            return Refusal(ResultCode.FAULT_REPORTED, MOTORS_OFF.reason)
        return None

    async def _measure(self, handle: Any) -> Any:
        if self._measurement is not None:
            handle.abort()
            code = int(ResultCode.BUSY)
            return MeasureReflector.Result(message="a measurement is under way", code=code)
        request = handle.request
        worker = self._measurement = Worker(lambda: self._ask_tracker(request))
        began = time.monotonic()
        while worker.busy:
            handle.publish_feedback(
                MeasureReflector.Feedback(phase="measuring", elapsed=time.monotonic() - began)
            )
            await pause(self, FEEDBACK_S)
        self._measurement = None
        message = self._measurement_message(request, worker)
        if worker.failure is None and not message.success:
            worker.failure = RobotError(f"tracker: {message.reason}")
        self._measured.publish(serialize_message(message))
        self._finish(handle, worker)
        return MeasureReflector.Result(
            success=bool(message.success),
            message=message.reason or "done",
            measurement=message,
            code=int(ResultCode.DONE if message.success else ResultCode.FAILED),
        )

    def _ask_tracker(self, request: Any) -> Any:
        if self._tracker is None:
            self._tracker = TrackerClient(
                self._tracker_address,
                self._tracker_config,
                lambda i: self._nominal(i) + self._aim_offset,
            )
        reading = self._tracker.measure(
            int(request.reflector), float(request.averaging_time), bool(request.search)
        )
        self._note_status(self._tracker.newest_status)
        if reading.success:
            self._learn(int(request.reflector), reading.position)
        return reading

    def _note_status(self, status: Any) -> None:
        """Note the tracker's warm-up beside the measurements, in what is recorded."""
        if status is not None:
            self._stream.notes = status_notes(status)
            self._stream.note = warm_up_note(status)

    def _nominal(self, reflector: int) -> np.ndarray:
        return self._tracker_config.expected(reflector, *self._stream.platform())

    def _learn(self, reflector: int, position: np.ndarray) -> None:
        """Correct the next aim: the tracker stands some millimetres beside its nominal place.

        The correction is slow, as the loaded robot deflects in all directions.
        """
        offset = position - self._nominal(reflector)
        share = AIM_SHARE if self._aim_offset.any() else 1.0
        if np.linalg.norm(offset) <= self._tracker_config.search_radius:
            self._aim_offset = self._aim_offset + share * (offset - self._aim_offset)

    def _measurement_message(self, request: Any, worker: Worker) -> ReflectorMeasurement:
        reading = worker.result
        middle_ns = self._stream.now_ns()
        if reading is not None and reading.success:
            middle_ns = reading.time_ns if self._robot_clock else reading.middle_ns
        return measurement_message(request, reading, worker.failure, middle_ns, self._tracker_frame)


def _code_of(failure: Exception | None, interruption: ResultCode) -> ResultCode:
    """How a motion ended: by an interruption, if there was one; by its time-out; by the robot."""
    if failure is None:
        return ResultCode.DONE
    if not isinstance(failure, MoveAbortedError):
        return ResultCode.FAILED
    return interruption or ResultCode.TIMED_OUT


def main() -> int:
    """Entry point."""
    return run_node(AbbTrackerBridge)


if __name__ == "__main__":
    sys.exit(main())
