# SPDX-License-Identifier: Apache-2.0
"""Action commission_limb of the limb controller: hands programmes over, takes their records."""

from __future__ import annotations

import time
from typing import Any, Protocol

import numpy as np
from cabols_msgs.action import CommissionLimb
from cabols_msgs.srv import SetMode
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.commissioning.first_power_on import PowerOnProgramme, WiringFault, judge_limb
from cabols_control.commissioning.programmes import (
    CommissioningConfig,
    CommissioningError,
    Programme,
    RampProgramme,
)
from cabols_control.commissioning.results import evaluate_ramp, evaluate_step
from cabols_control.commissioning.rig_programmes import make_ramp, make_step
from cabols_control.errors import CabolsError
from cabols_control.kinematics import structure_matrix
from cabols_control.limb_control.controller import LimbController
from cabols_control.naming import limb_names
from cabols_control.result_code import NOT_YET, ResultCode
from cabols_control.rig import Rig
from cabols_control.ros.loop import Input
from cabols_control.ros.messages import topics
from cabols_control.ros.threads.pause import pause
from cabols_control.rotations import read_pose
from cabols_control.supervision.modes import OperatingMode

POLL_S = 0.1
ANSWER_S = 5.0
"""Longest wait for the supervisor's answer and for the mode [s]."""
PRETIGHTENED_S = 30.0
TIGHT_S = 2.0
"""Longest time from this node's knowing that every limb is tight to the supervisor's."""


class LimbNode(Protocol):
    """Interface of the server's node."""

    rig: Rig
    lockstep: bool
    seen_mode: OperatingMode

    def zeroed(self) -> BoolArray:
        """(n,) bool, limbs with a zero of the pre-tightening under way; none in other modes."""


class CommissionServer:
    """Runs one programme at a time; requests the mode from the supervisor and leaves it STOPPED."""

    def __init__(self, node: Any, controller: LimbController) -> None:
        """Advertise the action.

        Args:
            node: LimbNode that is an rclpy node.
            controller: runs the programmes in its cycle.
        """
        self._node = node
        self._controller = controller
        self._busy = False
        self._ramp: RampProgramme | PowerOnProgramme | None = None
        self._wrench: Input | None = None
        self._modes = node.create_client(SetMode, "set_mode")
        self._server = ActionServer(
            node,
            CommissionLimb,
            "commission_limb",
            self._execute,
            # A refusal carries no reason; an aborted goal does.
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=ReentrantCallbackGroup(),
        )

    def close(self) -> None:
        """End the action."""
        self._server.destroy()

    def after_step(self) -> None:
        """Record the wrench of a ramp; called in the control loop after each cycle."""
        ramp, wrench = self._ramp, self._wrench
        if ramp is not None and wrench is not None and wrench.take():
            ramp.take_wrench(1e-9 * wrench.stamp_ns, wrench.record["wrench"])

    async def _execute(self, handle: Any) -> Any:
        request = handle.request
        nan = float("nan")
        result = CommissionLimb.Result(
            gain=nan,
            time_constant=nan,
            fit=nan,
            stiffness=nan,
            stiffness_fit=nan,
            partner=-1,
            backlash=nan,
        )
        if self._busy:
            handle.abort()
            result.message = "another limb is being commissioned: wait for its end"
            result.code = int(ResultCode.BUSY)
            return result
        self._busy = True
        told: list[str] = []
        try:
            config = self._judge(request)
            if request.first_power_on:
                told.append(await self._do_power_on(handle, request.limb, result))
            if request.step:
                told.append(await self._do_step(handle, request.limb, config, result))
            if request.ramp:
                told.append(await self._do_ramp(handle, request.limb, config, result))
            result.success, result.code = True, int(ResultCode.DONE)
        except CommissioningError as error:
            told.append(str(error))
            result.code = int(error.code)
        except CabolsError as error:
            told.append(str(error))
            result.code = int(ResultCode.FAILED)
        finally:
            told += await self._give_back()
            self._busy = False
        result.message = "; ".join(told)
        if result.success:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return result

    def _judge(self, request: Any) -> CommissioningConfig:
        limbs = self._controller.limbs.tolist()
        if request.limb not in limbs:
            raise CommissioningError(
                f"limb: expected one of the indices {limbs} (from 0), got {request.limb}",
                ResultCode.BAD_REQUEST,
            )
        if not (request.step or request.ramp or request.first_power_on):
            reason = "expected step or ramp, or both, got neither"
            raise CommissioningError(reason, ResultCode.BAD_REQUEST)
        if request.first_power_on and (request.step or request.ramp):
            reason = "expected the check at first power-on alone, got step or ramp with it"
            raise CommissioningError(reason, ResultCode.BAD_REQUEST)
        if self._node.seen_mode != OperatingMode.STOPPED:
            raise CommissioningError(
                f"commissioning starts in STOPPED, the mode is {self._node.seen_mode.name}",
                ResultCode.WRONG_MODE,
            )
        try:
            return CommissioningConfig(
                step_current=request.step_current or CommissioningConfig.step_current,
                ramp_tension=request.ramp_tension or CommissioningConfig.ramp_tension,
            )
        except CabolsError as error:
            raise CommissioningError(str(error), ResultCode.BAD_REQUEST) from error

    async def _do_power_on(self, handle: Any, limb: int, result: Any) -> str:
        """Wind one limb a little, and compare what moved and pulled with the configuration."""
        node = self._node
        geometry = node.rig.geometry
        wrenches = topics.wrench_layout(geometry.platform_frame)
        wrench = Input(node, "wrench", wrenches, node.lockstep)
        pose = Input(node, "platform_pose", topics.pose_layout(geometry), node.lockstep)
        programme = PowerOnProgramme(limb, geometry.cables)
        try:
            await self._enter(OperatingMode.COMMISSIONING)
            position, rotation = _pose_of(pose, node.rig)
            self._ramp, self._wrench = programme, wrench
            await self._run(handle, programme)
        finally:
            self._ramp = self._wrench = None
            await pause(node, POLL_S)
            node.destroy_subscription(wrench.subscription)
            node.destroy_subscription(pose.subscription)
        await self._enter(OperatingMode.STOPPED)
        pull = programme.pull
        felt = np.concatenate([rotation @ pull[:3], rotation @ pull[3:]])
        structure = structure_matrix(geometry, position, rotation)
        rated = np.asarray(node.rig.control.rated)
        found = judge_limb(limb, programme.moved, programme.closed, felt, structure, rated)
        result.wiring, result.partner = int(found.fault), found.partner
        if found.fault != WiringFault.NONE:
            raise CommissioningError(found.told(limb), ResultCode.FAILED)
        return found.told(limb)

    async def _do_step(
        self, handle: Any, limb: int, config: CommissioningConfig, result: Any
    ) -> str:
        await self._enter(OperatingMode.COMMISSIONING)
        programme = make_step(self._node.rig, limb, config)
        await self._run(handle, programme)
        # The computation below would compete with the control loop for the interpreter.
        await self._enter(OperatingMode.STOPPED)
        found = evaluate_step(programme.record)
        result.gain, result.time_constant = found.model.gain, found.model.time_constant
        result.fit = found.model.fit
        return (
            f"step: dry friction {found.friction:.4f} A; without it in the model k "
            f"{found.plain.gain:.4f} m/s/A, T {found.plain.time_constant:.4f} s, "
            f"fit {100.0 * found.plain.fit:.2f} %"
        )

    async def _do_ramp(
        self, handle: Any, limb: int, config: CommissioningConfig, result: Any
    ) -> str:
        node = self._node
        geometry = node.rig.geometry
        pose = Input(node, "platform_pose", topics.pose_layout(geometry), node.lockstep)
        wrenches = topics.wrench_layout(geometry.platform_frame)
        wrench = Input(node, "wrench", wrenches, node.lockstep)
        try:
            await self._pretighten(handle)
            place = _pose_of(pose, node.rig)
            programme = make_ramp(node.rig, limb, config, *place)
            await self._enter(OperatingMode.COMMISSIONING, TIGHT_S)
            self._ramp, self._wrench = programme, wrench
            await self._run(handle, programme)
        finally:
            self._ramp = self._wrench = None
            await pause(self._node, POLL_S)
            node.destroy_subscription(pose.subscription)
            node.destroy_subscription(wrench.subscription)
        await self._enter(OperatingMode.STOPPED)
        stamps, wrenches = programme.wrench
        found = evaluate_ramp(
            programme.record,
            stamps - programme.record_start_s,
            wrenches,
            geometry,
            limb,
            *place,
            node.rig.control.rated,
        )
        result.stiffness, result.stiffness_fit = found.line.stiffness, found.fit
        result.backlash = found.line.play
        less = programme.peak < config.ramp_tension
        return (
            f"ramp: to {programme.peak:.1f} N"
            + (" (more is beyond the sensor's range)" if less else "")
            + f", residual {found.line.linearity_rms:.2f} N, "
            f"hysteresis {found.line.hysteresis:.2f} N, as of a gear's play of "
            f"{1e3 * found.line.play:.3f} mm"
        )

    async def _pretighten(self, handle: Any) -> None:
        await self._enter(OperatingMode.PRETIGHTENING)
        began = time.monotonic()
        while not self._node.zeroed().all():
            self._check(handle)
            if self._node.seen_mode == OperatingMode.FAULT:
                reason = "the rig went to FAULT during pre-tightening"
                raise CommissioningError(reason, ResultCode.INTERRUPTED)
            if time.monotonic() - began > PRETIGHTENED_S:
                left = limb_names(np.flatnonzero(~self._node.zeroed()))
                raise CommissioningError(
                    f"{left} did not reach their switch within {PRETIGHTENED_S:g} s",
                    ResultCode.TIMED_OUT,
                )
            handle.publish_feedback(CommissionLimb.Feedback(phase="pre-tightening"))
            await pause(self._node, POLL_S)

    async def _run(self, handle: Any, programme: Programme) -> None:
        """Hand a programme over and wait for its end."""
        self._controller.excitation = programme
        began = time.monotonic()
        try:
            while not programme.done:
                self._check(handle)
                if not programme.started and time.monotonic() - began > ANSWER_S:
                    raise CommissioningError(
                        f"{programme.kind}: the mode is {self._node.seen_mode.name}, "
                        "COMMISSIONING did not arrive",
                        ResultCode.TIMED_OUT,
                    )
                feedback = CommissionLimb.Feedback(
                    phase=programme.phase, progress=float(programme.progress)
                )
                handle.publish_feedback(feedback)
                await pause(self._node, POLL_S)
        finally:
            programme.abort("given up")
        if programme.fault:
            raise CommissioningError(programme.fault)

    def _check(self, handle: Any) -> None:
        if handle.is_cancel_requested:
            raise CommissioningError("cancelled", ResultCode.CANCELLED)

    async def _enter(self, mode: OperatingMode, patience_s: float = 0.0) -> None:
        """Ask the supervisor for a mode; again for a while if it says that it is not time yet.

        Raises:
            CommissioningError: with its reason, or if it does not answer.
        """
        give_up = time.monotonic() + patience_s
        while not (answer := await self._ask(mode)).success:
            if answer.code not in NOT_YET or time.monotonic() >= give_up:
                reason = f"the supervisor refuses {mode.name}: {answer.message}"
                raise CommissioningError(reason, ResultCode(answer.code))
            await pause(self._node, POLL_S)

    async def _ask(self, mode: OperatingMode) -> Any:
        began = time.monotonic()
        while not self._modes.service_is_ready():
            if time.monotonic() - began > ANSWER_S:
                reason = "no service set_mode: is the supervisor running?"
                raise CommissioningError(reason, ResultCode.NOT_READY)
            await pause(self._node, POLL_S)
        future = self._modes.call_async(SetMode.Request(mode=int(mode)))
        while not future.done():
            if time.monotonic() - began > ANSWER_S:
                reason = f"set_mode: no answer within {ANSWER_S:g} s"
                raise CommissioningError(reason, ResultCode.TIMED_OUT)
            await pause(self._node, 0.5 * POLL_S)
        return future.result() or SetMode.Response(message="no answer")

    async def _give_back(self) -> list[str]:
        """Leave the rig STOPPED; return what went wrong with that, unless it is in FAULT."""
        mode = self._node.seen_mode
        if mode in (OperatingMode.STOPPED, OperatingMode.FAULT):
            return []
        if mode not in (OperatingMode.COMMISSIONING, OperatingMode.PRETIGHTENING):
            # Another client has taken over.
            return []
        try:
            await self._enter(OperatingMode.STOPPED)
        except CommissioningError as error:
            return [str(error)]
        return []


def _pose_of(pose: Input, rig: Rig) -> tuple[FloatArray, FloatArray]:
    """Newest platform pose; the reference pose if none arrives."""
    if pose.take():
        found = read_pose(np.array(pose.record["pose"], dtype=np.float64))
        if found is not None:
            return found
    return rig.geometry.reference_position, rig.geometry.reference_rotation
