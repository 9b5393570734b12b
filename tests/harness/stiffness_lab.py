# SPDX-License-Identifier: Apache-2.0
"""Laboratories that measure a loaded robot: data sets drawn by seed, and what may be wrong in them.

Nothing of the estimator makes the numbers: poses are products of homogeneous matrices, the loaded
arm is a fixed point of its joints' torques.
"""

from __future__ import annotations

import functools
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import independent_arm as arm
import serial_robots
from cabols_stiffness import PointSamples, Samples, load_robot

FORCE = {
    "irb1600": (100.0, 10.0),
    "ur10": (60.0, 15.0),
    "irb6640": (1500.0, 300.0),
    "kr210": (2000.0, 400.0),
    "iiwa": (40.0, 10.0),
}
"""Largest force and torque of a load [N, N m]."""


class Arm:
    """Many poses of a chain at a time."""

    def __init__(self, chain, tool=arm.TOOL):
        """Take over a chain's joints."""
        self.chain, self.tool = chain, tool
        self.slides = np.array([slides for _, _, slides in chain.joints])

    @property
    def n(self):
        """Number of joints."""
        return len(self.chain.joints)

    def poses(self, q):
        """Tool poses (k, 4, 4), axes (k, n, 3) and points (k, n, 3) of the joints."""
        k = len(q)
        matrix, axes, points = np.broadcast_to(np.eye(4), (k, 4, 4)), [], []
        for j, (before, axis, slides) in enumerate(self.chain.joints):
            matrix = matrix @ before
            axes.append(matrix[:, :3, :3] @ axis)
            points.append(matrix[:, :3, 3])
            moved = np.tile(np.eye(4), (k, 1, 1))
            if slides:
                moved[:, :3, 3] = q[:, j, None] * axis
            else:
                cross = arm.skew(axis)
                sine, rest = np.sin(q[:, j]), 1.0 - np.cos(q[:, j])
                moved[:, :3, :3] += sine[:, None, None] * cross
                moved[:, :3, :3] += rest[:, None, None] * (cross @ cross)
            matrix = matrix @ moved
        matrix = matrix @ self.chain.tip @ self.tool
        return matrix, np.stack(axes, axis=1), np.stack(points, axis=1)

    def settle(self, q, wrench, stiffness, follows=True):
        """Poses (k, 4, 4) under wrenches (k, 6) at the tool, with stiffness (k, n) or (n,)."""
        deflection = np.zeros_like(q)
        for _ in range(60):
            pose, axes, points = self.poses(q + deflection)
            force, moment = wrench[:, :3], wrench[:, 3:]
            if follows:
                force = np.einsum("kij,kj->ki", pose[:, :3, :3], force)
                moment = np.einsum("kij,kj->ki", pose[:, :3, :3], moment)
            lever = pose[:, None, :3, 3] - points
            torque = np.cross(lever, force[:, None]) + moment[:, None]
            torque = np.where(self.slides[:, None], force[:, None], torque)
            new = np.einsum("kji,kji->kj", axes, torque) / stiffness
            done = np.abs(new - deflection).max() < 1e-13
            deflection = new
            if done:
                break
        return self.poses(q + deflection)[0]


@functools.cache
def robot_of(name):
    """The chain and the project's model of a robot."""
    if name == "irb1600":
        return Arm(arm.Chain()), arm.robot(), arm.STIFFNESS
    with tempfile.TemporaryDirectory() as folder:
        path = serial_robots.urdf(Path(folder), name)
        chain = arm.Chain(path)
        robot = load_robot(path, tool_position=arm.TOOL_POSITION)
    return Arm(chain), robot, serial_robots.STIFFNESS[name]


@dataclass(frozen=True)
class Design:
    """What a laboratory measures.

    Attributes:
        robot: by its name.
        configurations: their number.
        loads: of each.
        reflectors: seen in a pass each; 0: whole poses.
        position_m: noise of a position.
        force: of the largest load, noise of a force.
        scatter: of the stiffness from configuration to configuration, relative.
        size: of the loads, relative to FORCE.
        spread: of the joints about the middle [rad].
    """

    robot: str = "irb1600"
    configurations: int = 6
    loads: int = 4
    reflectors: int = 3
    position_m: float = 15e-6
    force: float = 2e-3
    scatter: float = 0.0
    size: float = 1.0
    spread: float = 1.0


def drawn_design(rng, scattered=None):
    """Draw a design; scattered: True, False, or as often as not."""
    many = bool(rng.random() < 0.5) if scattered is None else scattered
    return Design(
        robot=str(rng.choice(list(FORCE))),
        configurations=int(rng.integers(5, 16)),
        loads=int(rng.integers(4, 11)),
        reflectors=int(rng.choice([0, 1, 3])),
        position_m=float(np.exp(rng.uniform(*np.log([5e-6, 5e-5])))),
        force=float(np.exp(rng.uniform(*np.log([5e-4, 5e-3])))),
        scatter=float(rng.uniform(0.05, 0.3)) if many else 0.0,
        size=float(rng.uniform(0.5, 1.5)),
        spread=float(rng.uniform(0.6, 1.4)),
    )


def measure(design, rng):
    """Samples of a data set in which nothing is wrong, its robot, its (c, n) true stiffness."""
    body, robot, stiffness = robot_of(design.robot)
    n, force, torque = body.n, *(design.size * np.array(FORCE[design.robot]))
    middle = np.resize(arm.MIDDLE, n) if design.robot == "irb1600" else np.full(n, 0.2)
    Q = middle + design.spread * rng.uniform(-1.0, 1.0, (design.configurations, n))
    W = arm.loads(rng, design.loads, force, torque)
    true = np.tile(stiffness, (design.configurations, 1)).astype(float)
    true = true / (1.0 + design.scatter * np.clip(rng.normal(size=true.shape), -2.5, 2.5))
    rows = _sequence(design)
    loaded = np.vstack([np.zeros(6), W])[rows["load"]]
    q, own = Q[rows["configuration"]], true[rows["configuration"]]
    deviation = design.force * np.repeat([force, torque], 3)
    k = len(q)
    noise = rng.normal(size=(k, 6)) * deviation
    covariance = np.repeat(np.diag(deviation**2)[None], k, axis=0)
    follows = design.reflectors > 0
    pose = body.settle(q, loaded, own, follows)
    if follows:
        offset = np.array(arm.REFLECTORS)[rows["reflector"]]
        position = np.einsum("kij,kj->ki", pose[:, :3, :3], offset) + pose[:, :3, 3]
        position = position + rng.normal(size=(k, 3)) * design.position_m
        samples = PointSamples(
            **rows,
            time=np.arange(k) + 1.0,
            joints=q,
            wrench=loaded + noise,
            wrench_covariance=covariance,
            offset=offset,
            position=position,
            position_covariance=np.repeat(np.eye(3)[None] * design.position_m**2, k, axis=0),
        )
        return samples, robot, true
    start = body.poses(q)[0]
    turned = pose[:, :3, :3] @ start[:, :3, :3].swapaxes(1, 2)
    from scipy.spatial.transform import Rotation

    sigma = np.repeat([design.position_m, 4.0 * design.position_m], 3)
    moved = np.hstack([pose[:, :3, 3] - start[:, :3, 3], Rotation.from_matrix(turned).as_rotvec()])
    samples = Samples(
        configuration=rows["configuration"],
        load=rows["load"],
        branch=rows["branch"],
        joints=q,
        wrench=loaded + noise,
        wrench_covariance=covariance,
        deflection=moved + rng.normal(size=(k, 6)) * sigma,
        deflection_covariance=np.repeat(np.diag(sigma**2)[None], k, axis=0),
    )
    return samples, robot, true


def _sequence(design):
    """Rows of configuration, load, branch, reflector, group in the order of measurement."""
    rows, group = [], 0
    for i in range(design.configurations):
        for r in range(max(design.reflectors, 1)):
            sequence = [*range(1, design.loads + 1)]
            if design.reflectors:
                sequence = [0, *sequence, 0]
            rows += [(i, load, int(load > 0), r, group) for load in sequence]
            group += 1
    names = ("configuration", "load", "branch", "reflector", "group")
    return dict(zip(names, np.array(rows).T, strict=True))


def _moved(samples, position, offset=None, factor=1.0):
    """Points with other positions; of poses the deflection by the same function."""
    if isinstance(samples, PointSamples):
        changed = replace(samples, position=position(samples.position))
        return changed if offset is None else replace(changed, offset=offset(samples.offset))
    halves = samples.deflection.reshape(-1, 2, 3)
    turned = np.stack([position(halves[:, 0]), halves[:, 1]], axis=1)
    return replace(samples, deflection=turned.reshape(-1, 6))


def exchanged(i, j):
    """Columns of two joints."""

    def change(samples):
        order = np.arange(samples.joints.shape[1])
        order[[i, j]] = j, i
        return replace(samples, joints=samples.joints[:, order])

    return change


def joint_changed(j, factor=1.0, shift=0.0):
    """One joint's sign, unit or zero."""

    def change(samples):
        joints = samples.joints.copy()
        joints[:, j] = factor * joints[:, j] + shift
        return replace(samples, joints=joints)

    return change


def wrench_times(factors):
    """Sign or unit of the wrench's axes; the covariance is stated in the same unit."""
    factor = np.broadcast_to(np.asarray(factors, dtype=float), 6)

    def change(samples):
        covariance = samples.wrench_covariance * np.outer(factor, factor)
        return replace(samples, wrench=samples.wrench * factor, wrench_covariance=covariance)

    return change


def wrench_axes(matrix):
    """Wrench in other axes."""
    both = np.kron(np.eye(2), matrix)

    def change(samples):
        covariance = both @ samples.wrench_covariance @ both.T
        return replace(samples, wrench=samples.wrench @ both.T, wrench_covariance=covariance)

    return change


def tracker_axes(matrix):
    """Positions, or whole deflections, in other axes."""

    def change(samples):
        if isinstance(samples, PointSamples):
            return replace(samples, position=samples.position @ matrix.T)
        both = np.kron(np.eye(2), matrix)
        return replace(samples, deflection=samples.deflection @ both.T)

    return change


def whole_lengths(factor):
    """Positions and reflectors in another unit; of poses the translations."""

    def change(samples):
        if isinstance(samples, PointSamples):
            return replace(
                samples,
                position=factor * samples.position,
                offset=factor * samples.offset,
                position_covariance=factor**2 * samples.position_covariance,
            )
        scale = np.repeat([factor, 1.0], 3)
        return replace(
            samples,
            deflection=samples.deflection * scale,
            deflection_covariance=samples.deflection_covariance * np.outer(scale, scale),
        )

    return change


def rotations_times(factor):
    """Rotations of poses in another unit, or of the other sign."""

    def change(samples):
        scale = np.repeat([1.0, factor], 3)
        return replace(
            samples,
            deflection=samples.deflection * scale,
            deflection_covariance=samples.deflection_covariance * np.outer(scale, scale),
        )

    return change


def mistakes(design, n):
    """(name, change) of every mistake that a data set of a design may hold."""
    turn_z = arm.turn([0.0, 0.0, np.pi / 2.0])
    turn_x = arm.turn([np.pi / 2.0, 0.0, 0.0])
    mirror = np.diag([1.0, -1.0, 1.0])
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    whole, torque = np.ones(6), np.repeat([0.0, 1.0], 3)
    for i in range(n):
        for j in range(i + 1, n):
            yield f"joints {i + 1} and {j + 1} exchanged", exchanged(i, j)
    for j in range(n):
        yield f"sign of joint {j + 1}", joint_changed(j, -1.0)
        yield f"zero of joint {j + 1} by 90 deg", joint_changed(j, shift=np.pi / 2.0)
    yield "sign of the wrench", wrench_times(-whole)
    yield "sign of the forces", wrench_times(2.0 * torque - 1.0)
    yield "sign of the torques", wrench_times(1.0 - 2.0 * torque)
    for factor in (1e3, 1.0 / 0.0254, 9.80665, 1e-3):
        yield f"torques times {factor:.4g}", wrench_times(1.0 + (factor - 1.0) * torque)
    yield "forces in kN", wrench_times(1e-3 + (1.0 - 1e-3) * torque)
    yield "joints in degrees", lambda s: replace(s, joints=np.degrees(s.joints))
    for name, matrix in (
        ("turned by 90 deg about z", turn_z),
        ("turned by 90 deg about x", turn_x),
        ("mirrored", mirror),
        ("x and y exchanged", swap),
    ):
        yield f"wrench {name}", wrench_axes(matrix)
        yield f"tracker {name}", tracker_axes(matrix)
    yield "forces and torques exchanged", lambda s: replace(s, wrench=np.roll(s.wrench, 3, axis=1))
    for factor in (1e3, 1.0 / 0.0254):
        yield f"lengths times {factor:.4g}", whole_lengths(factor)
    if design.reflectors == 0:
        for factor in (180.0 / np.pi, 1e3, -1.0):
            yield f"rotations times {factor:.4g}", rotations_times(factor)
