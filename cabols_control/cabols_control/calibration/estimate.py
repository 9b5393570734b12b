# SPDX-License-Identifier: Apache-2.0
"""Estimate of a rig's parameters from readings, with covariance and what the data told.

Gauss-Newton on readings weighted with their whole covariance (errors of the poses included), with
the drawing as a first, weak reading of every parameter: what data do not tell stays near it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.errors import CabolsError, ShapeError

from .model import (
    Noise,
    Readings,
    courses,
    derivatives,
    noise_covariances,
    pose_derivatives,
    predicted,
)
from .parameters import Layout

MOST_STEPS = 30
SMALL_STEP = 1e-6
"""Largest component of the last step, in standard deviations beforehand."""
TOLD = 0.5
"""Share of the deviation beforehand below which data have told a parameter."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a rig's data say.

    Attributes:
        layout: of the parameters.
        values: (p,) estimates.
        covariance: (p, p) of their errors.
        residual: weighted rms of the readings that were fitted; near 1 if model and noise are
            right.
        freedom: readings less parameters.
    """

    layout: Layout
    values: FloatArray
    covariance: FloatArray
    residual: float
    freedom: int

    @property
    def deviation(self) -> FloatArray:
        """(p,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def told(self) -> BoolArray:
        """(p,) whether the data told the parameter: it is known better than beforehand."""
        return np.asarray(self.deviation < TOLD * self.layout.spread, dtype=np.bool_)


def information(
    layout: Layout, values: FloatArray, readings: Readings, noise: Noise
) -> tuple[FloatArray, FloatArray]:
    """Whitened derivatives (k, n + 6, p) and the factors (k, n + 6, n + 6) that whiten.

    Args:
        layout: of the parameters.
        values: (p,) where to linearise.
        readings: of which poses and loads count.
        noise: of what is read.
    """
    covariance = noise_covariances(layout, values, readings, noise)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    return whiten @ derivatives(layout, values, readings), whiten


def calibrate(layout: Layout, readings: Readings, noise: Noise) -> Calibration:
    """Estimate the parameters.

    Args:
        layout: of the parameters, with the drawing and how far it can be wrong.
        readings: of at least one stop.
        noise: of what is read.

    Raises:
        ShapeError: if the readings are none, or of another number of cables.
        CabolsError: if the iteration does not settle: the readings are not of this rig.
    """
    n, scale = layout.cables, np.where(layout.spread > 0.0, layout.spread, 1.0)
    if not (len(readings.position) and readings.let_out.shape[1] == n):
        raise ShapeError(
            f"readings: expected at least one, with lengths of {n} cables, got shape "
            f"{readings.let_out.shape}"
        )
    shift = np.zeros(layout.start.size)
    read = np.hstack([readings.let_out, np.nan_to_num(readings.wrench)])
    loaded = readings.loaded
    read[loaded, :n] = 0.0
    read[~loaded, n:] = 0.0
    # Where the encoders count from is not known at all: start from the first rows.
    first = predicted(layout, layout.start, readings)[~loaded, :n]
    if len(first):
        layout.parts(shift)["offset"][:] = (first - read[~loaded, :n]).mean(axis=0) / scale[
            7 * n : 8 * n
        ]
    # What the poses are wrong by. A derivative at a wrong pose is wrong in what the reading is, and
    # the estimate would be biased (errors in variables): they are estimated along.
    off = np.zeros((len(read), 6))
    for _ in range(MOST_STEPS):
        values, at = layout.start + scale * shift, readings.moved(off)
        jacobian, whiten = information(layout, values, at, noise)
        by_pose = pose_derivatives(layout, values, at)
        misfit = read - predicted(layout, values, at) + np.einsum("kab,kb->ka", by_pose, off)
        white = np.einsum("kab,kb->ka", whiten, misfit).ravel()
        flat = jacobian.reshape(-1, shift.size)
        normal = flat.T @ flat + np.eye(shift.size)
        step = np.linalg.solve(normal, flat.T @ white - shift)
        if not np.isfinite(step).all():
            break
        rest = white.reshape(len(read), -1) - jacobian @ step
        off = noise.pose**2 * np.einsum("kab,kca,kc->kb", by_pose, whiten, rest)
        shift = shift + step
        if np.abs(step).max() < SMALL_STEP:
            covariance = scale[:, None] * np.linalg.inv(normal) * scale
            fixed = layout.spread == 0.0
            covariance[fixed] = covariance[:, fixed] = 0.0
            count = int(n * (~loaded).sum() + 6 * loaded.sum())
            rms = float(np.sqrt(white @ white / count))
            freedom = count - int((~fixed).sum())
            return Calibration(layout, layout.start + scale * shift, covariance, rms, freedom)
    raise CabolsError(
        f"calibration: expected the estimate to settle within {MOST_STEPS} steps, it did not; are "
        "limbs, poses and units of the readings this rig's?"
    )


@dataclass(frozen=True, eq=False)
class Use:
    """What a calibration is for, at poses: one row per cable or wrench axis.

    Attributes:
        length: (k, n, p) derivatives of the cables' lengths less their offsets [m].
        wrench: (k, 6, p) of the wrench of equal tensions, per newton [1, m].
    """

    length: FloatArray
    wrench: FloatArray

    def rms(self, covariance: FloatArray, tension: float) -> tuple[float, float, float]:
        """Expected rms errors of length [m], force [N] and torque [N m].

        Args:
            covariance: (p, p) of the parameters.
            tension: of all cables [N].
        """
        rows = (self.length, tension * self.wrench[:, :3], tension * self.wrench[:, 3:])
        found = [np.einsum("kap,pq,kaq->ka", row, covariance, row).mean() for row in rows]
        return float(found[0] ** 0.5), float(found[1] ** 0.5), float(found[2] ** 0.5)


def uses(layout: Layout, values: FloatArray, position: FloatArray, rotation: FloatArray) -> Use:
    """Derivatives of what counts, by parameters in their own units.

    Args:
        layout: of the parameters.
        values: (p,) where to linearise.
        position: (k, 3) [m].
        rotation: (k, 3, 3).
    """
    n = layout.cables
    length = np.zeros((len(position), n, values.size))
    wrench = np.zeros((len(position), 6, values.size))
    for index in range(8 * n):
        spread = layout.spread[index]
        if not spread > 0.0:
            continue
        step = np.zeros(values.size)
        step[index] = STEP_USE * spread
        sides = [
            errors_of(layout, values + sign * step, position, rotation) for sign in (1.0, -1.0)
        ]
        length[:, :, index] = (sides[0][0] - sides[1][0]) / (2.0 * step[index])
        wrench[:, :, index] = (sides[0][1] - sides[1][1]) / (2.0 * step[index])
    return Use(length, wrench)


STEP_USE = 1e-4


def errors_of(
    layout: Layout, values: FloatArray, position: FloatArray, rotation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(k, n) lengths less offsets [m] and (k, 6) wrenches of 1 N in every cable.

    Args:
        layout: of the parameters.
        values: (p,) parameters.
        position: (k, 3) [m].
        rotation: (k, 3, 3).
    """
    length, direction, lever = courses(layout, values, position, rotation)
    torque = np.cross(lever, direction).sum(axis=1)
    wrench = np.hstack([direction.sum(axis=1), torque])
    return length - layout.parts(values)["offset"], wrench
