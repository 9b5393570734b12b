# SPDX-License-Identifier: Apache-2.0
"""Hysteresis: friction torques of the joints, seen where loading and unloading branches differ.

A joint's friction is springs in parallel, each behind a slider that gives (Maxwell slip, Iwan
1966): the torque rises over a `travel` of motion to its full size and stays there until the motion
reverses. The `friction_state`, a sample's friction relative to its full size, -1 to 1, follows from
the deflections in the order of measurement. Friction is therefore linear in one number for each
joint, and is tested and estimated like any other parameter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_stiffness.identification.gauss_newton import Fitted, Model
from cabols_stiffness.identification.observations import Observations, whiten
from cabols_stiffness.measurements.samples import UNLOADING, PointSamples, Samples

SLIDERS = 4
"""Sliders of a joint; they yield one after the other."""

TRAVELS = np.geomspace(3e-6, 3e-3, 19)[:, None]
"""(n, 1) candidates for the motion after which all sliders of a joint have yielded [rad]."""

FINER = np.geomspace(0.75, 4.0 / 3.0, 11)
"""Factors on a detected travel, for refinement."""

SIGNIFICANT = 5.0
"""Standard deviations by which a friction torque must differ from zero to be significant."""


def stays(samples: PointSamples | Samples, kept: bool) -> list[IntArray]:
    """Indices of the samples of each stay at a configuration, in order; see friction_state.

    Args:
        samples: in any order.
        kept: whether the sliders keep their positions from stay to stay, i.e. form one stay.
    """
    order = np.arange(len(samples))
    if isinstance(samples, PointSamples):
        order = np.argsort(samples.time, kind="stable")
    if kept or order.size == 0:
        return [order]
    order = order[np.argsort(samples.configuration[order], kind="stable")]
    return list(np.split(order, np.flatnonzero(np.diff(samples.configuration[order])) + 1))


def friction_state(
    samples: PointSamples | Samples, deflection: FloatArray, travel: FloatArray, kept: bool
) -> FloatArray:
    """Compute each sample's friction relative to its full size.

    From pass to pass at a configuration the sliders keep their positions.

    Args:
        samples: whose order counts: points by time, poses as given.
        deflection: (k, ..., 6) of the joints; leading dimensions of `travel` broadcast [rad].
        travel: (..., 6) motion after which all sliders of a joint have yielded [rad].
        kept: whether they keep their positions also when the robot moves to another configuration;
            otherwise its motion has relaxed them.

    Returns:
        (k, ..., 6) from -1 to 1.
    """
    shape = np.broadcast_shapes(deflection.shape[1:], travel.shape)
    share = np.empty((len(samples), *shape))
    steps = travel[..., None] * np.arange(1, SLIDERS + 1) / SLIDERS
    for members in stays(samples, kept):
        drawn = np.zeros((*shape, SLIDERS))
        before = np.zeros(shape)
        for index in members:
            now = np.broadcast_to(deflection[index], shape)
            drawn = np.clip(drawn + (now - before)[..., None] / steps, -1.0, 1.0)
            before = now
            share[index] = drawn.mean(axis=-1)
    return share


def has_branches(samples: PointSamples | Samples) -> bool:
    """Whether there is an unloading branch, without which friction looks like stiffness."""
    return bool((samples.branch == UNLOADING).any())


def detect(
    observations: Observations, found: Fitted, model: Model, travels: FloatArray
) -> tuple[FloatArray, Model]:
    """Look for friction in the residuals of a fit.

    For every joint the travel that explains most is chosen; then the torques of all joints are
    estimated together, beside all other parameters, and the significant ones are kept.

    Args:
        observations: of the robot.
        found: fit of them, with or without friction.
        model: of that fit.
        travels: (n, 6) candidates for each joint [rad].

    Returns:
        (6,) travel of each joint [rad], and the model with the joints that have friction.
    """
    best = max((_scored(observations, found, model, travels, kept) for kept in (False, True)),
               key=lambda each: each.gain)  # fmt: skip
    has_friction = _significant(best.columns, best.target, found.freedom)
    state = best.friction_state if has_friction.any() else None
    return best.travel, Model(model.cubic, model.published, state, has_friction)


@dataclass(frozen=True, eq=False)
class _Scored:
    """Best travel (6,), explained sum of squares, columns (n, 6), target (n,), states (k, 6)."""

    travel: FloatArray
    gain: float
    columns: FloatArray
    target: FloatArray
    friction_state: FloatArray


def _scored(
    observations: Observations, found: Fitted, model: Model, travels: FloatArray, kept: bool
) -> _Scored:
    line, samples, weights = found.line, observations.samples, found.use.astype(np.float64)
    share = friction_state(samples, found.deflection[:, None, :], travels, kept)
    softened = -line.motion @ line.balance.softness
    candidates = softened[:, :, None, :] * share[:, None, :, :]
    base = found.columns[:, :, found.elastic]
    # The residual without friction: the share that this fit's friction explains is added back.
    drawn = np.zeros((*base.shape[:2], 1))
    if model.friction_state is not None:
        drawn = (softened * (model.friction_state * found.parameters.friction)[:, None, :]).sum(
            axis=2
        )
        drawn = drawn[..., None]
    columns = np.concatenate([base, drawn, candidates.reshape(*base.shape[:2], -1)], axis=2)
    rows = whiten(line, columns, samples, weights)
    matrix = rows.columns[found.use].reshape(-1, columns.shape[2])
    count = base.shape[2]
    target = rows.residual[found.use].ravel() + matrix[:, count]
    joints = found.deflection.shape[1]
    tried = matrix[:, count + 1 :].reshape(target.size, len(travels), joints)
    others = found.columns[:, :, ~found.elastic]
    friction = whiten(line, others, samples, weights).columns[found.use]
    best = np.array(
        [
            _best(
                tried[:, :, j],
                target,
                np.hstack([matrix[:, :count], _without(friction, model, j)]),
            )
            for j in range(joints)
        ]
    )
    joint = np.arange(joints)
    basis, _ = np.linalg.qr(matrix[:, :count])
    chosen = tried[:, best, joint]
    chosen = chosen - basis @ (basis.T @ chosen)
    target = target - basis @ (basis.T @ target)
    explained, *_ = np.linalg.lstsq(chosen, target, rcond=1e-9)
    gain = float(np.sum((chosen @ explained) ** 2))
    return _Scored(travels[best, joint], gain, chosen, target, share[:, best, joint])


def _without(friction: FloatArray, model: Model, joint: int) -> FloatArray:
    """Return the friction columns (n, p) of (k, m, p) of the other joints that have friction."""
    others = np.flatnonzero(model.has_friction) != joint
    rows = friction.shape[0] * friction.shape[1]
    return np.asarray(friction[:, :, others].reshape(rows, int(others.sum())))


def _best(tried: FloatArray, target: FloatArray, beside: FloatArray) -> int:
    """Return which of the columns (n, c) explains most of a target (n,), beside others (n, p).

    Only friction against the motion counts, so a column must explain with a positive sign.
    """
    basis, _ = np.linalg.qr(beside)
    rest = tried - basis @ (basis.T @ tried)
    length = np.linalg.norm(rest, axis=0)
    usable = length > 1e-9 * max(float(length.max(initial=0.0)), 1e-300)
    left = target - basis @ (basis.T @ target)
    score = np.where(usable, (rest.T @ left) / np.where(usable, length, 1.0), 0.0)
    return int(np.argmax(score))


def _significant(columns: FloatArray, target: FloatArray, freedom: int) -> BoolArray:
    """Return the (6,) joints with significant friction; the least significant is dropped first."""
    kept = np.linalg.norm(columns, axis=0) > 0.0
    while kept.any():
        index = np.flatnonzero(kept)
        chosen = columns[:, index]
        scale = np.linalg.norm(chosen, axis=0)
        value, *_ = np.linalg.lstsq(chosen / scale, target, rcond=None)
        left = target - chosen / scale @ value
        inverse = np.linalg.pinv((chosen / scale).T @ (chosen / scale))
        variance = float(left @ left) / max(freedom - index.size, 1)
        ratio = value / np.sqrt(np.maximum(np.diagonal(inverse) * variance, 1e-300))
        worst = int(np.argmin(ratio))
        if ratio[worst] >= SIGNIFICANT:
            break
        kept[index[worst]] = False
    return np.asarray(kept)
