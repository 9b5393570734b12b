# SPDX-License-Identifier: Apache-2.0
"""A rig as its sensors see it, written apart from the product: for the pose estimator.

Springs that soften with the cables' lengths, a robot with an absolute error that bends under the
load, a tracker set down millimetres from its nominal place, reflectors' nests tenths off, copies of
topics at times of their own. One thing at a time can be made wrong.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.frames import load_frames
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.pose_agreement import LimbSample, Measured, PoseEstimator
from cabols_control.rig import load_rig

RIG, FRAMES = load_rig(), load_frames()
GEOMETRY = RIG.geometry
PERIOD_S = 0.045
SWITCH_M = RIG.limbs.switch_tension / RIG.limbs.stiffness
ELASTIC = np.array(
    # J K^-1 J^T of the bench's robot at its first configuration [m/N, rad/N, rad/(N m)].
    [
        [4.15e-6, -8.79e-7, 3.21e-7, 4.51e-6, 1.01e-5, -1.05e-5],
        [-8.79e-7, 1.49e-6, -2.03e-6, -1.07e-5, 8.27e-8, 4.51e-6],
        [3.21e-7, -2.03e-6, 7.92e-6, 2.70e-5, -6.65e-6, -4.59e-6],
        [4.51e-6, -1.07e-5, 2.70e-5, 1.50e-4, 8.38e-5, 1.16e-5],
        [1.01e-5, 8.27e-8, -6.65e-6, 8.38e-5, 4.25e-4, 1.27e-4],
        [-1.05e-5, 4.51e-6, -4.59e-6, 1.16e-5, 1.27e-4, 1.02e-4],
    ]
)
STOP_S, GO_S = 6.0, 8.0
"""The platform stands and moves in turn, smoothly."""


class Sources:
    """What bridge, robot and tracker of a rig send, into an estimator.

    Attributes:
        slip: (n,) of the cables [m].
        order: (n,) whose encoder each limb shows.
        tool: (6,) error of the robot's tool, platform axes [m], [rad].
        bump: (3,) of the tracker, base axes [m].
    """

    def __init__(self, seed, swing_m=0.05, swing_rad=0.08, tension=(30.0, 20.0), tool=None):
        self.rng = rng = np.random.default_rng(seed)
        self.swing = np.repeat([swing_m, swing_rad], 3)
        self.phase = rng.uniform(0.0, 2.0 * np.pi, (2, 8))
        self.rate = rng.uniform(0.25, 0.4, (2, 8))
        self.tension = tension
        self.spring = 2768.0 * (1.0 + rng.uniform(-0.01, 0.01, 8))
        self.slip, self.order, self.bump = np.zeros(8), np.arange(8), np.zeros(3)
        self.tool = np.zeros(6) if tool is None else np.asarray(tool, dtype=np.float64)
        self.absolute = rng.normal(0.0, 3e-4, (3, 3)), rng.normal(0.0, 3e-4, 3)
        self.place = np.array(FRAMES.tracker_frame.position) + rng.normal(0.0, 2e-3, 3)
        off = Rotation.from_rotvec(rng.normal(0.0, 1e-3, 3)).as_matrix()
        self.axes = off @ FRAMES.tracker_frame.rotation
        nests = np.asarray(FRAMES.reflectors)
        self.nests = nests + rng.normal(0.0, 2e-4, nests.shape)
        self.estimator = PoseEstimator(RIG, FRAMES)
        self.now = 0.0
        position, rotation, _ = self.truth(0.0)
        self.zero_length = cable_lengths(GEOMETRY, position, rotation)
        shown = self.reported(0.0, noise=False)
        self.shown_zero = cable_lengths(GEOMETRY, *shown)
        self.travelled, self.turned = 0.0, 0.0
        self._start = shown

    def path_time(self, time_s):
        """Time along the path: it stands for STOP_S, goes for GO_S."""
        whole, part = divmod(time_s, STOP_S + GO_S)
        share = np.clip((part - STOP_S) / GO_S, 0.0, 1.0)
        return GO_S * (whole + share * share * (3.0 - 2.0 * share))

    def standing(self):
        """Whether the platform stands, and has for a second."""
        return 1.2 < self.now % (STOP_S + GO_S) < STOP_S

    def commanded(self, time_s):
        along = self.path_time(time_s)
        move = self.swing * np.sin(self.rate[0, :6] * along)
        turn = Rotation.from_rotvec(move[3:]).as_matrix()
        return GEOMETRY.reference_position + move[:3], turn @ GEOMETRY.reference_rotation

    def pulls(self, time_s):
        mean, swing = self.tension
        rise = 1.0 - np.exp(-time_s / 2.0)
        wave = np.sin(self.rate[1] * time_s + self.phase[1])
        return 6.0 + rise * (mean - 6.0 + swing * wave)

    def truth(self, time_s):
        """Pose of the platform, bent by the load, and its tensions."""
        place, rotation = self.commanded(time_s)
        pulls = self.pulls(time_s)
        gains, at = self.absolute
        error = at + gains @ (place - GEOMETRY.reference_position) / 0.3
        bent = ELASTIC @ (structure_matrix(GEOMETRY, place, rotation) @ pulls)
        turn = Rotation.from_rotvec(bent[3:]).as_matrix()
        return place + error + bent[:3], turn @ rotation, pulls

    def reported(self, time_s, noise=True):
        """Pose by the robot, with its tool's error."""
        place, rotation = self.commanded(time_s)
        scatter = noise * self.rng.standard_normal(6) * np.repeat([1.6e-5, 5e-5], 3)
        turn = Rotation.from_rotvec(self.tool[3:] + scatter[3:]).as_matrix()
        return place + rotation @ self.tool[:3] + scatter[:3], rotation @ turn

    def step(self):
        """Send one copy of each topic; return the newest answer."""
        self.now += PERIOD_S
        late = self.now - self.rng.uniform(0.0, PERIOD_S)
        pose = self.reported(late)
        self.estimator.joiner.pose(late, *pose)
        position, rotation, pulls = self.truth(self.now)
        length = cable_lengths(GEOMETRY, position, rotation)
        stiffness = 1.0 / (1.0 / self.spring + 6.55e-5 * length)
        wound = pulls / stiffness - (length - self.zero_length)
        shown = (wound + self.slip)[self.order] + 5e-6 * self.rng.standard_normal(8)
        here = cable_lengths(GEOMETRY, *self.reported(self.now, noise=False))
        elongation = shown + here - self.shown_zero
        wrench = structure_matrix(GEOMETRY, position, rotation) @ pulls
        wrench = (wrench.reshape(2, 3) @ rotation).ravel()
        wrench += self.rng.standard_normal(6) * np.repeat([0.03, 0.003], 3)
        self.estimator.joiner.wrench(self.now, wrench)
        self.estimator.limbs(LimbSample(self.now, shown, elongation, 1))
        return self.estimator.look()

    def run(self, seconds):
        for _ in range(round(seconds / PERIOD_S)):
            found = self.step()
        return found

    def stop(self):
        """Go on until the platform has stood for a second."""
        while not self.standing():
            self.step()
        return self.step()

    def measure(self, reflector, averaging=0.5):
        """Measure a reflector where the platform stands; return the answer behind it."""
        begin = self.now
        self.run(averaging)
        position, rotation, _ = self.truth(0.5 * (begin + self.now))
        point = position + rotation @ self.nests[reflector]
        seen = self.axes.T @ (point - self.place - self.bump) + 1.5e-5 * self.rng.standard_normal(3)
        self.estimator.measured(Measured(begin, self.now, reflector, seen, 1.5e-5))
        return self.run(0.3)
