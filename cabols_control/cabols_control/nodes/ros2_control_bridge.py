# SPDX-License-Identifier: Apache-2.0
"""Node: limbs as joints of ros2_control, their tensions as the joints' efforts."""

from __future__ import annotations

import sys
import time

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from cabols_control.bringup_nodes import NODES as CONTROL_NODES
from cabols_control.ros.loop import SLOW_INPUT, ControlLoop, Input
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import RUNNING, WAITING, ControlNode, run_node
from cabols_control.ros.parameters import declare_row
from cabols_control.ros.sessions import ModeInput
from cabols_control.stamps import set_time
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_control.wrench_control.joint_commands import (
    JointCommandError,
    JointCommands,
    limb_joints,
    wrench_joints,
)

RATE = CONTROL_NODES.argument("joint_state_rate")


class Ros2ControlBridgeNode(ControlNode):
    """Publishes the limbs as joint states, and sends commands of joints on in LOADING.

    The supervisor's modes, the safety envelope and the limits of the wrench controller hold as for
    any other setpoint: this node can only ask. Silent controllers let the tensions be ramped down.
    """

    role_topic = "desired_tension"

    def __init__(self) -> None:
        """Subscribe to limb_state, wrench, mode and commands; advertise states and setpoints."""
        super().__init__("ros2_control_bridge")
        geometry, control = self.rig.geometry, self.rig.control
        cables = geometry.cables
        self._turns = max(1, round(1000.0 / declare_row(self, RATE)))
        self._state = Input(self, "limb_state", topics.limb_state_layout(geometry), self.lockstep)
        wrench = topics.wrench_layout(geometry.platform_frame)
        self._wrench = Input(self, "wrench", wrench, self.lockstep, every=self._turns)
        self._mode = ModeInput(self, self.status.sessions, self.lockstep, every=SLOW_INPUT)
        self._joints = JointState(name=[*limb_joints(cables), *wrench_joints()])
        self._states = self.advertise("limb_joint_states")
        self._commands = JointCommands(cables, control.desired_timeout)
        self._setpoint = topics.desired_tension_layout(geometry).record()
        self._setpoint["limb"][:] = np.arange(cables)
        self._output = self.advertise("desired_tension")
        self._refused: Fault | None = None
        self._wound, self._wound_s = np.full(cables, np.nan), np.nan
        self.create_subscription(
            JointState, "limb_joint_commands", self._take, topic_qos("limb_joint_commands")
        )
        companions = [self._mode, self._wrench]
        # Nothing waits for this node, in lockstep neither.
        self._loop = ControlLoop(self, self._state, companions, self._step, lockstep=False)
        self._loop.prepare = self.prepare_thread

    def begin(self) -> None:
        """Start the loop."""
        self._loop.start()

    def end(self) -> None:
        """Stop it; the wrench controller then ramps the tensions down."""
        self._loop.stop()

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended the loop."""
        return self._loop.failure

    @property
    def _loading(self) -> bool:
        record = self._mode.record
        return record is not None and int(record["mode"]) == OperatingMode.LOADING

    def _step(self) -> None:
        """Publish the states when they are due; called once a sample of the limbs."""
        known = self._mode.count > 0
        self.status.cycle(self._state.stamp_ns, RUNNING if known else WAITING, self._refused)
        self.tidy()
        if self.status.cycles % self._turns:
            return
        record = self._state.record
        wound, stamp_s = np.array(record["wound_length"]), 1e-9 * self._state.stamp_ns
        elapsed_s = stamp_s - self._wound_s
        rate = (wound - self._wound) / elapsed_s if elapsed_s > 0.0 else np.zeros_like(wound)
        self._wound, self._wound_s = wound, stamp_s
        measured = self._wrench.record
        wrench = np.full(6, np.nan) if measured is None else np.array(measured["wrench"])
        nothing = np.zeros(6)
        joints = self._joints
        # ros2_control compares stamps with its own clock, which the rig's samples do not follow.
        set_time(joints.header.stamp, self.get_clock().now().nanoseconds)
        joints.position = np.concatenate((wound, nothing)).tolist()
        joints.velocity = np.concatenate((np.nan_to_num(rate), nothing)).tolist()
        joints.effort = np.concatenate((record["tension"], wrench)).tolist()
        self._states.publish(serialize_message(joints))

    def _take(self, command: JointState) -> None:
        """Send a command on as setpoints of all limbs; one that cannot be used is told."""
        if self._state.record is None:
            return
        tensions = np.array(self._state.record["tension"])
        try:
            setpoint = self._commands.take(time.monotonic(), command.name, command.effort, tensions)
        except JointCommandError as refused:
            self._refused = Fault(FaultName.DESIRED, str(refused))
            return
        self._refused = None
        if not self._loading:
            self._commands.reset()
            return
        if setpoint is None:
            return
        record = self._setpoint
        record.stamp(self._state.stamp_ns)
        record["tension"][:] = setpoint
        record["session"][0] = self.status.sessions.session
        self._output.publish(record.raw())


def main() -> int:
    """Entry point."""
    return run_node(Ros2ControlBridgeNode)


if __name__ == "__main__":
    sys.exit(main())
