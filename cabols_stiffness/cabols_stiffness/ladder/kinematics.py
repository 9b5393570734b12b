# SPDX-License-Identifier: Apache-2.0
"""Kinematic errors and weights of the links, from where the unloaded references are.

A group's constant part says nothing of stiffness, but it says where the unloaded robot was. Over
many configurations those places show where joints are not where the URDF has them, and how far the
links' weights bend the arm. The tracker's frame and the reflectors' places on the tool are unknown
beside them. As for the ladder, an effect is taken only if configurations that were held out are
predicted better. Weights move a loaded robot like the unloaded one, so they are told, not used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cabols_control.checks import FloatArray, IntArray
from cabols_control.rotations import cross_matrix
from cabols_stiffness.identification.elastic_observations import residual_of
from cabols_stiffness.identification.observations import Observations
from cabols_stiffness.ladder.choose import BEYOND_DOUBT, LEAST_GAIN, Step
from cabols_stiffness.ladder.evidence import HeldOut, Rows, held_out, solve
from cabols_stiffness.ladder.fit import ElasticFit
from cabols_stiffness.measurements.samples import REFERENCE, PointSamples
from cabols_stiffness.model.elastic.blocks import Joints, Statics
from cabols_stiffness.model.model_words import Rung
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import exponential

CONFIGURATIONS_LEAST = 8
REPEATABILITY_M = 20e-6
"""Standard deviation with which a robot comes back to a configuration [m]."""

ABSURD_M = 0.05
"""Residual of a reference beyond which positions are not in the robot's base at all [m]."""

PLACE_M, TURN_RAD = 1e-3, 1e-3
"""Natural size of a joint's misplacement."""

MASS_KG, MOMENT_KGM = 50.0, 20.0
GRAVITY = np.array([0.0, 0.0, -9.80665])
FREE = 1e-6
"""Precision of tracker's frame and reflectors, of their natural size: next to none."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """What the references say.

    Attributes:
        steps: comparisons at held-out configurations; the first is of nothing.
        robot: with joints where they are.
        samples: with reflectors where they are on the tool, and positions in the robot's base.
        place_m: (n, 3) shift of each joint, in the frame of the joint before it [m].
        turn_rad: (n, 3) its turn [rad].
    """

    steps: tuple[Step, ...]
    robot: RobotModel
    samples: PointSamples
    place_m: FloatArray
    turn_rad: FloatArray

    @property
    def taken(self) -> bool:
        """Whether the robot is another one now."""
        return bool(self.place_m.any())


def calibrate(observations: Observations, fit: ElasticFit) -> Calibration | None:
    """Look for kinematic errors and weights; None where the data cannot show them.

    Args:
        observations: of the robot.
        fit: of all that gives way.
    """
    samples = observations.samples
    if not isinstance(samples, PointSamples) or observations.robot.slides.any():
        return None
    rows = np.flatnonzero((samples.branch == REFERENCE) & fit.use)
    cells = np.unique(samples.configuration[rows])
    residual = residual_of(observations, fit.arm, fit.state)[rows]
    known = residual.size > 0 and np.abs(residual).max() < ABSURD_M
    if not known or len(cells) < CONFIGURATIONS_LEAST:
        return None
    first, mean, count = _means(samples, rows, residual)
    covariance = samples.position_covariance[rows[first]] / count[:, None, None]
    white = np.linalg.inv(np.linalg.cholesky(covariance + np.eye(3) * REPEATABILITY_M**2))
    at = rows[first]
    blocks = [
        _frame(fit.state, samples, at),
        _kinematic(fit.state, samples, at),
        _weights(fit.state, samples, at, _compliance(fit)),
    ]
    _, cell = np.unique(samples.configuration[at], return_inverse=True)
    fold = np.random.default_rng(0).permutation(len(cells)) % min(10, len(cells))
    numbers = np.asarray(3.0 * np.bincount(cell.ravel()), dtype=np.float64)
    target = np.einsum("kij,kj->ki", white, mean).ravel()
    evidence = Rows(target, np.empty((0, 0)), np.repeat(cell.ravel(), 3), fold, numbers, count)
    whitened = [(white @ block).reshape(target.size, -1) for block in blocks]
    return _chosen(observations, samples, evidence, whitened)


def _chosen(
    observations: Observations, samples: PointSamples, rows: Rows, blocks: list[FloatArray]
) -> Calibration:
    frame, kinematic, weights = blocks
    free = np.full(frame.shape[1], FREE)
    score = held_out(rows, frame, free)
    steps = [_step(Rung.JOINTS, "unloaded references: nominal", 0, score, score, True)]
    columns, precision, taken = frame, free, False
    for rung, name, more in (
        (Rung.KINEMATICS, "unloaded references: kinematic errors", kinematic),
        (Rung.GRAVITY, "unloaded references: weights of the links", weights),
    ):
        both = np.hstack([columns, more])
        wider = np.append(precision, np.ones(more.shape[1]))
        after = held_out(rows, both, wider)
        step = _step(rung, name, more.shape[1], score, after, False)
        good = step.gain > max(BEYOND_DOUBT * step.doubt, LEAST_GAIN)
        steps.append(replace(step, taken=good))
        if good:
            columns, precision, score = both, wider, after
            taken = taken or rung is Rung.KINEMATICS
    gram = columns.T @ columns + np.diag(precision)
    values = solve(gram, columns.T @ rows.residual)
    n = observations.robot.n
    place, turn = np.zeros((n, 3)), np.zeros((n, 3))
    if taken:
        mine = values[frame.shape[1] : frame.shape[1] + kinematic.shape[1]].reshape(n, 6)
        place, turn = PLACE_M * mine[:, :3], TURN_RAD * mine[:, 3:]
        samples = _corrected(samples, values[: frame.shape[1]])
    return Calibration(tuple(steps), _moved(observations.robot, place, turn), samples, place, turn)


def _step(rung: Rung, name: str, size: int, before: HeldOut, after: HeldOut, taken: bool) -> Step:
    each = (before.squares - after.squares) / max(float(before.squares.sum()), 1e-300)
    doubt = float(each.std(ddof=1)) * float(np.sqrt(each.size))
    return Step(rung, name, size, after.rms, float(each.sum()), doubt, taken)


def _means(
    samples: PointSamples, rows: IntArray, residual: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """First row of each configuration and reflector, mean residual there, number of rows."""
    key = np.column_stack([samples.configuration[rows], samples.reflector[rows]])
    _, first, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
    count = np.bincount(index.ravel()).astype(np.float64)
    mean = np.zeros((count.size, 3))
    np.add.at(mean, index.ravel(), residual)
    return first, mean / count[:, None], count


def _points(state: Statics, samples: PointSamples, at: IntArray) -> FloatArray:
    posture = state.frames.posture
    offset = np.einsum("kij,kj->ki", posture.rotation[at], samples.offset[at])
    return np.asarray(posture.position[at] + offset)


def _frame(state: Statics, samples: PointSamples, at: IntArray) -> FloatArray:
    """(k, 3, 6 + 3 r) by the tracker's frame and the reflectors on the tool, in mm and mrad."""
    point, rotation = _points(state, samples, at), state.frames.posture.rotation[at]
    names = np.unique(samples.reflector)
    frame = np.concatenate(
        [np.broadcast_to(np.eye(3), (at.size, 3, 3)), -cross_matrix(point)], axis=2
    )
    parts = [PLACE_M * frame]
    for name in names:
        mine = (samples.reflector[at] == name)[:, None, None]
        parts.append(PLACE_M * np.where(mine, rotation, 0.0))
    return np.concatenate(parts, axis=2)


def _kinematic(state: Statics, samples: PointSamples, at: IntArray) -> FloatArray:
    """(k, 3, 6 n) by each joint's misplacement, in the frame of the joint before it."""
    point, frames = _points(state, samples, at), state.frames
    n, parts = state.joints.shape[1], []
    for j in range(n):
        before = frames.body_rotation[at, j]
        arm = point - frames.body_position[at, j + 1]
        parts += [PLACE_M * before, TURN_RAD * (-cross_matrix(arm) @ before)]
    return np.concatenate(parts, axis=2)


def _weights(
    state: Statics, samples: PointSamples, at: IntArray, compliance: FloatArray
) -> FloatArray:
    """(k, 3, 4 n) by each link's mass and first moment, through the joints' compliance."""
    frames, posture = state.frames, state.frames.posture
    n, parts = state.joints.shape[1], []
    axes, points = posture.axes[at], posture.position[at, None, :] - posture.arms[at]
    offset = np.einsum("kij,kj->ki", posture.rotation[at], samples.offset[at])
    arms = posture.arms[at] + offset[:, None, :]
    moves = np.cross(axes, arms).swapaxes(1, 2) * compliance
    for b in range(1, n + 1):
        origin, turned = frames.body_position[at, b], frames.body_rotation[at, b]
        levers = [MASS_KG * (origin[:, None, :] - points)]
        levers += [
            np.broadcast_to(MOMENT_KGM * turned[:, None, :, i], points.shape) for i in range(3)
        ]
        for lever in levers:
            torque = np.einsum("kji,kji->kj", axes, np.cross(lever, GRAVITY))
            torque[:, b:] = 0.0
            parts.append(np.einsum("kij,kj->ki", moves, torque)[..., None])
    return np.concatenate(parts, axis=2)


def _compliance(fit: ElasticFit) -> FloatArray:
    joints = fit.arm.blocks[0]
    assert isinstance(joints, Joints)
    return np.asarray(fit.arm.values[: joints.size] * joints.scale)


def _corrected(samples: PointSamples, values: FloatArray) -> PointSamples:
    """Reflectors at their place on the tool, positions in the robot's base."""
    shift, turn = PLACE_M * values[:3], PLACE_M * values[3:6]
    back = exponential(-turn[None])[0]
    offsets = PLACE_M * values[6:].reshape(-1, 3)
    _, which = np.unique(samples.reflector, return_inverse=True)
    return replace(
        samples,
        offset=samples.offset + offsets[which.ravel()],
        position=(samples.position - shift) @ back.T,
        position_covariance=back @ samples.position_covariance @ back.T,
    )


def _moved(robot: RobotModel, place: FloatArray, turn: FloatArray) -> RobotModel:
    return replace(
        robot,
        origins=robot.origins + place,
        rotations=exponential(turn) @ robot.rotations,
    )
