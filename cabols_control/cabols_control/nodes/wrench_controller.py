# SPDX-License-Identifier: Apache-2.0
"""Node: answers each wrench with a tension_command."""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np
from geometry_msgs.msg import WrenchStamped

from cabols_control.bringup_nodes import NODES as CONTROL_NODES
from cabols_control.checks import FloatArray
from cabols_control.frames import load_wrench_frames, load_wrench_uncertainty
from cabols_control.poses.track import pose_time
from cabols_control.ros.framed_wrench import FramedWrenchInput, FrameWrenchOutput
from cabols_control.ros.loop import SLOW_INPUT, ControlLoop, Input
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import FAULT, RUNNING, WAITING, ControlNode, run_node
from cabols_control.ros.parameters import declare_robot, declare_row
from cabols_control.ros.sessions import ModeInput, living, same_session
from cabols_control.rotations import read_pose
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import MOVING, OperatingMode
from cabols_control.warm_up import warm_wrenches
from cabols_control.wrench_control.controller import DesiredWrench, WrenchController
from cabols_control.wrench_control.hanging import HangingWrenchController
from cabols_control.wrench_control.tension_setpoint import DesiredTension

BRIDGE_SILENT_S = 0.5
"""Silence of the bridge after which a process that is asked to end waits for nothing [s]."""
POSE_TIMEOUT_S = 0.5
LOCKSTEP_EXCUSE_NS = 1_000_000_000
"""In computer time [ns]: a lockstep clock may run ahead of a process that the kernel stalls."""


class WrenchControllerNode(ControlNode):
    """Thin node around WrenchController."""

    role_topic = "live/tension_command"
    starts_harmlessly = True

    def __init__(self) -> None:
        """Subscribe to wrench, setpoints, platform_pose and mode; advertise tension_command."""
        super().__init__("wrench_controller")
        method = declare_row(self, CONTROL_NODES.argument("tension_method"))
        if method:
            control = replace(self.rig.control, tension_method=method)
            self.rig = replace(self.rig, control=control)
        warm_wrenches(self.rig)
        geometry = self.rig.geometry
        hangs = self.rig.hanging is not None
        self._controller = (HangingWrenchController if hangs else WrenchController)(self.rig)
        lockstep = self.lockstep
        self._wrench = Input(
            self, "wrench", topics.wrench_layout(geometry.platform_frame), lockstep
        )
        frames = load_wrench_frames(geometry, self.rig_folder)
        self._wrench_setpoint = FramedWrenchInput(self, frames)
        self._uncertainty = load_wrench_uncertainty(frames, self.rig_folder)
        self._told = FrameWrenchOutput(self, frames, self._uncertainty)
        if not lockstep:
            # When it comes is up to the middleware; a lockstep clock would not wait for it.
            qos = topic_qos("sensor_tare")
            self.create_subscription(WrenchStamped, "sensor_tare", self._hear_tare, qos)
        tensions = topics.desired_tension_layout(geometry)
        sessions = self.status.sessions
        self._tension_setpoint = Input(self, "desired_tension", tensions, lockstep, every=2)
        self._tension_setpoint.judge = same_session(tensions, sessions, lockstep)
        # A campaign sends its setpoints at any time, also in lockstep.
        self._tension_setpoint.awaited = False
        pose = topics.pose_layout(geometry)
        self._pose = Input(self, "platform_pose", pose, lockstep, every=2)
        self._pose.judge = living(pose, sessions, lockstep)
        # A robot reports at its own rate, so that even in lockstep its newest pose is used.
        robot = declare_robot(self)
        self._pose.awaited = self._wrench_setpoint.awaited = not robot
        self._mode = ModeInput(
            self,
            sessions,
            lockstep,
            every=SLOW_INPUT,
            clock_ns=lambda: self._wrench.stamp_ns,
            on_session=self._follow,
        )
        self._mode.awaited = not robot
        layout = topics.tension_command_layout(geometry)
        self._answer = layout.record()
        self._answer["limb"][:] = np.arange(geometry.cables)
        self._output = self.advertise_live("tension_command")
        self._measured = np.zeros(6)
        self._desired: DesiredWrench | None = None
        self._desired_count = 0
        self._tension: DesiredTension | None = None
        self._tension_count = 0
        self._limbs = np.arange(geometry.cables, dtype=np.uint8).tobytes()
        self._pose_count = 0
        self._pose_seen_ns = 0
        self._desired_frame = geometry.base_frame
        self._refused: Fault | None = None
        self._pose_bytes = b""
        self._newest_pose: tuple[FloatArray, FloatArray] | None = None
        companions = [self._mode, self._pose, self._wrench_setpoint, self._tension_setpoint]
        self._loop = ControlLoop(self, self._wrench, companions, self._step, self.lockstep)
        self._loop.prepare = self.prepare_thread

    def _hear_tare(self, message: WrenchStamped) -> None:
        force = message.wrench.force
        self._uncertainty.tell_tare([force.x, force.y, force.z])

    def _follow(self, session: int) -> None:
        """Answer in another supervisor's session."""
        self._answer["session"][0] = session

    def begin(self) -> None:
        """Start the loop."""
        self._loop.start()

    def end(self) -> None:
        """Stop the loop; the limb controller then cuts the current for a stale command."""
        self._loop.stop()

    def end_asked(self) -> None:
        """Ask for unloading."""
        self.announce_end()

    def may_end(self) -> bool:
        """Not while anything moves, unless the bridge is silent."""
        moving = self._mode.count > 0 and int(self._mode.record["mode"]) in MOVING
        return self.lockstep or not moving or self._loop_rests()

    def _loop_rests(self) -> bool:
        """Whether no sample has come for some time."""
        return time.monotonic_ns() - self._wrench.received_ns > 1e9 * BRIDGE_SILENT_S

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended the loop."""
        return self._loop.failure

    def _step(self) -> None:
        started = time.monotonic()
        controller = self._controller
        self._take_pose()
        controller.place(1e-9 * self._wrench.stamp_ns)
        self._take_desired()
        self._take_tension()
        self._measured[:] = self._wrench.record["wrench"]
        measured = controller.to_base_axes(self._measured)
        controller.step(
            1e-9 * self._wrench.stamp_ns,
            measured,
            self._present_mode(),
            self._desired,
            self._tension,
        )
        answer = self._answer
        answer.stamp(self._wrench.stamp_ns)
        # The bridge publishes one wrench per limb state, so that DDS counts them alike.
        answer["sequence"][0] = self._wrench.dds_sequence
        answer["tension"][:] = controller.tension
        answer["active"][0] = controller.active
        answer["feasible"][0] = controller.feasible
        answer["control"][:] = controller.control
        answer["residual"][:] = controller.residual
        answer["desired"][:] = controller.desired
        self._output.publish(answer.raw())
        self._output.copy()
        self._tell(measured)
        self.status.work.add(time.monotonic() - started)
        self._report()

    def _tell(self, measured: FloatArray) -> None:
        """Tell the wrenches in the frame of the desired one; (6,) measured, base axes."""
        controller = self._controller
        self._told.tell(
            self._wrench.stamp_ns,
            self._desired_frame,
            controller.pose,
            controller.acceleration,
            controller.desired,
            measured,
        )

    def _report(self) -> None:
        controller = self._controller
        self.status.lost = self._wrench.lost
        self.status.infeasible = controller.infeasible_cycles
        trouble = controller.fault or controller.notice or self._refused
        complete = self._pose.count > 0 and self._mode.count > 0
        ready = RUNNING if complete else WAITING
        state = FAULT if controller.fault is not None else ready
        self.status.cycle(self._wrench.stamp_ns, state, trouble)
        self.tidy()

    def _present_mode(self) -> OperatingMode:
        if self._mode.record is None:
            return OperatingMode.STOPPED
        mode = OperatingMode(int(self._mode.record["mode"]))
        age = 1e-9 * abs(self._wrench.stamp_ns - self._pose_seen_ns)
        if mode == OperatingMode.LOADING and self._pose.count and not age <= POSE_TIMEOUT_S:
            self._trip(FaultName.POSE_AGE, f"platform_pose is {age:.1f} s old")
        return mode

    def _trip(self, name: FaultName, reason: str) -> None:
        self._controller.trip(Fault(name, reason))

    def _refuse(self, reason: str) -> None:
        """Keep the previous setpoint; this is reported, but no fault."""
        self._refused = Fault(FaultName.DESIRED, reason)

    def _take_pose(self) -> None:
        """Take a pose; one that is no pose ends the load."""
        record = self._pose.record
        if record is None or self._pose.count == self._pose_count:
            return
        # Ages count from arrival, on the samples' clock: a robot's own clock is another one.
        self._pose_count, self._pose_seen_ns = self._pose.count, self._wrench.stamp_ns
        content = record["pose"].tobytes()
        if content != self._pose_bytes:
            self._pose_bytes = content
            self._newest_pose = read_pose(np.frombuffer(content))
        pose = self._newest_pose
        if pose is None:
            self._trip(
                FaultName.POSE,
                f"platform_pose: expected a finite position and a unit quaternion, got "
                f"{np.frombuffer(content)}",
            )
            return
        now_s = 1e-9 * self._wrench.stamp_ns
        self._controller.hear_pose(pose_time(1e-9 * self._pose.stamp_ns, now_s), *pose)

    def _take_desired(self) -> None:
        """Accept a finite desired wrench in a frame of the rig; keep the last one otherwise."""
        if self._wrench_setpoint.error:
            self._refuse(self._wrench_setpoint.error)
        if self._wrench_setpoint.count == self._desired_count:
            return
        self._desired_count = self._wrench_setpoint.count
        record = self._wrench_setpoint.record
        values = np.array(record["wrench"])
        if not np.isfinite(values).all():
            self._refuse(f"desired_wrench: expected finite numbers, got {values.tolist()}")
        else:
            self._refused = None
            # Its age, too, counts from arrival: a programme may run on another machine.
            stamp_s, frame = 1e-9 * self._wrench.stamp_ns, self._wrench_setpoint.frame
            self._desired = DesiredWrench(stamp_s, values, frame)
            self._desired_frame = self._wrench_setpoint.frame_name

    def _take_tension(self) -> None:
        """Accept finite desired tensions of all limbs; keep the last ones otherwise."""
        if self._tension_setpoint.error:
            self._refuse(self._tension_setpoint.error)
        if self._tension_setpoint.count == self._tension_count:
            self._excuse_tension()
            return
        self._tension_count = self._tension_setpoint.count
        if self.rig.hanging is not None:
            self._refuse("desired_tension: tensions alone would let the platform go, which hangs")
            return
        record = self._tension_setpoint.record
        values = np.array(record["tension"])
        if record["limb"].tobytes() != self._limbs or not np.isfinite(values).all():
            self._refuse(
                f"desired_tension: expected finite numbers for the indices 0 to "
                f"{values.size - 1} in order, got {values.tolist()} for {record['limb'].tolist()}"
            )
        else:
            self._refused = None
            self._tension = DesiredTension(1e-9 * self._wrench.stamp_ns, values)

    def _excuse_tension(self) -> None:
        """In lockstep accept an old value while its sender cannot keep up with the clock."""
        if not self.lockstep or self._tension is None:
            return
        if time.monotonic_ns() - self._tension_setpoint.received_ns < LOCKSTEP_EXCUSE_NS:
            self._tension = DesiredTension(1e-9 * self._wrench.stamp_ns, self._tension.tension)


def main() -> int:
    """Entry point."""
    return run_node(WrenchControllerNode)


if __name__ == "__main__":
    sys.exit(main())
