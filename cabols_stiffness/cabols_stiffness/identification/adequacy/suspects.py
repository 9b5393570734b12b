# SPDX-License-Identifier: Apache-2.0
"""Effects that an elastic model leaves out, as columns beside those of the joints.

Each suspect adds a few parameters whose derivatives, at zero, are computed here. A score test then
says whether the residuals contain it, without a fit of its own (Rao 1948; as an added-variable F
test: Seber and Lee, Linear Regression Analysis, 2003, section 4.3).
"""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_stiffness.identification.gauss_newton import Fitted
from cabols_stiffness.identification.observations import Observations
from cabols_stiffness.measurements.samples import PointSamples
from cabols_stiffness.model.verdict import Suspect

Z, WEIGHT = 2, 0
"""Axis that points up, and the column of a weight's force; those of its moments follow."""
SETTLING = 1.5
"""Measurements after which creep within a pass has settled to 1/e."""

Columns = dict[Suspect, FloatArray]


def suspects(observations: Observations, found: Fitted, cubic: bool) -> Columns:
    """(k, m, p) derivatives of the prediction by each suspect's p parameters.

    Args:
        observations: of the robot.
        found: a fit of them.
        cubic: whether the model has cubic terms already.
    """
    columns = _of_wrench(observations, found) | _of_frames(observations, found)
    columns |= _of_joints(observations, found, cubic)
    if isinstance(observations.samples, PointSamples):
        columns[Suspect.CREEP] = _creep(observations.samples)
    return columns


def _of_wrench(observations: Observations, found: Fitted) -> Columns:
    line, rest = found.line, found.line.balance
    by_wrench = line.motion @ rest.by_wrench
    wrench = observations.samples.wrench
    gain = by_wrench * wrench[:, None, :]
    turned = np.concatenate([-_cross_matrix(wrench[:, :3]), -_cross_matrix(wrench[:, 3:])], axis=1)
    # A lever t to the true point of action: the torque at the tool is m - t x f.
    lever = np.concatenate([np.zeros_like(turned[:, :3]), _cross_matrix(wrench[:, :3])], axis=1)
    return {
        Suspect.WRENCH_GAIN: gain,
        Suspect.WRENCH_BIAS: by_wrench * _largest(observations)[:, None, :],
        Suspect.WEIGHT: by_wrench @ _weight(observations, found),
        Suspect.WRENCH_FRAME: by_wrench @ turned,
        Suspect.WRENCH_POINT: by_wrench @ lever,
    }


def _largest(observations: Observations) -> FloatArray:
    """(k, 6) largest force and torque; zero for rows whose wrench is exact, as unloaded ones."""
    samples = observations.samples
    halves = np.abs(samples.wrench).reshape(-1, 2, 3).max(axis=(0, 2), initial=0.0)
    noise = np.abs(samples.wrench_covariance).max(axis=(1, 2))
    return np.where(noise[:, None] > 0.0, np.repeat(halves, 3), 0.0)


def _weight(observations: Observations, found: Fitted) -> FloatArray:
    """(k, 6, 4) wrench of a weight as large as the largest force, and of its first moments.

    The moments are of the largest torque, by the weight's centre along the tool's axes.
    """
    posture, size = found.line.balance.posture, _largest(observations)
    down, axes = -posture.rotation[:, Z], np.broadcast_to(np.eye(3), posture.rotation.shape)
    if not observations.follows:
        down, axes = np.broadcast_to([0.0, 0.0, -1.0], down.shape), posture.rotation
    moments = np.cross(axes, down[:, :, None], axis=1)
    found_there = np.zeros((down.shape[0], 6, 4))
    found_there[:, :3, WEIGHT] = size[:, :1] * down
    found_there[:, 3:, 1:] = size[:, 3:4, None] * moments
    return found_there


def _of_frames(observations: Observations, found: Fitted) -> Columns:
    """Tool point, base frame of the tracker, elastic base."""
    line, rest, samples = found.line, found.line.balance, observations.samples
    posture = rest.posture
    turn = np.einsum("kji,kj->ki", posture.rates, rest.deflection)
    shift = _cross_matrix(turn) @ posture.rotation
    push = np.cross(posture.rates[:, :, None, :], posture.rotation.swapaxes(1, 2)[:, None])
    torque = np.einsum("kjai,ki->kja", push, rest.wrench[:, :3])
    force, moment = rest.wrench[:, :3], rest.wrench[:, 3:]
    at_base = np.concatenate([force, moment + np.cross(posture.position, force)], axis=1)
    by_tool = line.motion @ rest.softness @ torque
    by_tool[:, :3] += shift
    if isinstance(samples, PointSamples):
        point = posture.position + np.einsum("kij,kj->ki", posture.rotation, samples.offset)
        frame, base = -_cross_matrix(point), _moves(point)
    else:
        moved = np.nan_to_num(samples.deflection)
        frame = np.concatenate([-_cross_matrix(moved[:, :3]), -_cross_matrix(moved[:, 3:])], axis=1)
        rigid = np.concatenate(
            [np.zeros_like(frame[:, :3]), np.broadcast_to(np.eye(3), shift.shape)], axis=1
        )
        base = np.concatenate(
            [_moves(posture.position), np.concatenate([0.0 * rigid[:, 3:], rigid[:, 3:]], axis=2)],
            axis=1,
        )
    return {
        Suspect.TOOL_POINT: by_tool,
        Suspect.BASE_FRAME: frame,
        Suspect.BASE: base * at_base[:, None, :],
    }


def _of_joints(observations: Observations, found: Fitted, cubic: bool) -> Columns:
    line, rest = found.line, found.line.balance
    deflection = rest.deflection
    torque = deflection / found.parameters.compliance
    n = deflection.shape[1]
    first, second = np.triu_indices(n, 1)
    coupling = line.motion[:, :, first] * torque[:, None, second]
    coupling = coupling + line.motion[:, :, second] * torque[:, None, first]
    angle = observations.samples.joints
    varied = deflection * (angle - angle.mean(axis=0))
    play = np.tanh(deflection / (0.02 * np.abs(deflection).max(axis=0) + 1e-12))
    columns = {
        Suspect.JOINT_ZERO: _zeros(observations, found),
        Suspect.COUPLING: coupling,
        Suspect.VARYING: line.motion * varied[:, None, :],
        Suspect.PLAY: line.motion * play[:, None, :],
        Suspect.BEARINGS: _bearings(observations, found),
    }
    if not cubic:
        columns[Suspect.CUBIC] = line.motion * (deflection**3)[:, None, :]
    return columns


def _zeros(observations: Observations, found: Fitted) -> FloatArray:
    """(k, m, n) by the zero of each joint: the arm is turned, and its lever arms with it."""
    line, rest, samples = found.line, found.line.balance, observations.samples
    by_joint = rest.posture.complementary_stiffness(rest.wrench, observations.follows)
    moved = line.motion + line.motion @ rest.softness @ by_joint
    if isinstance(samples, PointSamples):
        return np.asarray(moved)
    before = observations.unloaded.jacobian
    turned = np.einsum("kij,kj->ki", rest.posture.rates.swapaxes(1, 2), rest.deflection)
    carried = before.copy()
    carried[:, 3:] += _cross_matrix(turned) @ before[:, 3:]
    return np.asarray(moved - carried)


def _bearings(observations: Observations, found: Fitted) -> FloatArray:
    """(k, m, n) by each joint's bearing giving way across its axis."""
    rest, samples = found.line.balance, observations.samples
    posture = rest.posture
    force, moment = rest.wrench[:, None, :3], rest.wrench[:, None, 3:]
    here = moment + np.cross(posture.arms, force)
    along = np.einsum("kji,kji->kj", posture.axes, here)
    across = here - along[..., None] * posture.axes
    arms = posture.arms
    if isinstance(samples, PointSamples):
        arms = arms + np.einsum("kij,kj->ki", posture.rotation, samples.offset)[:, None, :]
    moved = np.cross(across, arms)
    if not isinstance(samples, PointSamples):
        moved = np.concatenate([moved, across], axis=2)
    return np.asarray(moved.swapaxes(1, 2))


def _creep(samples: PointSamples) -> FloatArray:
    """(k, 3, 3) by a shift that settles over each pass, the same in all of them."""
    order = np.empty(len(samples))
    for group in np.unique(samples.group):
        members = np.flatnonzero(samples.group == group)
        order[members[np.argsort(samples.time[members], kind="stable")]] = np.arange(members.size)
    share = 1.0 - np.exp(-order / SETTLING)
    return np.asarray(share[:, None, None] * np.eye(3))


def _cross_matrix(vector: FloatArray) -> FloatArray:
    """(k, 3, 3) of (k, 3)."""
    x, y, z = vector.T
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.moveaxis(np.array(rows), 2, 0)


def _moves(point: FloatArray) -> FloatArray:
    """(k, 3, 6) motion of points (k, 3) by a small motion of the base."""
    plain = np.broadcast_to(np.eye(3), (point.shape[0], 3, 3))
    return np.concatenate([plain, -_cross_matrix(point)], axis=2)
