# SPDX-License-Identifier: Apache-2.0
"""Campaigns of the hidden robot, the ladder's predictions of it, and the truth beside them."""

from __future__ import annotations

import numpy as np

from cabols_control.rig_folder import rig_file
from cabols_control.serial_arms.arm import read_serial_arm
from cabols_sim.mismatch.campaign import measure
from cabols_sim.mismatch.hidden_robot import HiddenRobot
from cabols_sim.mismatch.settings import Variety, draw_settings
from cabols_stiffness import PointSamples

TOOL = np.array([0.0, 0.0, 0.15])
REFLECTORS = np.array([[0.07, 0.12, -0.02], [-0.07, 0.12, -0.02], [0.0, 0.09, 0.1]])
MIDDLE = np.array([1.2, 0.3, -0.2, 0.4, 0.8, 0.3])
SPREAD = np.array([0.5, 0.4, 0.4, 1.2, 0.6, 1.5])
LIMITS = np.array([100.0] * 3 + [10.0] * 3)


def configurations(random, count):
    """(count, 6) within the workspace [rad]."""
    return MIDDLE + random.uniform(-1.0, 1.0, (count, 6)) * SPREAD


def wrenches(random, count):
    """(count, 6) whose largest component is at its limit [N, N m]."""
    drawn = random.normal(size=(count, 6))
    return drawn / np.abs(drawn).max(axis=1, keepdims=True) * LIMITS


def hidden_robot(seed, variety):
    """A robot drawn by a seed."""
    arm = read_serial_arm(rig_file("robot.urdf"))
    on_flange = arm.flange_position + arm.flange_rotation @ TOOL
    return HiddenRobot(draw_settings(seed, Variety(variety), arm, on_flange), arm, TOOL)


def campaign(robot, seed, count=24, peaks=6, **more):
    """Samples of a campaign; tracker and sensor state their usual noise."""
    random = np.random.default_rng([seed, 1])
    Q = configurations(random, count)
    W = wrenches(random, count * peaks).reshape(count, peaks, 6)
    columns = measure(robot, Q, W, REFLECTORS, seed, **more)
    k, deviation = len(columns["time"]), np.array([0.2] * 3 + [0.02] * 3)
    return PointSamples(
        **columns,
        wrench_covariance=np.repeat(np.diag(deviation**2)[None], k, axis=0),
        position_covariance=np.repeat((np.eye(3) * 15e-6**2)[None], k, axis=0),
    )


class HeldOut:
    """Configurations and loads that no campaign has seen, and what the robot really does there.

    Attributes:
        joints: (k, 6) [rad].
        wrench: (k, 6) tool axes [N, N m].
        moved: (k, 6) noise-free deflection, base axes [m, rad].
        floor: (k, 6) that of the same robot at its mean compliance.
    """

    def __init__(self, robot, seed, count=12, loads=6):
        random = np.random.default_rng([seed, 2])
        Q, W = configurations(random, count), wrenches(random, count * loads)
        self.robot, self.joints = robot, np.repeat(Q, loads, axis=0)
        self.wrench = W
        self._factor = np.repeat(robot.factor(Q, seed + 1000), loads, axis=0)
        self._start, held = robot.rest(self.joints, self._factor)
        self.moved = self._difference(robot.load(self.joints, W, self._factor, held)[0])
        ones = np.ones_like(self._factor)
        start, held = robot.rest(self.joints, ones)
        self.floor = _difference(start, robot.load(self.joints, W, ones, held)[0])

    def _difference(self, pose):
        return _difference(self._start, pose)

    def left(self, command):
        """(k, 6) deflection that is left at joint commands (k, 6)."""
        _, held = self.robot.rest(command, self._factor)
        return self._difference(self.robot.load(command, self.wrench, self._factor, held)[0])


def _difference(start, pose):
    turned = pose[:, :3, :3] @ start[:, :3, :3].swapaxes(1, 2)
    skew = 0.5 * (turned - turned.swapaxes(1, 2))
    vector = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    return np.concatenate([pose[:, :3, 3] - start[:, :3, 3], vector], axis=1)


def rms(values):
    """Root mean square of the translations."""
    return float(np.sqrt(np.mean(values[:, :3] ** 2)))
