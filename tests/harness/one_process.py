# SPDX-License-Identifier: Apache-2.0
"""Bridge, simulated card and limb controller in one process and in lockstep, without ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.limb_control.controller import LimbController, LimbSample, TensionSetpoint
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.bridge import Bridge
from cabols_sim.plant.card import SimulatedQ8
from cabols_sim.plant.plant import Plant

PERIOD_S = 0.001


def quintic(share):
    """Way of a motion that starts and ends with neither speed nor acceleration; 0 to 1."""
    s = np.clip(share, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


class MovingTarget:
    """Carries the platform along quintic moves from the reference pose, whatever pulls at it."""

    def __init__(self, geometry):
        self._start = np.array(geometry.reference_position)
        self._from = self._to = np.zeros(6)
        self._rotation = np.array(geometry.reference_rotation)
        self.position = self._start.copy()
        self.rotation = self._rotation.copy()
        self.offset = np.zeros(6)
        self._time = self._began = 0.0
        self._duration = 1.0
        self.twist = np.zeros(6)

    def move(self, to, duration):
        """Begin a move to an offset (6,): [m], rotation vector [rad]."""
        self._from, self._to = self.offset.copy(), np.asarray(to, dtype=float)
        self._began, self._duration = self._time, duration

    def step(self, wrench, dt_s):
        del wrench
        self._time += dt_s
        before, turned = self.position.copy(), self.rotation.copy()
        way = quintic((self._time - self._began) / self._duration)
        offset = self._from + way * (self._to - self._from)
        changed = not np.array_equal(offset, self.offset)
        self.offset = offset
        self.position[:] = self._start + offset[:3]
        self.rotation[:] = Rotation.from_rotvec(offset[3:]).as_matrix() @ self._rotation
        self.twist[:3] = (self.position - before) / dt_s
        self.twist[3:] = Rotation.from_matrix(self.rotation @ turned.T).as_rotvec() / dt_s
        return changed


class OneProcess:
    """The rig's control path, stepped by a millisecond; the mode is set by hand.

    The pose reaches the bridge every 4 ms, 4 to 8 ms old, as by EGM.
    """

    def __init__(self, rig, card, plant_config, seed=0, target=None):
        n = rig.geometry.cables
        self.rig = rig
        self.target = target
        self.plant = Plant(rig, card, plant_config, seed, target)
        self.card = SimulatedQ8(self.plant, card, n, lockstep=True)
        self.card.start(card.watchdog)
        self.bridge = Bridge(rig, card)
        self.controller = LimbController(rig)
        self.mode = OperatingMode.STOPPED
        self.setpoint: TensionSetpoint | None = None
        self.now_s = 0.0
        self.tension = np.zeros((0, n))
        self.wrench = np.zeros((0, 6))
        self._poses: deque = deque()
        self._random = np.random.default_rng(seed)
        self._tick = 0

    def run(self, duration_s, until: Callable[[], bool] = lambda: False):
        """Run for a time, or until a condition; keep the true tensions and measured wrenches."""
        tension, wrench = [], []
        for _ in range(round(duration_s / PERIOD_S)):
            self.cycle()
            tension.append(self.plant.tension.copy())
            wrench.append(self.bridge.wrench.copy())
            if until():
                break
        self.tension, self.wrench = np.array(tension), np.array(wrench)
        return self.tension

    def cycle(self):
        """Advance by one sample."""
        sample = self.card.read()
        self._tick += 1
        self.now_s = 1e-9 * sample.time_ns
        self.tell_pose()
        self.bridge.take(sample, self.mode)
        self.answer()

    def answer(self):
        """Let the controllers answer the sample."""
        self.write(self.limb_currents(self.fresh_setpoint()))

    def fresh_setpoint(self):
        """The tensions set by hand, as an answer to the newest sample."""
        set_by_hand = self.setpoint
        if set_by_hand is None:
            return None
        return TensionSetpoint(self.now_s, set_by_hand.tension, set_by_hand.active)

    def limb_currents(self, setpoint):
        """(n,) of the limb controller [A]."""
        bridge = self.bridge
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
        return self.controller.step(state, self.mode, setpoint)

    def write(self, current):
        """Put (n,) currents on the amplifiers [A]."""
        self.card.write(self.bridge.volts(current))

    def tell_pose(self):
        """Let the target's pose reach the bridge; without a target it never changes."""
        if self.target is None:
            return
        if self._tick % 4 == 0:
            due = self._tick + int(self._random.integers(4, 9))
            pose = (self.now_s, self.target.position.copy(), self.target.rotation.copy())
            self._poses.append((due, *pose))
        while self._poses and self._poses[0][0] <= self._tick:
            self.hear_pose(*self._poses.popleft()[1:])

    def hear_pose(self, stamp_s, position, rotation):
        """Let a pose of a moment reach whoever uses it."""
        self.bridge.hear_pose(stamp_s, position, rotation)

    def pretighten(self):
        """Zero all limbs and let them settle at the holding tension."""
        self.mode = OperatingMode.PRETIGHTENING
        self.run(15.0, lambda: bool(self.bridge.zeroed.all()))
        assert self.bridge.zeroed.all()
        self.run(0.5)
