"""Hysteresis: friction torques of the joints, seen where loading and unloading branches differ.

A joint's friction is springs in parallel, each behind a slider that gives (Maxwell slip, Iwan
1966): the torque rises over a `reach` of motion to its full size and stays there until the motion
turns back. What a sample's friction is relative to its full size, -1 to 1, follows from the
deflections in the order of measurement: the `slides`. So friction is linear in one number for each
joint, and is tested and estimated like any other parameter.
"""

from __future__ import annotations

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_stiffness.fit import Fitted, Model
from cabols_stiffness.observations import Observations, whiten
from cabols_stiffness.robot import JOINTS
from cabols_stiffness.samples import UNLOADING, PointSamples, Samples

SLIDERS = 4
"""Per joint; they give one after the other."""

REACHES = np.repeat(np.geomspace(3e-6, 3e-3, 19)[:, None], JOINTS, axis=1)
"""(n, 6) candidates for the motion after which all sliders of a joint have given [rad]."""

FINER = np.geomspace(0.75, 4.0 / 3.0, 11)
"""Factors on a reach that was found, for a closer look."""

SIGNIFICANT = 5.0
"""Standard deviations by which a friction torque must differ from zero to be taken for real."""


def stays(samples: PointSamples | Samples) -> list[IntArray]:
    """Indices of the samples of each configuration, in the order of time (poses: as given)."""
    if isinstance(samples, PointSamples):
        order = np.lexsort((samples.time, samples.configuration))
    else:
        order = np.argsort(samples.configuration, kind="stable")
    starts = np.flatnonzero(np.diff(samples.configuration[order])) + 1
    return list(np.split(order, starts)) if order.size else []


def slides(
    samples: PointSamples | Samples, deflection: FloatArray, reach: FloatArray
) -> FloatArray:
    """Share of the friction that is drawn in each sample.

    Sliders are taken to be relaxed when the robot comes to a configuration: its own motion has
    drawn them this way or that. From pass to pass at a configuration they keep where they are.

    Args:
        samples: whose order counts.
        deflection: (k, ..., 6) of the joints; leading dimensions of `reach` broadcast [rad].
        reach: (..., 6) motion after which all sliders of a joint have given [rad].

    Returns:
        (k, ..., 6) from -1 to 1.
    """
    shape = np.broadcast_shapes(deflection.shape[1:], reach.shape)
    share = np.empty((len(samples), *shape))
    steps = reach[..., None] * np.arange(1, SLIDERS + 1) / SLIDERS
    for members in stays(samples):
        drawn = np.zeros((*shape, SLIDERS))
        before = np.zeros(shape)
        for index in members:
            now = np.broadcast_to(deflection[index], shape)
            drawn = np.clip(drawn + (now - before)[..., None] / steps, -1.0, 1.0)
            before = now
            share[index] = drawn.mean(axis=-1)
    return share


def has_branches(samples: PointSamples | Samples) -> bool:
    """Whether there is an unloading branch at all, without which friction looks like stiffness."""
    return bool((samples.branch == UNLOADING).any())


def detect(
    observations: Observations, found: Fitted, model: Model, reaches: FloatArray
) -> tuple[FloatArray, Model]:
    """Look for friction in the residuals of a fit.

    For every joint the reach that explains most is taken; then the torques of all joints are
    estimated together, beside all other parameters, and those that matter are kept.

    Args:
        observations: of the robot.
        found: fit of them, with or without friction.
        model: of that fit.
        reaches: (n, 6) candidates for each joint [rad].

    Returns:
        (6,) reach of each joint [rad], and the model with the joints that rub.
    """
    line, samples = found.line, observations.samples
    share = slides(samples, found.deflection[:, None, :], reaches)
    softened = -line.motion @ line.balance.softness
    candidates = softened[:, :, None, :] * share[:, None, :, :]
    base = found.columns[:, :, found.elastic]
    columns = np.concatenate([base, candidates.reshape(*base.shape[:2], -1)], axis=2)
    rows = whiten(line, columns, samples, found.use.astype(np.float64))
    count = base.shape[2]
    matrix = rows.columns[found.use].reshape(-1, columns.shape[2])
    # The residual without any friction: what the friction of this fit explains is put back.
    target = rows.residual[found.use].ravel()
    if model.slides is not None:
        drawn = softened * (model.slides * found.parameters.friction)[:, None, :]
        back = whiten(line, drawn.sum(axis=2)[..., None], samples, found.use.astype(np.float64))
        target = target + back.columns[found.use].ravel()
    basis, _ = np.linalg.qr(matrix[:, :count])
    rest = matrix[:, count:] - basis @ (basis.T @ matrix[:, count:])
    target = target - basis @ (basis.T @ target)
    length = np.linalg.norm(rest, axis=0)
    usable = length > 1e-9 * max(float(length.max(initial=0.0)), 1e-300)
    score = np.where(usable, (rest.T @ target) / np.where(usable, length, 1.0), 0.0)
    best = np.argmax(score.reshape(len(reaches), JOINTS), axis=0)
    columns_of = best * JOINTS + np.arange(JOINTS)
    rubs = _significant(rest[:, columns_of], target, found.freedom)
    reach = reaches[best, np.arange(JOINTS)]
    if not rubs.any():
        return reach, Model(model.cubic, model.published, None, rubs)
    return reach, Model(model.cubic, model.published, share[:, best, np.arange(JOINTS)], rubs)


def _significant(columns: FloatArray, target: FloatArray, freedom: int) -> BoolArray:
    """(6,) joints whose friction stands out; the least significant is dropped until all do."""
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
