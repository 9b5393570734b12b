# SPDX-License-Identifier: Apache-2.0
"""A robot of Universal Robots: RTDE for the stream, and for motions by its program's registers."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.naming import configuration_name
from cabols_hw.abb.egm.stream_quality import CountedStream, Refusal
from cabols_hw.abb.errors import MoveAbortedError, RobotError
from cabols_hw.robot.interface import Capability, Leg, RobotInfo, RobotSample
from cabols_hw.ur.connection import RtdeConnection
from cabols_hw.ur.handshake import (
    ACCEPTED,
    BEAT,
    BEAT_S,
    ERROR,
    FINISHED,
    INPUTS,
    OUTPUTS,
    PLAYING,
    REQUEST,
    STOP,
    STOPPED,
    TARGET,
    ProgramError,
    RobotMode,
)

STATE = ("timestamp", "actual_q", "actual_TCP_pose", "robot_mode", "runtime_state")
RATE = 125.0
"""Of both series of controllers [Hz]."""
TIMEOUT_S = 2.0
STOP_S = 1.0
"""A stop is confirmed within this time, or is none [s]."""
NO_MOTORS = "robot: its motors are off: switch them on at its pendant, and release the brakes"
NO_PROGRAM = (
    "robot: its program does not run: load and play what `python -m cabols_hw.ur.program` prints"
)


class UrRobot:
    """The Robot of controllers CB3 and e-Series; see Robot.

    Two connections: one reads the stream, one commands. stop() may come from any thread.

    Attributes:
        counter: what was received, late, refused.
    """

    def __init__(
        self,
        host: str,
        port: int = 0,
        timeout_s: float = TIMEOUT_S,
        late_after_s: float = 0.03,
        clock_rate: float = 1.0,
    ) -> None:
        """Prepare; the first call connects.

        Args:
            host: of the controller.
            port: of RTDE; 0: its own, 30004.
            timeout_s: of connecting, and of a request's acceptance [s].
            late_after_s: delay that counts as late [s].
            clock_rate: rate of the controller's clock in this computer's: 1, except for a
                simulated one in slow motion.
        """
        self.counter = CountedStream(late_after_s)
        self._clock_rate = clock_rate
        self._address = (host, port)
        self._timeout_s = timeout_s
        self._stream: RtdeConnection | None = None
        self._control: RtdeConnection | None = None
        self._lock = threading.RLock()
        self._registers = dict.fromkeys(INPUTS, 0)
        self._heard: dict[str, Any] = {}
        self._sequence = 0
        self._stops = 0

    def info(self) -> RobotInfo:
        """Return what is known of the controller; asks it at first."""
        with self._lock:
            version = self._commands().version
        return RobotInfo(
            maker="Universal Robots",
            interface=f"RTDE 2, software {version}",
            axes=6,
            stream_rate=RATE,
            capabilities=Capability.STREAM
            | Capability.MOVE
            | Capability.STOP
            | Capability.HEARTBEAT,
        )

    def take(self, timeout_s: float) -> RobotSample | None:
        """Wait for the stream; return its newest sample, None if none came in time.

        Args:
            timeout_s: longest wait [s].
        """
        try:
            if self._stream is None:
                self.counter.renew()
                self._stream = RtdeConnection(self._address, STATE, (), RATE, self._timeout_s)
            found = self._stream.newest(timeout_s)
        except RobotError:
            # The next call connects anew: a controller that was switched on again is found.
            if self._stream is not None:
                self._stream.close()
            self._stream = None
            return None
        if found is None:
            return None
        values, _ = found
        self._sequence += 1
        sample = _sample(values, self._sequence)
        if sample is None:
            self.counter.refuse(Refusal.NOT_FINITE, "numbers of no robot")
            return None
        # TCP loses nothing: what was newer than others counts as one.
        sent_s, now_s = 1e-9 * sample.robot_time_ns, sample.received_s * self._clock_rate
        return sample if self.counter.take(self._sequence, sent_s, now_s) else None

    def move(
        self,
        index: int,
        timeout_s: float,
        interrupted: Callable[[], str],
        poll_s: float = 0.1,
    ) -> None:
        """Move to a stored configuration and wait for the end; see Robot.

        Args:
            index: of the configuration.
            timeout_s: for the whole motion [s].
            interrupted: called every poll_s; a reason, to stop for it, or an empty string.
            poll_s: its period [s].

        Raises:
            MoveAbortedError: after an interruption or the time-out.
            RobotError: for everything else.
        """
        if reason := interrupted():
            raise MoveAbortedError(f"robot: the motion was not begun: {reason}")
        stops = self._stops
        with self._lock:
            self._look(TIMEOUT_S)
            self._check_ready()
            self._registers[TARGET] = index
            self._registers[REQUEST] = number = (self._registers[REQUEST] + 1) % 2**31
        give_up = time.monotonic() + timeout_s
        accept = time.monotonic() + self._timeout_s
        asked = time.monotonic()
        while True:
            with self._lock:
                self._beat()
                self._look(BEAT_S)
                heard = dict(self._heard)
            if heard[FINISHED] == number:
                return self._judge(index, ProgramError(heard[ERROR]), stops)
            now = time.monotonic()
            why = ""
            if heard[ACCEPTED] != number and now > accept:
                why = "it does not accept the motion"
            elif now > give_up:
                why = f"not there within {timeout_s:g} s"
            elif now - asked >= poll_s:
                asked, why = now, interrupted()
            if why:
                self.stop()
                raise MoveAbortedError(f"robot: {configuration_name(index)}: stopped: {why}")
            if heard["robot_mode"] != RobotMode.RUNNING:
                raise RobotError(NO_MOTORS)

    def lead(
        self,
        leg: Leg,
        timeout_s: float,
        interrupted: Callable[[], str],
        poll_s: float = 0.1,
    ) -> None:
        """Refuse: the program knows stored configurations alone (no Capability.LEAD).

        Args:
            leg: where to, and how fast.
            timeout_s: for the whole motion [s].
            interrupted: not called.
            poll_s: its period [s].

        Raises:
            RobotError: always; nothing moves.
        """
        del leg, timeout_s, interrupted, poll_s
        raise RobotError("robot: its program follows no path: it knows stored configurations alone")

    def _judge(self, index: int, error: ProgramError, stops: int) -> None:
        """Return if a finished request was obeyed."""
        if error == ProgramError.NONE:
            return
        if error == ProgramError.NO_CONFIGURATION:
            raise RobotError(
                f"robot: {configuration_name(index)}: its program has no such configuration: load "
                "the program of this rig"
            )
        if error == ProgramError.RIG_SILENT:
            raise MoveAbortedError("robot: it stopped by itself: the rig's heartbeat was silent")
        why = "stopped by another thread" if self._stops != stops else "stopped"
        raise MoveAbortedError(f"robot: {configuration_name(index)}: {why}")

    def stop(self) -> None:
        """Stop the robot, from any thread; returns when its program has confirmed.

        Raises:
            RobotError: if it has not: use its emergency stop.
        """
        give_up = time.monotonic() + STOP_S
        with self._lock:
            self._stops += 1
            try:
                self._commands()
                self._registers[STOP] = number = (self._registers[STOP] + 1) % 2**31
                while time.monotonic() < give_up:
                    self._beat()
                    self._look(BEAT_S)
                    if self._heard.get(STOPPED) == number:
                        return
            except RobotError as error:
                raise RobotError(f"THE ROBOT MAY STILL MOVE: {error}; stop it there") from error
        raise RobotError("THE ROBOT MAY STILL MOVE: it did not confirm the stop; stop it there")

    def close(self) -> None:
        """Give back the connections; a motion under way stops by the controller's watchdog."""
        for connection in (self._stream, self._control):
            if connection is not None:
                connection.close()
        self._stream = self._control = None

    def _commands(self) -> RtdeConnection:
        """The connection that commands; its counters go on where the program's are."""
        if self._control is None:
            outputs = (*OUTPUTS, "robot_mode", "runtime_state")
            made = RtdeConnection(self._address, outputs, INPUTS, RATE, self._timeout_s)
            self._control = made
            found = made.newest(self._timeout_s)
            if found is None:
                made.close()
                self._control = None
                raise RobotError("robot: its controller sends no RTDE data: restart it")
            self._heard = found[0]
            self._registers[REQUEST] = int(self._heard[FINISHED])
            self._registers[STOP] = int(self._heard[STOPPED])
            self._beat()
        return self._control

    def _beat(self) -> None:
        """Write all registers; the beat's differs each time."""
        self._registers[BEAT] = (self._registers[BEAT] + 1) % 2**31
        try:
            assert self._control is not None
            self._control.write(list(self._registers.values()))
        except RobotError:
            self._drop()
            raise

    def _look(self, timeout_s: float) -> None:
        """Read what the program says; keeps the last if nothing new comes."""
        connection = self._commands()
        try:
            found = connection.newest(timeout_s)
        except RobotError:
            self._drop()
            raise
        if found is not None:
            self._heard = found[0]

    def _drop(self) -> None:
        if self._control is not None:
            self._control.close()
        self._control = None

    def _check_ready(self) -> None:
        if self._heard["robot_mode"] != RobotMode.RUNNING:
            raise RobotError(NO_MOTORS)
        if self._heard["runtime_state"] != PLAYING:
            raise RobotError(NO_PROGRAM)


def _sample(values: dict[str, Any], sequence: int) -> RobotSample | None:
    """A sample of the stream; None for numbers of no robot."""
    joints = np.array(values["actual_q"], dtype=np.float64)
    pose = np.array(values["actual_TCP_pose"], dtype=np.float64)
    finite = np.isfinite(joints).all() and np.isfinite(pose).all()
    if not (finite and np.abs(joints).max() < 100.0 and np.abs(pose).max() < 100.0):
        return None
    return RobotSample(
        sequence=sequence,
        robot_time_ns=round(1e9 * float(values["timestamp"])),
        joints=joints,
        position=pose[:3],
        quaternion=Rotation.from_rotvec(pose[3:]).as_quat(),
        motors_on=values["robot_mode"] == RobotMode.RUNNING,
        rapid_running=values["runtime_state"] == PLAYING,
        received_s=time.monotonic(),
    )
