# SPDX-License-Identifier: Apache-2.0
"""The rig's control path in one process, with the bridge's guard and the wrench controller."""

from __future__ import annotations

import copy
import threading

import numpy as np

from cabols_control.limb_control.controller import TensionSetpoint
from cabols_control.supervision.modes import OperatingMode
from cabols_control.wrench_control.controller import DesiredWrench, WrenchController
from cabols_hw.safety.config import load_safety
from cabols_hw.safety.guard import BridgeGuard
from one_process import OneProcess


class RigInOneProcess(OneProcess):
    """OneProcess as the bridge node guards it; FAULT follows the guard's.

    Poses come with every sample: a target's, or the plant's rigid one, with the injected faults.
    """

    def __init__(self, rig, card, plant_config, seed=0, target=None):
        super().__init__(rig, card, plant_config, seed, target)
        config = load_safety()
        self.guard = BridgeGuard(rig, config, card.watchdog)
        self.wrenches = WrenchController(rig)
        self.desired = np.zeros(6)
        self.controllers_alive = True
        self.log = []

    def fork(self):
        """Return a copy that goes its own way."""
        lock, self.card._lock = self.card._lock, None
        twin = copy.deepcopy(self)
        self.card._lock, twin.card._lock = lock, threading.Lock()
        return twin

    def tell_pose(self):
        target, faults = self.plant.target, self.plant.faults
        if not faults.has("pose_silent"):
            position = target.position + np.array([faults.value("pose_offset"), 0.0, 0.0])
            self.hear_pose(self.now_s, position, target.rotation)

    def hear_pose(self, stamp_s, position, rotation):
        """Let the envelope judge a pose as it came; the wrench controller uses it in any case."""
        if self.guard.safety.hear_pose(self.now_s, position, rotation):
            self.bridge.hear_pose(stamp_s, position, rotation)
        self.wrenches.hear_pose(stamp_s, position, rotation)

    def answer(self):
        expired = self.card.watchdog_expired
        if self.guard.sample(self.now_s, self.bridge, self.mode, expired):
            self.write(self.guard.output(self.mode))
        self.card.enable(self.guard.enabled)
        if self.guard.fault is not None and self.mode != OperatingMode.STOPPED:
            self.mode = OperatingMode.FAULT
        if self.controllers_alive:
            current = self.limb_currents(self.fresh_setpoint())
            self.guard.command(self.controller.limbs, current, self.now_s)
            self.write(self.guard.output(self.mode))
        self.log.append((self.now_s, self.plant.tension.copy(), self.plant.current))

    def fresh_setpoint(self):
        """The wrench controller's tensions."""
        self.wrenches.place(self.now_s)
        wrench = self.wrenches.to_base_axes(self.bridge.wrench)
        desired = DesiredWrench(self.now_s, self.desired)
        tension = self.wrenches.step(self.now_s, wrench, self.mode, desired)
        return TensionSetpoint(self.now_s, tension, self.wrenches.active)

    def load(self, wrench):
        """Tare, pre-tighten and apply a wrench; returns when it stands."""
        self.run(0.3)
        self.pretighten()
        self.mode = OperatingMode.LOADING
        self.desired = np.asarray(wrench, dtype=float)
        self.run(0.8)

    def since(self, instant_s):
        """(k,) times, (k, n) true tensions, (k, n) motor currents from an instant on."""
        rows = [row for row in self.log if row[0] > instant_s]
        return tuple(np.array(column) for column in zip(*rows, strict=True))


class Peaks:
    """Runs a rig and keeps the largest true tension [N], force [N] and torque [N m]."""

    TENSION_N = 150.0
    """What the spring and docs/safety.md allow."""

    def __init__(self, rig):
        self.rig = rig
        self.tension = self.force = self.torque = 0.0
        self.fault = None

    def run(self, seconds, after=np.inf, hold=None):
        """Run on.

        Args:
            seconds: at most so long.
            after: seconds to go on after the first fault.
            hold: mode to set again in each cycle; None: leave it.

        Returns:
            Itself. It ends early once the bound is passed by a tenth: then all is known.
        """
        end = self.rig.now_s + seconds
        while self.rig.now_s < end:
            if hold is not None:
                self.rig.mode = hold
            self.rig.cycle()
            plant = self.rig.plant
            self.tension = max(self.tension, float(plant.tension.max()))
            self.force = max(self.force, float(np.linalg.norm(plant.wrench[:3])))
            self.torque = max(self.torque, float(np.linalg.norm(plant.wrench[3:])))
            if self.fault is None and self.rig.guard.fault is not None:
                self.fault = self.rig.guard.fault
                end = min(end, self.rig.now_s + after)
            if self.tension > 1.1 * self.TENSION_N:
                break
        return self
