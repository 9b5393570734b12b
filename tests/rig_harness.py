"""The whole rig in one process, without ROS: plant, card, bridge, guard and both controllers."""

from __future__ import annotations

import copy
import threading

import numpy as np

from cabols_control.configuration import load_config, packaged
from cabols_control.limb_controller import LimbController, LimbSample, TensionSetpoint
from cabols_control.modes import OperatingMode
from cabols_control.wrench_controller import DesiredWrench, WrenchController
from cabols_hw.bridge import Bridge
from cabols_hw.guard import BridgeGuard
from cabols_hw.safety_config import SafetyConfig
from cabols_sim.card import SimulatedQ8
from cabols_sim.plant import Plant


class RigInOneProcess:
    """Steps everything by a millisecond; the mode is set by hand, FAULT follows the guard's."""

    def __init__(self, rig, card, plant_config, seed=0, target=None):
        n = rig.geometry.cables
        self.rig = rig
        self.plant = Plant(rig, card, plant_config, seed, target)
        self.card = SimulatedQ8(self.plant, card, n, lockstep=True)
        self.card.start(card.watchdog)
        self.bridge = Bridge(rig, card)
        config = load_config(SafetyConfig, packaged("cabols_hw", "bench_safety.yaml"))
        self.guard = BridgeGuard(rig, config, card.watchdog)
        self.limbs = LimbController(rig)
        self.wrenches = WrenchController(rig)
        self.mode = OperatingMode.STOPPED
        self.desired = np.zeros(6)
        self.controllers_alive = True
        self.now_s = 0.0
        self.log = []

    def fork(self):
        """Return a copy that goes its own way."""
        lock, self.card._lock = self.card._lock, None
        twin = copy.deepcopy(self)
        self.card._lock, twin.card._lock = lock, threading.Lock()
        return twin

    def step(self):
        """Advance by one sample."""
        sample = self.card.read()
        self.now_s = 1e-9 * sample.time_ns
        self.bridge.take(sample, self.mode)
        self._report_pose()
        expired = self.card.watchdog_expired
        if self.guard.sample(self.now_s, self.bridge, self.mode, expired):
            self._write()
        self.card.enable(self.guard.enabled)
        if self.guard.fault is not None and self.mode != OperatingMode.STOPPED:
            self.mode = OperatingMode.FAULT
        if self.controllers_alive:
            self._answer()
        self.log.append((self.now_s, self.plant.tension.copy(), self.plant.current))

    def _report_pose(self):
        target, faults = self.plant.target, self.plant.faults
        if not faults.has("pose_silent"):
            position = target.position + np.array([faults.value("pose_offset"), 0.0, 0.0])
            if self.guard.safety.hear_pose(self.now_s, position, target.rotation):
                self.bridge.set_pose(position, target.rotation)

    def _answer(self):
        bridge = self.bridge
        wrench = self.wrenches.to_base_axes(bridge.wrench)
        desired = DesiredWrench(self.now_s, self.desired)
        tension = self.wrenches.step(self.now_s, wrench, self.mode, desired)
        setpoint = TensionSetpoint(self.now_s, tension, self.wrenches.active)
        state = LimbSample(
            self.now_s,
            bridge.wound_length,
            bridge.elongation,
            bridge.tension,
            bridge.switch_closed,
            bridge.zeroed,
        )
        current = self.limbs.step(state, self.mode, setpoint)
        self.guard.command(self.limbs.limbs, current, self.now_s)
        self._write()

    def _write(self):
        self.card.write(self.bridge.volts(self.guard.output(self.mode)))

    def run(self, seconds):
        """Advance for some time."""
        for _ in range(round(1000 * seconds)):
            self.step()

    def load(self, wrench):
        """Tare, pre-tighten and apply a wrench; returns when it stands."""
        self.run(0.3)
        self.mode = OperatingMode.PRETIGHTENING
        while not self.bridge.zeroed.all():
            self.step()
            assert self.now_s < 10.0, "pre-tightening took too long"
        self.run(0.3)
        self.mode = OperatingMode.LOADING
        self.desired = np.asarray(wrench, dtype=float)
        self.run(0.8)

    def since(self, instant_s):
        """(k,) times, (k, n) true tensions, (k, n) motor currents from an instant on."""
        rows = [row for row in self.log if row[0] > instant_s]
        return tuple(np.array(column) for column in zip(*rows, strict=True))
