# SPDX-License-Identifier: Apache-2.0
"""Node: answers each limb_state with motor_current, for all limbs or a subset."""

from __future__ import annotations

import sys
import time

import numpy as np

from cabols_control.bringup_nodes import NODES as CONTROL_NODES
from cabols_control.checks import BoolArray
from cabols_control.errors import ConfigError
from cabols_control.limb_control.controller import LimbController, TensionSetpoint
from cabols_control.nodes.commission_server import CommissionServer
from cabols_control.ros.loop import SLOW_INPUT, ControlLoop, Input
from cabols_control.ros.messages import topics
from cabols_control.ros.node import FAULT, RUNNING, WAITING, ControlNode, run_node
from cabols_control.ros.parameters import declare, declare_robot, declare_row
from cabols_control.ros.sessions import ModeInput, same_session
from cabols_control.ros.stops import PRESSED, StopReceiver
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import MOVING, OperatingMode
from cabols_control.warm_up import warm_commissioning, warm_limb_messages

MODE_TIMEOUT_S = 0.5
BRIDGE_SILENT_S = 0.5
"""Silence of the bridge after which a process that is asked to end waits for nothing [s]."""
NO_SUBSET = [-1]


class LimbControllerNode(ControlNode):
    """Thin node around LimbController."""

    role_topic = "motor_current"
    starts_harmlessly = True

    def __init__(self) -> None:
        """Subscribe to limb_state, tension_command and mode; advertise motor_current."""
        super().__init__("limb_controller")
        geometry = self.rig.geometry
        subset = declare(self, "limbs", NO_SUBSET, "limbs to drive, indices from 0; [-1]: all")
        limbs = list(range(geometry.cables)) if list(subset) == NO_SUBSET else list(subset)
        if not limbs or sorted(set(limbs) & set(range(geometry.cables))) != sorted(limbs):
            raise ConfigError(
                f"limbs: expected distinct indices from 0 to {geometry.cables - 1}, got {limbs}"
            )
        timeout = declare_row(self, CONTROL_NODES.argument("command_timeout"))
        self._controller = LimbController(self.rig, limbs, timeout or None)
        lockstep = self.lockstep
        state_layout = topics.limb_state_layout(geometry)
        self._state = Input(self, "limb_state", state_layout, lockstep)
        commands = topics.tension_command_layout(geometry)
        sessions = self.status.sessions
        self._command = Input(self, "tension_command", commands, lockstep)
        self._command.judge = same_session(commands, sessions, lockstep)
        self._mode = ModeInput(
            self,
            sessions,
            lockstep,
            every=SLOW_INPUT,
            clock_ns=lambda: self._state.stamp_ns,
            on_session=self._follow,
        )
        self._mode.awaited = not declare_robot(self)
        layout = topics.motor_current_layout(geometry, len(limbs))
        self._answer = layout.record()
        self._answer["limb"][:] = limbs
        self._output = self.advertise("motor_current")
        self._cables = np.arange(geometry.cables, dtype=np.uint8)
        self._expected_limbs = self._cables.tobytes()
        self._state_dtype = state_layout.compiled_dtype
        nothing = np.frombuffer(state_layout.record().raw(), self._state_dtype, 1)
        warm_limb_messages(self.rig, limbs, nothing, layout.record().compiled)
        warm_commissioning(self.rig)
        self._loop = ControlLoop(
            self,
            self._state,
            [self._mode, self._command],
            self._step,
            self.lockstep,
        )
        self._loop.prepare = self.prepare_thread
        self._loop.use_pause = self._hear_command
        self._pressed = 0
        self._stops = StopReceiver(self, self._stop)
        self.seen_mode = OperatingMode.STOPPED
        self._mode_count = 0
        self._setpoint: TensionSetpoint | None = None
        self._command_count = self._tension_sequence = 0
        # Two controllers with a part of the limbs each would offer the same action twice, and
        # neither could pre-tighten the other's limbs.
        every = len(limbs) == geometry.cables and not self.lockstep
        self._commissioning = CommissionServer(self, self._controller) if every else None

    def _follow(self, session: int) -> None:
        """Answer in another supervisor's session."""
        self._answer["session"][0] = session

    def zeroed(self) -> BoolArray:
        """(n,) bool, limbs with a zero of the pre-tightening under way; none in other modes."""
        state, mode = self._state.record, self._mode.record
        tightening = mode is not None and int(mode["mode"]) == OperatingMode.PRETIGHTENING
        if state is None or not tightening or int(state["zeroing"]) != int(mode["zeroing"]):
            return np.zeros(self._cables.size, dtype=np.bool_)
        return np.array(state["zeroed"], dtype=np.bool_)

    def check_role(self) -> None:
        """Refuse to start beside another node that drives one of these limbs."""
        if self._role is not None:
            limbs = set(self._controller.limbs.tolist())
            self._role.check(lambda message: bool(limbs & set(message.limb)), limbs)

    def begin(self) -> None:
        """Start the loop."""
        self._loop.start()

    def end(self) -> None:
        """Stop the loop; its last message is zero current."""
        self._loop.stop()
        if self._commissioning is not None:
            self._commissioning.close()
        if self.context.ok():
            self._answer["current"][:] = 0.0
            self._output.publish(self._answer.raw())

    def end_asked(self) -> None:
        """Ask for unloading."""
        self.announce_end()

    def may_end(self) -> bool:
        """Not while anything moves, unless the bridge is silent."""
        moving = self.seen_mode in MOVING
        return self.lockstep or not moving or self._loop_rests()

    def _loop_rests(self) -> bool:
        """Whether no sample has come for some time."""
        return time.monotonic_ns() - self._state.received_ns > 1e9 * BRIDGE_SILENT_S

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended the loop."""
        return self._loop.failure

    def _step(self) -> None:
        started = time.monotonic()
        mode, setpoint = self._present_mode(), self._hear_command()
        stamp_s = 1e-9 * self._state.stamp_ns
        state = np.frombuffer(self._state.laid_out, self._state_dtype, 1)
        answer = self._answer
        self._controller.answer(stamp_s, mode, setpoint, state, answer.compiled)
        answer["tension_sequence"][0] = self._tension_sequence
        self._output.publish(answer.raw())
        if self._commissioning is not None:
            self._commissioning.after_step()
        self.status.work.add(time.monotonic() - started)
        self.status.lost = self._state.lost
        self._report()

    def _report(self) -> None:
        fault = self._controller.fault
        complete = self._command.count > 0 and self._mode.count > 0
        state = FAULT if fault is not None else RUNNING if complete else WAITING
        stopped = fault is not None and fault.name == FaultName.EMERGENCY_STOP
        self.status.stop = self._pressed if stopped else 0
        self.status.cycle(self._state.stamp_ns, state, fault)
        self.tidy()

    def _stop(self, _sender: str, number: int) -> None:
        """Hold the currents at zero until the mode has been STOPPED."""
        self._pressed = number
        self._trip(FaultName.EMERGENCY_STOP, PRESSED)

    def _trip(self, name: FaultName, reason: str) -> None:
        self._controller.trip(Fault(name, reason))

    def _present_mode(self) -> OperatingMode:
        if self._state.error:
            self._trip(FaultName.MESSAGE, self._state.error)
        if self._mode.record is None:
            return OperatingMode.STOPPED
        if self._mode.count != self._mode_count:
            self._mode_count = self._mode.count
            self.seen_mode = OperatingMode(int(self._mode.record["mode"]))
        mode = self.seen_mode
        age = 1e-9 * (self._state.stamp_ns - self._mode.stamp_ns)
        if mode in MOVING and not age <= MODE_TIMEOUT_S:
            self._trip(FaultName.MODE_AGE, f"mode is {age:.1f} s old: the supervisor is silent")
        return mode

    def _hear_command(self) -> TensionSetpoint | None:
        """Return the newest tension command; read once, in the pause if it comes by then."""
        if self._command.error:
            self._trip(FaultName.MESSAGE, self._command.error)
        if self._command.count != self._command_count:
            self._command_count = self._command.count
            self._setpoint = self._read_command(self._command.record)
            valid = self._setpoint is not None
            self._tension_sequence = int(self._command.record["sequence"]) if valid else 0
        return self._setpoint

    def _read_command(self, record: np.void) -> TensionSetpoint | None:
        if record["limb"].tobytes() != self._expected_limbs:
            self._trip(
                FaultName.MESSAGE,
                f"tension_command: expected the indices 0 to {self._cables.size - 1} in order, "
                f"got {record['limb'].tolist()}",
            )
            return None
        limbs = self._controller.limbs
        return TensionSetpoint(
            1e-9 * self._command.stamp_ns, record["tension"][limbs], bool(record["active"])
        )


def main() -> int:
    """Entry point."""
    return run_node(LimbControllerNode)


if __name__ == "__main__":
    sys.exit(main())
