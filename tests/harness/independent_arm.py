# SPDX-License-Identifier: Apache-2.0
"""An elastic serial robot that is none of the project's code, its URDF parser, loads and noise.

Product of homogeneous matrices, fixed-point statics. Noise unless said: reflector 15 um, sensor
0.2 N and 0.02 N m.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from cabols_control.rig_folder import rig_file
from cabols_stiffness import PointSamples, load_robot

URDF = rig_file("robot.urdf")
STIFFNESS = np.array([966398.0, 731208.0, 317900.0, 13277.0, 7744.0, 2141.0])
"""Of the joints [N m/rad]."""
REFLECTORS = np.array([[0.07, 0.12, -0.02], [-0.07, 0.12, -0.02], [0.0, 0.09, 0.1]])
"""In tool axes [m]."""
TOOL_POSITION = [0.0, 0.0, 0.15]
MIDDLE = np.array([1.2, 0.3, -0.2, 0.4, 0.8, 0.3])
SPREAD = np.array([0.5, 0.4, 0.4, 1.2, 0.6, 1.5])
"""Configurations lie within MIDDLE +- SPREAD [rad]."""


def skew(vector):
    """Matrix of the cross product."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def turn(vector):
    """(3, 3) of a rotation vector [rad]."""
    angle = np.linalg.norm(vector)
    if angle < 1e-14:
        return np.eye(3) + skew(vector)
    k = skew(np.asarray(vector) / angle)
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k


def placed(rotation, position):
    """(4, 4) homogeneous matrix."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


TOOL = placed(np.eye(3), TOOL_POSITION)


def _numbers(element, name):
    text = element.get(name) if element is not None else None
    return [float(value) for value in (text or "0 0 0").split()]


class Chain:
    """Joints (transform before, axis, whether it slides) of a URDF from its base to a tip."""

    def __init__(self, urdf=URDF, tip="tool0"):
        joints = {
            joint.find("child").get("link"): joint
            for joint in ET.parse(urdf).getroot().findall("joint")
        }
        order, at = [], np.eye(4)
        while tip in joints:
            order.append(joints[tip])
            tip = order[-1].find("parent").get("link")
        self.joints = []
        for joint in reversed(order):
            origin = joint.find("origin")
            roll, pitch, yaw = _numbers(origin, "rpy")
            rotation = turn([0, 0, yaw]) @ turn([0, pitch, 0]) @ turn([roll, 0, 0])
            at = at @ placed(rotation, _numbers(origin, "xyz"))
            if joint.get("type") in ("revolute", "continuous", "prismatic"):
                axis = np.array(_numbers(joint.find("axis"), "xyz"))
                slides = joint.get("type") == "prismatic"
                self.joints.append((at, axis / np.linalg.norm(axis), slides))
                at = np.eye(4)
        self.tip = at

    def frames(self, q, virtual=None):
        """Flange, [(axis, point)] of the joints, link frames from the base on.

        virtual: (n + 1, 6) small motions of bearings, the base's first [m, rad].
        """
        matrix, axes = np.eye(4), []
        if virtual is not None:
            matrix = placed(turn(virtual[0, 3:]), virtual[0, :3])
        frames = [matrix]
        for i, (before, axis, slides) in enumerate(self.joints):
            matrix = matrix @ before
            axes.append((matrix[:3, :3] @ axis, matrix[:3, 3].copy()))
            moved = (
                placed(np.eye(3), axis * q[i]) if slides else placed(turn(axis * q[i]), [0, 0, 0])
            )
            matrix = matrix @ moved
            if virtual is not None:
                matrix = matrix @ placed(turn(virtual[i + 1, 3:]), virtual[i + 1, :3])
            frames.append(matrix)
        return matrix @ self.tip, axes, frames

    def settle(self, q, wrench, stiffness=STIFFNESS, friction=0.0, bearings=None, follows=True):
        """Loaded tool pose (4, 4) and joint deflections (n,) [rad].

        Args:
            q: (n,) [rad].
            wrench: (6,) at the tool, in its axes if it follows them, else in base axes [N, N m].
            stiffness: (n,) or (n, n) [N m/rad].
            friction: (n,) torque that is held back [N m].
            bearings: (n + 1, 6) stiffness of virtual joints, the base's first; None: rigid.
            follows: whether the wrench turns with the tool.
        """
        matrix = np.diag(stiffness) if np.ndim(stiffness) == 1 else np.asarray(stiffness)
        deflection = np.zeros(len(self.joints))
        virtual = None if bearings is None else np.zeros((len(self.joints) + 1, 6))
        for _ in range(60 if virtual is None else 12):
            flange, axes, frames = self.frames(q + deflection, virtual)
            pose = flange @ TOOL
            rotation, point = pose[:3, :3], pose[:3, 3]
            force, moment = wrench[:3], wrench[3:]
            if follows:
                force, moment = rotation @ force, rotation @ moment
            torque = [
                z @ force if slides else z @ (np.cross(point - origin, force) + moment)
                for (z, origin), (_, _, slides) in zip(axes, self.joints, strict=True)
            ]
            new = np.linalg.solve(matrix, np.array(torque) - friction)
            if virtual is not None:
                virtual = np.array(
                    [
                        np.r_[
                            F[:3, :3].T @ force,
                            F[:3, :3].T @ (moment + np.cross(point - F[:3, 3], force)),
                        ]
                        / bearing
                        for F, bearing in zip(frames, bearings, strict=True)
                    ]
                )
            done = np.abs(new - deflection).max() < 1e-14
            deflection = new
            if done and virtual is None:
                break
        return self.frames(q + deflection, virtual)[0] @ TOOL, deflection


def robot():
    """The project's model of the same robot."""
    return load_robot(tool_position=TOOL_POSITION)


def configurations(rng, count):
    """(count, 6) [rad]."""
    return MIDDLE + rng.uniform(-1.0, 1.0, (count, 6)) * SPREAD


def loads(rng, count, force_n=100.0, torque_nm=10.0):
    """(count, 6) wrenches whose largest component is at its limit."""
    drawn = rng.normal(size=(count, 6))
    limits = np.array([force_n] * 3 + [torque_nm] * 3)
    return drawn / np.abs(drawn).max(axis=1, keepdims=True) * limits


COLUMNS = (
    *("configuration", "load", "branch", "reflector", "group", "time"),
    *("joints", "wrench", "offset", "position"),
)


def truth(Q, W, settle, reflectors=REFLECTORS, down=False):
    """Noise-free columns of a campaign: a pass (group) for each configuration and reflector.

    Args:
        Q: configurations.
        W: wrenches.
        settle: (i, q, wrench) gives the loaded pose first.
        reflectors: (k, 3).
        down: with an unloading branch.
    """
    rows, group = [], 0
    for i, q in enumerate(Q):
        for r, offset in enumerate(reflectors):
            sequence = [(0, 0, np.zeros(6))] + [(j + 1, 1, w) for j, w in enumerate(W)]
            if down:
                sequence += [(j + 1, -1, w) for j, w in reversed(list(enumerate(W)))]
            sequence.append((100, 0, np.zeros(6)))
            for load, branch, wrench in sequence:
                pose = settle(i, q, wrench)[0]
                position = pose[:3, :3] @ offset + pose[:3, 3]
                time = float(len(rows) + 1)
                rows.append((i, load, branch, r, group, time, q, wrench, offset, position))
            group += 1
    return dict(zip(COLUMNS, map(np.array, zip(*rows, strict=True)), strict=True))


def noisy(columns, rng, position_m=15e-6, force_n=0.2, torque_nm=0.02, stated_m=None):
    """Samples with noise; stated_m: what their covariance says of the position."""
    k, deviation = len(columns["time"]), np.array([force_n] * 3 + [torque_nm] * 3)
    said = np.eye(3) * (stated_m or position_m) ** 2
    return PointSamples(
        **columns
        | {
            "position": columns["position"] + rng.normal(size=(k, 3)) * position_m,
            "wrench": columns["wrench"] + rng.normal(size=(k, 6)) * deviation,
            "position_covariance": np.repeat(said[None], k, axis=0),
            "wrench_covariance": np.repeat(np.diag(deviation**2)[None], k, axis=0),
        }
    )
