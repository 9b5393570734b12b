# SPDX-License-Identifier: Apache-2.0
"""The rig in one process on a target that moves and shakes, with poses that come late."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
from bench_tracking import wrong_rig

from cabols_control.limb_control.controller import TensionSetpoint
from cabols_control.rig import Rig
from cabols_control.wrench_control.controller import DesiredWrench
from cabols_control.wrench_control.frames import place_frame, wrench_from_base
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety
from cabols_hw.safety.guard import BridgeGuard
from cabols_sim.plant.card import SimulatedQ8
from cabols_sim.plant.config import load_plant
from cabols_sim.plant.plant import Plant
from one_process import PERIOD_S, MovingTarget
from rig_harness import RigInOneProcess


class TrippedError(RuntimeError):
    """The bridge ended the load."""


class ShakenTarget(MovingTarget):
    """A MovingTarget that can also shake along x."""

    amplitude = frequency = began_s = 0.0

    def shake(self, amplitude: float, frequency: float) -> None:
        """Shake from now on; faded in over two periods."""
        self.amplitude, self.frequency, self.began_s = amplitude, frequency, self._time

    def step(self, wrench: Any, dt_s: float) -> bool:
        before = self.position.copy()
        changed = super().step(wrench, dt_s)
        if not self.amplitude:
            return changed
        time = self._time - self.began_s
        fade = min(0.5 * time * self.frequency, 1.0)
        at = self.amplitude * fade * np.sin(2.0 * np.pi * self.frequency * time)
        self.position[0] = self._start[0] + self.offset[0] + at
        self.twist[:3] = (self.position - before) / dt_s
        return True


class MovingRig(RigInOneProcess):
    """The rig with a target that moves, a lag of its poses, and perhaps another plant."""

    def __init__(self, rig: Rig, lag_s: float = 0.0, seed: int = -1, feed: bool = True) -> None:
        card, plant = load_card(), load_plant()
        target = ShakenTarget(rig.geometry)
        super().__init__(rig, card, plant, max(seed, 0), target)
        if seed >= 0:
            plant, wrong = wrong_rig(rig, plant, seed)
            true_rig = replace(rig, geometry=wrong.geometry)
            self.plant = Plant(true_rig, card, plant, seed, target)
            self.plant._sensors["gauges"] = np.linalg.solve(card.platform_matrix, wrong.sensor)
            self.card = SimulatedQ8(self.plant, card, rig.geometry.cables, lockstep=True)
            self.card.start(card.watchdog)
        # What the real rig is allowed is not what is tried here.
        safety = replace(
            load_safety(),
            speed_loaded=0.25,
            speed_path=0.25,
            rotation_speed_loaded=0.9,
            rotation_speed_path=0.9,
        )
        self.guard = BridgeGuard(rig, safety, card.watchdog)
        self.lag_s, self.feed, self.frame = lag_s, feed, None
        self._late: deque = deque()
        self.stamped: list[tuple[float, np.ndarray, np.ndarray]] = []

    def tell_pose(self):
        if self._tick % 4 == 0:
            # The plant moves the target after the cables, which feel its pose a sample later.
            felt_s, target = self.now_s + PERIOD_S, self.target
            late_s = self.lag_s or 1e-3 * int(self._random.integers(4, 9))
            # Where the lag is not stated, a pose is stamped as it comes.
            stamp_s = felt_s + self.lag_s
            pose = target.position.copy(), target.rotation.copy()
            self._late.append((felt_s + late_s, stamp_s, *pose))
        while self._late and self._late[0][0] <= self.now_s:
            self.hear_pose(*self._late.popleft()[1:])

    def hear_pose(self, stamp_s, position, rotation):
        self.stamped.append((stamp_s, position, rotation))
        super().hear_pose(stamp_s, position, rotation)

    def limb_currents(self, setpoint):
        if not self.feed:
            self.bridge.cable_speed[:] = self.bridge.cable_acceleration[:] = 0.0
        return super().limb_currents(setpoint)

    def fresh_setpoint(self):
        if self.frame is None:
            return super().fresh_setpoint()
        self.wrenches.place(self.now_s)
        wrench = self.wrenches.to_base_axes(self.bridge.wrench)
        desired = DesiredWrench(self.now_s, self.desired, self.frame)
        tension = self.wrenches.step(self.now_s, wrench, self.mode, desired)
        return TensionSetpoint(self.now_s, tension, self.wrenches.active)

    def use_lag(self, lag_s: float) -> None:
        """Let bridge and wrench controller know a lag."""
        self.bridge._track["lag"] = self.wrenches._track["lag"] = lag_s

    def errors(self, duration_s: float) -> np.ndarray:
        """(k, 6) measured less desired, in the frame of the desired wrench."""
        rows, moved = [], np.zeros(6)
        for _ in range(round(duration_s / PERIOD_S)):
            self.cycle()
            measured = self.wrenches.to_base_axes(self.bridge.wrench)
            if self.frame is not None:
                truth = np.array(self.target.position), np.array(self.target.rotation)
                place_frame(self.frame, *truth)
                wrench_from_base(self.frame, measured, moved)
                measured = moved.copy()
            rows.append(measured - self.desired)
            self.peak_a = max(self.peak_a, float(np.abs(self.bridge.current).max()))
            self.peak_n = max(self.peak_n, float(self.plant.tension.max()))
        if self.guard.fault is not None:
            raise TrippedError(f"the bridge tripped: {self.guard.fault.reason}")
        return np.array(rows)

    peak_a = peak_n = 0.0
