# SPDX-License-Identifier: Apache-2.0
"""Action follow_path: leads the loaded robot along a path, at speeds that its stop allows."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from cabols_msgs.action import FollowPath

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_control.result_code import ResultCode
from cabols_control.ros.live import live_name
from cabols_control.ros.loop import Input
from cabols_control.ros.messages import topics
from cabols_control.ros.node import ControlNode
from cabols_control.ros.refusal import Refusal
from cabols_control.ros.threads.pause import pause
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.abb.configurations import RobotConfigurations
from cabols_hw.abb.errors import MoveAbortedError
from cabols_hw.abb.path import path_points
from cabols_hw.abb.speed_limit import allowed_speed
from cabols_hw.card.config import load_card
from cabols_hw.robot.interface import Leg, Robot
from cabols_hw.ros.worker import Worker
from cabols_hw.safety.config import load_safety

MAY_FOLLOW = (OperatingMode.LOADING, OperatingMode.FREE_MOVING)
REPEAT_S = 0.05
"""Between two announcements of a path, and two looks at what may interrupt it [s]."""
STATE_AGE_S = 1.0
"""Largest age of the tensions by which a speed is judged [s]."""
SLOWEST = 0.001
"""m/s"""


class PathFollower:
    """Judges and executes paths, one at a time; announces each while it lasts.

    Attributes:
        worker: what moves the robot now; None: nothing.
        point: number of the newest point that was reached, from 0.
    """

    def __init__(
        self,
        node: ControlNode,
        robot: Robot,
        configurations: RobotConfigurations,
        obstacle: Callable[[], str],
    ) -> None:
        """Prepare.

        Args:
            node: of the robot's bridge.
            robot: that is led.
            configurations: stored ones.
            obstacle: why the robot may not move now, whatever the mode; empty if it may.
        """
        self._node, self._robot, self._configurations = node, robot, configurations
        self._obstacle = obstacle
        self._safety, self._card = load_safety(node.rig_folder), load_card(node.rig_folder)
        geometry = node.rig.geometry
        self._record = topics.path_motion_layout(geometry).record()
        self._output = node.advertise("path_motion")
        self._epoch_ns = time.time_ns() - time.monotonic_ns()
        self._states = Input(node, live_name("limb_state"), topics.limb_state_layout(geometry))
        self.mode: Callable[[], OperatingMode | None] = lambda: None
        self.worker: Worker | None = None
        self.point = 0

    def judge(self, request: Any, code: ResultCode) -> Refusal | None:
        """Why a path is refused; None if it is not.

        Args:
            request: goal of FollowPath.
            code: of a refusal that the mode causes.
        """
        if self.worker is not None:
            return Refusal(ResultCode.BUSY, "a path is being followed")
        try:
            self._points(request)
        except CabolsError as error:
            return Refusal(ResultCode.BAD_REQUEST, str(error))
        wrong = ""
        if not SLOWEST <= request.speed < np.inf:
            wrong = f"expected a speed of at least {SLOWEST:g} m/s, got {request.speed:g} m/s"
        if not 0.0 <= request.rotation_speed < np.inf:
            wrong = f"expected no negative rotation_speed, got {request.rotation_speed:g} rad/s"
        if wrong:
            return Refusal(ResultCode.BAD_REQUEST, wrong)
        forbidden = self._forbidden(request.speed, self._turning(request))
        if not forbidden:
            return None
        by_mode = self.mode() not in MAY_FOLLOW
        return Refusal(code if by_mode else ResultCode.INFEASIBLE, forbidden)

    def _points(self, request: Any) -> FloatArray:
        folder = self._node.rig_folder.path
        return path_points(self._configurations, request.index, request.path_file, folder)

    def _turning(self, request: Any) -> float:
        return float(request.rotation_speed) or self._safety.path_speeds[1]

    def _forbidden(self, speed: float, turning: float) -> str:
        """Why the robot may not move at these speeds now [m/s], [rad/s]; empty if it may."""
        mode = self.mode()
        if mode not in MAY_FOLLOW:
            allowed = " or ".join(mode.name for mode in MAY_FOLLOW)
            return f"the mode is {'not known' if mode is None else mode.name}, expected {allowed}"
        most, most_turning = self._safety.path_speeds
        if not speed <= most:
            return f"expected at most {1e3 * most:.0f} mm/s (speed_path), got {1e3 * speed:.0f}"
        if not turning <= most_turning:
            return f"expected at most {most_turning:g} rad/s (rotation_speed_path), got {turning:g}"
        return self._obstacle() or self._too_fast(speed)

    def _too_fast(self, speed: float) -> str:
        """Why the robot's stop does not allow a speed [m/s] at the present tensions."""
        self._states.take()
        state, age_ns = self._states.record, time.monotonic_ns() - self._states.received_ns
        if state is None or not (1e-9 * age_ns <= STATE_AGE_S or self._node.lockstep):
            return "no limb_state arrives: is the rig's bridge running?"
        tension = np.array(state["tension"])
        if not np.isfinite(tension).all():
            return "the limbs are not pre-tightened"
        safety, rig = self._safety, self._node.rig
        allowed = allowed_speed(
            rig,
            max(safety.tension_max, float(tension.max())),
            safety.wrench_max,
            self._card.sensor_limits,
            self._configurations.brake,
            tension,
        )
        if speed <= allowed:
            return ""
        return (
            f"at the present tensions the robot's stop allows {1e3 * allowed:.0f} mm/s, got "
            f"{1e3 * speed:.0f}: if the rig dies, the held cables would pull too hard"
        )

    async def execute(self, handle: Any, ending: Callable[[], bool], timeout_s: float) -> Any:
        """Follow a path; the robot stops with the mode, a stop, a fault or a cancel.

        Args:
            handle: of the goal.
            ending: whether the node ends.
            timeout_s: for each point of the path [s].
        """
        request = handle.request
        speed, turning = float(request.speed), self._turning(request)
        code, began_in = ResultCode.UNKNOWN, self.mode()
        points = self._points(request)

        def interrupted() -> str:
            nonlocal code
            if handle.is_cancel_requested and not ending():
                code = ResultCode.CANCELLED
                return "cancelled"
            reason = "the node ends" if ending() else self._forbidden(speed, turning)
            if not reason and self.mode() != began_in:
                reason = "the mode has changed"
            code = ResultCode.INTERRUPTED if reason else code
            return reason

        def lead() -> None:
            for self.point, joints in enumerate(points):
                leg = Leg(joints=joints, speed=speed, rotation_speed=turning)
                self._robot.lead(leg, timeout_s, interrupted, REPEAT_S)

        self.point = 0
        worker = self.worker = Worker(lead)
        began = time.monotonic()
        try:
            while worker.busy:
                # A robot that is being stopped brakes, and needs the announcement until it stands.
                self._announce(True, speed, turning)
                elapsed = time.monotonic() - began
                feedback = FollowPath.Feedback(elapsed=elapsed, point=self.point)
                handle.publish_feedback(feedback)
                await pause(self._node, REPEAT_S)
        finally:
            self.worker = None
            self._announce(False, 0.0, 0.0)
        failure = worker.failure
        if failure is None:
            handle.succeed()
            code = ResultCode.DONE
        else:
            self._node.get_logger().error(f"follow_path: {failure}")
            aborted = isinstance(failure, MoveAbortedError)
            code = (code or ResultCode.TIMED_OUT) if aborted else ResultCode.FAILED
            (handle.canceled if handle.is_cancel_requested else handle.abort)()
        message = "done" if failure is None else str(failure)
        return FollowPath.Result(success=failure is None, message=message, code=int(code))

    def join(self, timeout_s: float) -> None:
        """Wait for the end of what moves the robot.

        Args:
            timeout_s: longest wait [s].
        """
        if self.worker is not None:
            self.worker.join(timeout_s)

    def _announce(self, active: bool, speed: float, turning: float) -> None:
        record = self._record
        # The bridge takes no announcement that is older than one before: not the computer's clock,
        # which somebody may set.
        record.stamp(self._epoch_ns + time.monotonic_ns())
        record["active"][0] = active
        record["speed"][0], record["rotation_speed"][0] = speed, turning
        record["session"][0] = self._node.status.sessions.session
        self._output.publish(record.raw())
