# SPDX-License-Identifier: Apache-2.0
"""Bridge, guard, controllers and plant in one process, in lockstep, without ROS."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.limb_control.controller import LimbController, LimbSample, TensionSetpoint
from cabols_control.rig import Rig
from cabols_control.supervision.held_load import taut_limbs
from cabols_control.supervision.modes import MOVING, OperatingMode
from cabols_control.wrench_control.controller import DesiredWrench, WrenchController
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.bridge.scaling import CLOSINGS
from cabols_hw.card.config import CardConfig
from cabols_hw.force_torque.sensor_bias import SensorBias
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.guard import BridgeGuard
from cabols_sim.plant.card import SimulatedQ8
from cabols_sim.plant.config import PlantConfig
from cabols_sim.plant.plant import Plant

PERIOD_S = 0.001
SPRING_END_N, BREAK_N = 150.0, 890.0
"""Ends of the plant's limbs: of the spring, and of the cable."""
POSE_EVERY, POSE_LAG = 4, 6
"""Samples between two poses, and a pose's age in samples when it arrives."""
PATH_EVERY = 50
"""Samples between two announcements of a path."""
HELD_S = 0.12
"""From a cable that pulls in STOPPED, while the robot moves, until it begins to brake [s]: the slow
copy of the limb states, the look at its joints, a beat."""
HEARTBEAT_S, BRAKE_S = 0.04, 0.3
"""From the bridge's fault until the robot begins to brake (report, a beat, the connection's end),
and braking."""


class MovingRobot:
    """Carries the platform at a constant velocity, whatever pulls at it, until it is stopped.

    Attributes:
        position: (3,) of the platform, base frame [m].
        rotation: (3, 3) platform to base.
        velocity: (3,) [m/s].
    """

    def __init__(self, rig: Rig) -> None:
        """Stand at the reference pose.

        Args:
            rig: its geometry.
        """
        self.position = np.array(rig.geometry.reference_position)
        self.rotation = np.array(rig.geometry.reference_rotation)
        self.velocity = np.zeros(3)
        self._now_s, self._began_s, self._brakes_s = 0.0, 0.0, np.inf

    def move(self, velocity: FloatArray) -> None:
        """Go on with a velocity (3,) [m/s], reached within BRAKE_S.

        Args:
            velocity: (3,) base frame [m/s].
        """
        self.velocity, self._began_s = np.array(velocity), self._now_s

    def told(self) -> tuple[FloatArray, FloatArray]:
        """Return position (3,) [m] and rotation (3, 3) as the robot reports them."""
        return self.position.copy(), self.rotation.copy()

    def stop(self, after_s: float = HEARTBEAT_S) -> None:
        """Brake once the silence of the rig's heartbeat has been noticed.

        Args:
            after_s: until then [s].
        """
        self._brakes_s = min(self._brakes_s, self._now_s + after_s)

    def step(self, wrench: FloatArray, dt_s: float) -> bool:
        """Advance; whether the pose has changed.

        Args:
            wrench: (6,) of the cables; it moves nothing.
            dt_s: step [s].
        """
        del wrench
        self._now_s += dt_s
        share = min((self._now_s - self._began_s) / BRAKE_S, 1.0)
        share *= float(np.clip(1.0 - (self._now_s - self._brakes_s) / BRAKE_S, 0.0, 1.0))
        if not share > 0.0 or not self.velocity.any():
            return False
        self.position += share * dt_s * self.velocity
        return True


class LockstepRig:
    """The control path of the bench, stepped by a millisecond.

    Attributes:
        plant: the truth.
        guard: of the bridge.
        robot: that holds the platform.
        mode: set by the trial; FAULT follows the guard's.
        zeroing: number of the newest pre-tightening, as the supervisor tells it.
        desired: (6,) wrench [N, N m].
        now_s: of the newest sample [s].
        limb_controller_runs: whether the limb controller answers.
        wrench_controller_runs: whether the wrench controller answers.
        path: speed [m/s] and rotation speed [rad/s] that the robot announces; None: no path.
        change_current: what a wrong controller makes of its (n,) currents [A].
        change_tension: what a wrong controller makes of its (n,) tensions [N].
        change_pose: what becomes of a pose on its way; None: it is lost.
        relays: whether the robot hears of the bridge's faults.
        later: what happens at a time [s], once.
    """

    def __init__(
        self,
        rig: Rig,
        card: CardConfig,
        plant: PlantConfig,
        safety: SafetyConfig,
        seed: int,
        robot: MovingRobot | None = None,
    ) -> None:
        """Start at rest with slack cables.

        Args:
            rig: geometry, limbs, gains.
            card: scaling and wiring.
            plant: true parameters; springs and cables get their ends.
            safety: the envelope.
            seed: of the plant.
            robot: that holds the platform; None: one that stands until it is told to move.
        """
        limbs = replace(plant.limbs, spring_end_tension=SPRING_END_N, break_tension=BREAK_N)
        self.rig = rig
        self.robot = robot or MovingRobot(rig)
        self.plant = Plant(rig, card, replace(plant, limbs=limbs), seed, self.robot)
        self.card = SimulatedQ8(self.plant, card, rig.geometry.cables, lockstep=True)
        self.card.start(card.watchdog)
        self._card_config, self._safety = card, safety
        self.now_s = 0.0
        self.start_again(None)
        self.limb_controller_runs = self.wrench_controller_runs = True
        self.path: tuple[float, float] | None = None
        self.relays = True
        self.later: tuple[float, Callable[[], None]] | None = None
        self.change_current: Callable[[FloatArray], FloatArray] | None = None
        self.change_tension: Callable[[FloatArray], FloatArray] | None = None
        self.change_pose: (
            Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray] | None] | None
        ) = None
        self._poses: deque[tuple[int, float, FloatArray, FloatArray]] = deque()
        self._tick = 0

    def start_again(self, bias: SensorBias | None) -> None:
        """Start bridge and controllers anew, in STOPPED; the plant stays as it is.

        Args:
            bias: of the sensor, that was kept; None: there is none.
        """
        rig = self.rig
        self.bridge = Bridge(rig, self._card_config, CLOSINGS)
        if bias is not None:
            self.bridge.adopt_bias(bias)
        self.guard = BridgeGuard(rig, self._safety, self._card_config.watchdog)
        self.limbs = LimbController(rig)
        self.wrenches = WrenchController(rig)
        self.mode, self.zeroing = OperatingMode.STOPPED, 0
        self.desired = np.zeros(6)
        self._setpoint: TensionSetpoint | None = None

    def fork(self) -> LockstepRig:
        """Return a copy that goes its own way."""
        return copy.deepcopy(self)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Run on, at most for a time.

        Args:
            seconds: longest time [s].
            until: ends it.
        """
        for _ in range(round(seconds / PERIOD_S)):
            self.cycle()
            if until():
                return

    def cycle(self) -> None:
        """Advance by one sample: the bridge judges it, the controllers answer."""
        sample = self.card.read()
        self._tick += 1
        self.now_s = 1e-9 * sample.time_ns
        if self.later is not None and self.now_s >= self.later[0]:
            act, self.later = self.later[1], None
            act()
        self._tell_pose()
        self.bridge.take(sample, self.mode, self.zeroing)
        guard, expired = self.guard, self.card.watchdog_expired
        if guard.sample(self.now_s, self.bridge, self.mode, expired):
            self._write()
        self.card.enable(guard.enabled)
        # As the bridge's node does.
        if expired and (self.mode not in MOVING or guard.fault is not None):
            self.card.clear_watchdog()
        if guard.fault is not None and self.mode != OperatingMode.STOPPED:
            self.mode = OperatingMode.FAULT
            if self.relays:
                self.robot.stop()
        if self.relays and self.mode == OperatingMode.STOPPED and self._taut():
            self.robot.stop(HELD_S)
        if self.limb_controller_runs:
            guard.command(self.limbs.limbs, self._currents(), self.now_s)
            self._write()

    def _taut(self) -> str:
        bridge = self.bridge
        return taut_limbs(bridge.tension, bridge.zeroed, bridge.switch_closed)

    def _write(self) -> None:
        self.card.write(self.bridge.volts(self.guard.output(self.mode)))

    def _currents(self) -> FloatArray:
        """(n,) of the controllers [A]."""
        bridge = self.bridge
        if self.wrench_controller_runs:
            self.wrenches.place(self.now_s)
            measured = self.wrenches.to_base_axes(bridge.wrench)
            wanted = DesiredWrench(self.now_s, self.desired)
            tension = self.wrenches.step(self.now_s, measured, self.mode, wanted)
            if self.change_tension is not None:
                tension = self.change_tension(tension)
            self._setpoint = TensionSetpoint(self.now_s, tension, self.wrenches.active)
        state = LimbSample(
            self.now_s,
            bridge.wound_length,
            bridge.elongation,
            bridge.tension,
            bridge.switch_closed,
            bridge.zeroed,
            bridge.cable_speed,
            bridge.cable_acceleration,
        )
        current = self.limbs.step(state, self.mode, self._setpoint)
        return current if self.change_current is None else self.change_current(current)

    def _tell_pose(self) -> None:
        if self.path is not None and self._tick % PATH_EVERY == 0:
            self.guard.safety.allow_path(self.now_s, *self.path)
        if self._tick % POSE_EVERY == 0:
            pose = self.robot.told()
            self._poses.append((self._tick + POSE_LAG, self.now_s, *pose))
        if not self._poses or self._poses[0][0] > self._tick:
            return
        _, stamp_s, *told = self._poses.popleft()
        position, rotation = told
        if self.change_pose is not None:
            changed = self.change_pose(position, rotation)
            if changed is None:
                return
            position, rotation = changed
        if self.guard.safety.hear_pose(self.now_s, position, rotation, stamp_s):
            self.bridge.hear_pose(stamp_s, position, rotation)
        self.wrenches.hear_pose(stamp_s, position, rotation)
