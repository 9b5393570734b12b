# SPDX-License-Identifier: Apache-2.0
"""The pose estimator's node beside bridge, guard, controllers and plant, in one process.

The node is the product's own: its inputs get the bytes that the bridge's node would send, every
45 ms; its answers are read where it publishes them. Nothing goes over DDS, so that nothing is lost
and an hour takes minutes. The robot has an absolute error, bends under the load and may have a
wrong tool; the tracker is not quite where the rig's files have it.
"""

from __future__ import annotations

import math
from collections import deque
from types import SimpleNamespace

import numpy as np
from cabols_msgs.msg import PoseAgreement, ReflectorMeasurement
from scipy.spatial.transform import Rotation

from cabols_control.frames import load_frames
from cabols_control.nodes.pose_estimator import PoseEstimatorNode
from cabols_control.rig import load_rig
from cabols_control.ros.messages import topics
from cabols_control.stamps import set_time
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety
from cabols_sim.fault_campaign.in_process.rig import HEARTBEAT_S, LockstepRig
from cabols_sim.plant.config import load_plant
from pose_sources import ELASTIC

COPY_EVERY = 45
"""Samples between two slow copies of a topic."""
RAMP_S, BRAKE_S = 0.6, 0.3
REFLECTOR_STD = 1.5e-5
PATH = (0.06, 0.06)
"""Speeds that the robot announces on a path under load [m/s], [rad/s]."""


def turned_by(x, y, z):
    """(3, 3) rotation by a vector [rad] (Rodrigues); scipy's costs 100 us a call."""
    angle = math.sqrt(x * x + y * y + z * z) or 1e-300
    c, s = math.cos(angle), math.sin(angle)
    x, y, z, v = x / angle, y / angle, z / angle, 1.0 - c
    return np.array(
        [
            [c + x * x * v, x * y * v - z * s, x * z * v + y * s],
            [y * x * v + z * s, c + y * y * v, y * z * v - x * s],
            [z * x * v - y * s, z * y * v + x * s, c + z * z * v],
        ]
    )


class Arm:
    """A robot that swings the platform about the reference pose, and stands when it is told to."""

    def __init__(self, rig, rng, swing, tool, rate=0.35):
        self._geometry, self._swing, self.tool = rig.geometry, np.repeat(swing, 3), tool
        self._rates = rate * rng.uniform(0.7, 1.1, 6)
        self._gains = rng.normal(0.0, 3e-4, (3, 3)), rng.normal(0.0, 3e-4, 3)
        self._noise = np.random.default_rng(rng.integers(2**31))
        self._along = self._rate = self._wanted = self._now_s = 0.0
        self._brakes_s = np.inf
        self._bent = np.zeros(6)
        self._place()

    def go(self):
        self._wanted = 1.0

    def halt(self):
        self._wanted = 0.0

    def stop(self):
        """Brake when the bridge's fault is noticed."""
        self._brakes_s = min(self._brakes_s, self._now_s + HEARTBEAT_S)

    @property
    def standing(self):
        return self._rate == 0.0

    def moved(self):
        """How far the platform is from where it started, by the robot [m], [rad]."""
        away = np.linalg.norm(self.commanded[0] - self._geometry.reference_position)
        turn = self.commanded[1] @ self._geometry.reference_rotation.T
        return away, Rotation.from_matrix(turn).magnitude()

    def told(self):
        """Pose as the robot reports it, with its tool's error."""
        place, rotation = self.commanded
        scatter = self._noise.standard_normal(6) * np.repeat([1.6e-5, 5e-5], 3)
        turn = turned_by(*self.tool[3:] + scatter[3:])
        return place + rotation @ self.tool[:3] + scatter[:3], rotation @ turn

    def step(self, wrench, dt_s):
        self._now_s += dt_s
        wanted = self._wanted if self._now_s < self._brakes_s else 0.0
        ramp = dt_s / (RAMP_S if self._now_s < self._brakes_s else BRAKE_S)
        self._rate += np.clip(wanted - self._rate, -ramp, ramp)
        self._along += dt_s * self._rate
        self._bent += (1.0 - np.exp(-dt_s / 0.02)) * (ELASTIC @ wrench - self._bent)
        self._place()
        return True

    def _place(self):
        move = self._swing * np.sin(self._rates * self._along)
        turn = turned_by(*move[3:])
        place = self._geometry.reference_position + move[:3]
        rotation = turn @ self._geometry.reference_rotation
        self.commanded = place, rotation
        gains, at = self._gains
        error = at + gains @ move[:3] / 0.3
        self.position = place + error + self._bent[:3]
        self.rotation = turned_by(*self._bent[3:]) @ rotation


class Waiting:
    """Stands in for a subscription: what was sent and not yet taken."""

    def __init__(self):
        self._messages, self._count = deque(), 0

    def send(self, message):
        self._count += 1
        self._messages.append(
            (message, {"publication_sequence_number": self._count, "received_timestamp": 1})
        )

    def take_message(self, msg_type, raw):
        del msg_type, raw
        return self._messages.popleft() if self._messages else None


class AgreementRig:
    """A rig with the node beside it.

    Attributes:
        rig: bridge, controllers and plant.
        arm: the robot.
        answers: of the node.
        bump: (3,) by which the tracker was moved, base axes [m].
    """

    def __init__(self, seed, swing=(0.04, 0.06), tool=None):
        self.rng = rng = np.random.default_rng(seed)
        model = load_rig()
        self.frames = load_frames()
        wrong = np.zeros(6) if tool is None else np.asarray(tool, dtype=np.float64)
        self.arm = Arm(model, rng, swing, wrong)
        self.rig = LockstepRig(model, load_card(), load_plant(), load_safety(), seed, self.arm)
        tracker = self.frames.tracker_frame
        self._tracker = np.array(tracker.position) + rng.normal(0.0, 2e-3, 3)
        off = Rotation.from_rotvec(rng.normal(0.0, 1e-3, 3)).as_matrix()
        self._tracker_axes = off @ tracker.rotation
        nests = np.asarray(self.frames.reflectors)
        self._nests = nests + rng.normal(0.0, 2e-4, nests.shape)
        self.bump = np.zeros(3)
        self.answers: list[PoseAgreement] = []
        self.node = node = PoseEstimatorNode()
        node._agreements = SimpleNamespace(publish=self.answers.append)
        node._poses = SimpleNamespace(publish=lambda _: None)
        inputs = (node._state, node._wrench, node._pose, node._reflectors)
        self._waiting = [Waiting() for _ in inputs]
        for heard, waiting in zip(inputs, self._waiting, strict=True):
            heard._handle = waiting
        geometry = model.geometry
        self._state = topics.limb_state_layout(geometry).record()
        self._wrench = topics.wrench_layout(geometry.platform_frame).record()
        self._pose = topics.pose_layout(geometry).record()
        self._tick = 0
        self._pose_phase = int(rng.integers(COPY_EVERY))

    @property
    def now_s(self):
        return self.rig.now_s

    @property
    def newest(self):
        return self.answers[-1] if self.answers else None

    @property
    def wound(self):
        """(n,) wound in by the plant's motors [m]."""
        return self.rig.plant._state["motor_position"].copy()

    def close(self):
        self.node.destroy_node()

    def run(self, seconds, until=lambda: False):
        """Run on; whether the condition ended it."""
        for _ in range(round(1000.0 * seconds)):
            self.cycle()
            if until():
                return True
        return False

    def cycle(self):
        self.rig.cycle()
        self._tick += 1
        stamp = round(1e9 * self.rig.now_s)
        if self._tick % COPY_EVERY == self._pose_phase:
            place, rotation = self.arm.told()
            self._pose.stamp(stamp)
            self._pose["pose"][:3] = place
            self._pose["pose"][3:] = Rotation.from_matrix(rotation).as_quat()
            self._waiting[2].send(self._pose.raw())
        if self._tick % COPY_EVERY == 0:
            self._send(stamp)
            self.node.tick()

    def _send(self, stamp):
        bridge = self.rig.bridge
        for name in ("wound_length", "elongation", "tension", "switch_closed", "zeroed"):
            self._state[name][:] = getattr(bridge, name)
        self._state["zeroing"][:] = bridge.zeroing
        self._state.stamp(stamp)
        self._wrench["wrench"][:] = bridge.wrench
        self._wrench.stamp(stamp)
        self._waiting[0].send(self._state.raw())
        self._waiting[1].send(self._wrench.raw())

    def start(self):
        """Tare, and give all limbs their zeros."""
        self.run(0.3)
        self.tighten()

    def tighten(self):
        """Pre-tighten: new zeros."""
        rig = self.rig
        rig.mode, rig.zeroing = OperatingMode.PRETIGHTENING, rig.zeroing + 1
        self.run(0.1)
        self.run(15.0, lambda: bool(rig.bridge.zeroed.all()) or rig.guard.fault is not None)
        self.run(0.5)

    def follow(self):
        """Let the limbs follow the robot, which moves."""
        self.rig.mode = OperatingMode.FREE_MOVING
        self.run(0.3)
        self.arm.go()

    def stand(self):
        """Stop the robot and wait until all is still."""
        self.arm.halt()
        self.run(3.0, lambda: self.arm.standing)
        self.run(0.6)

    def load(self, wrench):
        """Apply a (6,) wrench; the robot may move by what it announces."""
        self.rig.mode, self.rig.desired = OperatingMode.LOADING, np.array(wrench)
        self.rig.path = PATH
        self.run(1.0)

    def unload(self):
        self.stand()
        self.rig.desired[:] = 0.0
        self.run(0.8)
        self.rig.mode = OperatingMode.UNLOADING
        self.run(1.0)
        self.rig.path = None

    def measure(self, reflector, averaging=0.3):
        """Let the tracker measure a reflector; the node's answer comes by the next copies."""
        began = self.rig.now_s
        self.run(averaging)
        point = self.arm.position + self.arm.rotation @ self._nests[reflector]
        noise = REFLECTOR_STD * self.rng.standard_normal(3)
        seen = self._tracker_axes.T @ (point - self._tracker - self.bump) + noise
        message = ReflectorMeasurement(reflector=reflector, success=True, averaging_time=averaging)
        set_time(message.header.stamp, round(1e9 * (began + 0.5 * averaging)))
        message.position.x, message.position.y, message.position.z = map(float, seen)
        message.covariance = (REFLECTOR_STD**2 * np.eye(3)).ravel()
        self._waiting[3].send(message)
        self.run(0.25)
        return self.newest

    def exchange_encoders(self, i, j):
        """Exchange two encoders' plugs: from now on each counter counts the other's way."""
        plant = self.rig.plant
        sense = plant.sense
        at = sense()[0]

        def exchanged():
            counts, volts, lines = sense()
            ways = counts[[j, i]] - at[[j, i]]
            counts[[i, j]] = at[[i, j]] + ways
            return counts, volts, lines

        plant.sense = exchanged
