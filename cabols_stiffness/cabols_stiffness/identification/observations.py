# SPDX-License-Identifier: Apache-2.0
"""Samples as observations of joint deflections: residuals, derivatives and weights.

A measured motion m of the tool (a reflector's position, or a pose) is explained by the deflections
d that balance the measured wrench: m = g(d(p, w)) + noise. The noise has two parts: the tracker's,
and the wrench's, which reaches m through the softness of the arm, G = dg/dd dd/dw. To first order
in the wrench's small error the maximum likelihood over the true wrenches is weighted least squares
with the effective covariance C_m + G C_w G^T (weighted orthogonal distance regression with the true
wrenches profiled out; Fuller, Measurement Error Models, 1987, section 3.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.errors import ShapeError
from cabols_stiffness.measurements.samples import PointSamples, Samples
from cabols_stiffness.model.balance import Balance, Law, balance
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import logarithm, point_motion

SILENT = 10.0
"""Standard deviations beyond this multiple of the largest motion in the data say nothing of it."""

SAME = 1e-9
"""Relative singular value below which columns of offsets and drifts are one."""

BITE = 1 << 21
"""Numbers of groups that are taken out together."""

DRIFT_SAMPLES = 6
"""Least number of samples of a group for which a drift is estimated beside its offset."""


@dataclass(frozen=True, eq=False)
class Partial:
    """Directions that were measured, where not all were.

    Attributes:
        basis: (k, m, m) rows are the directions, in numbers of unit size.
        seen: (k, m) which of them were measured.
    """

    basis: FloatArray
    seen: BoolArray


def partial_of(samples: PointSamples | Samples) -> Partial | None:
    """Directions that were measured; None if all numbers of all samples were.

    A number that is NaN was not measured. Nor was a direction whose stated deviation is far beyond
    any motion in the data: it is how a dial gauge along an oblique axis is stated. Such numbers
    are no degrees of freedom: they say nothing of the stiffness, nor of the noise.

    Args:
        samples: of one campaign.
    """
    if isinstance(samples, PointSamples):
        value, noise = samples.position, samples.position_covariance
        _, group = np.unique(samples.group, return_inverse=True)
        moved = value - _middle(value, group.ravel())
    else:
        value, noise = samples.deflection, samples.deflection_covariance
        moved = value
    if value.size == 0:
        return None
    missing = np.isnan(value)
    size = np.abs(np.where(missing, 0.0, moved)).reshape(len(samples), -1, 3).max(axis=(0, 2))
    unit = np.repeat(np.where(size > 0.0, size, 1e-9), 3)
    scaled = noise / np.outer(unit, unit)
    if not missing.any() and not (np.einsum("kii->ki", scaled) > SILENT**2).any():
        return None
    apart = missing[:, :, None] | missing[:, None, :]
    scaled = np.where(apart, 0.0, scaled)
    diagonal = np.arange(unit.size)
    scaled[:, diagonal, diagonal] += np.where(missing, 2.0 * SILENT**2, 0.0)
    variance, directions = np.linalg.eigh(scaled)
    seen = variance <= SILENT**2
    return Partial(directions.swapaxes(1, 2) / unit, seen)


def _middle(value: FloatArray, group: IntArray) -> FloatArray:
    """(k, m) medians over each sample's group (k,), of what was measured; 0 where nothing was."""
    middle = np.empty_like(value)
    for column, found in zip(value.T, middle.T, strict=True):
        # Sorted by group, then value, with what is missing at the end of its group.
        order = np.lexsort((column, group))
        known = np.bincount(group, weights=np.isfinite(column)).astype(np.int64)
        start = np.concatenate([[0], np.cumsum(np.bincount(group))[:-1]])
        low = column[order[start + np.maximum(known - 1, 0) // 2]]
        high = column[order[start + np.minimum(known // 2, np.maximum(known - 1, 0))]]
        found[:] = np.where(known > 0, 0.5 * (low + high), 0.0)[group]
    return middle


@dataclass(frozen=True, eq=False)
class Linearised:
    """Measurements against a model at one set of parameters; m numbers for each of k samples.

    Attributes:
        residual: (k, m) measured minus predicted.
        motion: (k, m, 6) derivatives of the prediction by the joints' deflections.
        covariance: (k, m, m) of the residual: of the measurement, and of the wrench through it.
        balance: of the loaded arm.
        partial: which numbers were measured; None: all.
    """

    residual: FloatArray
    motion: FloatArray
    covariance: FloatArray
    balance: Balance
    partial: Partial | None = None


class Observations:
    """Samples, ready to be compared with a robot's model."""

    def __init__(self, samples: PointSamples | Samples, robot: RobotModel) -> None:
        """Take checked samples.

        Raises:
            ShapeError: if the robot has another number of joints.
        """
        if samples.joints.shape[1] != robot.n:
            raise ShapeError(
                f"joints: expected shape (k, {robot.n}) for the joints of {robot.name!r}, got "
                f"{samples.joints.shape}"
            )
        self.samples = samples
        self.robot = robot
        self.follows = isinstance(samples, PointSamples)
        self.unloaded = robot.posture(samples.joints)
        self._before: FloatArray | None = None
        self.partial = partial_of(samples)

    @property
    def numbers(self) -> IntArray:
        """(k,) numbers that were measured in each sample."""
        if self.partial is None:
            return np.full(len(self.samples), self.size)
        return np.asarray(self.partial.seen.sum(axis=1))

    @property
    def size(self) -> int:
        """Numbers m measured in each sample: 3 for a point, 6 for a pose."""
        return 3 if self.follows else 6

    def linearise(self, law: Law) -> Linearised:
        """Compare with a law of the joints."""
        samples = self.samples
        found = balance(
            self.robot, samples.joints, samples.wrench, law, self.follows, self._warm(law)
        )
        self._before = found.deflection
        if isinstance(samples, PointSamples):
            predicted, motion = self._points(samples, found, law)
            residual, noise = samples.position - predicted, samples.position_covariance
        else:
            predicted, motion = self._poses(samples, found, law)
            residual, noise = samples.deflection - predicted, samples.deflection_covariance
        through = motion @ found.by_wrench
        covariance = noise + through @ samples.wrench_covariance @ through.swapaxes(1, 2)
        if self.partial is not None:
            residual = np.nan_to_num(residual)
        return Linearised(residual, motion, covariance, found, self.partial)

    def forget(self) -> None:
        """Begin the next balance from the undeflected arm."""
        self._before = None

    def _warm(self, law: Law) -> FloatArray | None:
        return None if law.published else self._before

    def _points(
        self, samples: PointSamples, found: Balance, law: Law
    ) -> tuple[FloatArray, FloatArray]:
        posture = found.posture
        arm = np.einsum("kij,kj->ki", posture.rotation, samples.offset)
        motion = point_motion(arm) @ posture.jacobian
        predicted = posture.position + arm
        if law.published:
            predicted = predicted + np.einsum("kij,kj->ki", motion, found.deflection)
        return predicted, motion

    def _poses(self, samples: Samples, found: Balance, law: Law) -> tuple[FloatArray, FloatArray]:
        posture, motion = found.posture, found.posture.jacobian
        if law.published:
            return np.einsum("kij,kj->ki", motion, found.deflection), motion
        start = self.unloaded
        reference = samples.reference_wrench
        assert reference is not None
        if reference.any():
            unstirred = Law(law.stiffness, law.cubic)
            rest = balance(self.robot, samples.joints, reference, unstirred, follows=False)
            start = rest.posture
        turned = logarithm(posture.rotation @ start.rotation.swapaxes(1, 2))
        return np.concatenate([posture.position - start.position, turned], axis=1), motion


@dataclass(frozen=True, eq=False)
class Whitened:
    """Return rows of unit variance, without the groups' common parts.

    Attributes:
        residual: (k, m).
        columns: (k, m, p) derivatives of the prediction.
        shared: numbers that the offsets and drifts have used up.
    """

    residual: FloatArray
    columns: FloatArray
    shared: int


def whiten(
    linearised: Linearised,
    columns: FloatArray,
    samples: PointSamples | Samples,
    weights: FloatArray,
) -> Whitened:
    """Weight rows by their covariance and take out the offset and drift of each group.

    Args:
        linearised: of the samples.
        columns: (k, m, p) derivatives, of any parameters.
        samples: points have groups, poses do not.
        weights: (k,) of the samples, 1 or less; samples of weight 0 have no say in the offsets, but
            their rows, too, are compared with them, at weight 1.

    Returns:
        The rows; their least-squares solution, without those of weight 0, is that of the whole
        problem, offsets and drifts included.
    """
    white = _whitening(linearised)
    white = white * np.sqrt(np.where(weights > 0.0, weights, 1.0))[:, None, None]
    residual = np.einsum("kij,kj->ki", white, linearised.residual)
    rows = np.concatenate([residual[..., None], white @ columns], axis=2)
    shared = 0
    if isinstance(samples, PointSamples):
        whole = linearised.partial is None
        shared = _take_out(rows, white, samples, weights > 0.0, whole)
    first, others = np.split(rows, [1], axis=2)
    return Whitened(first.squeeze(axis=2), others, shared)


def _whitening(linearised: Linearised) -> FloatArray:
    """(k, m, m) to unit variance; rows of zeros in place of directions that were not measured."""
    partial, covariance = linearised.partial, linearised.covariance
    if partial is None:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
    both = partial.seen[:, :, None] & partial.seen[:, None, :]
    inside = partial.basis @ covariance @ partial.basis.swapaxes(1, 2)
    inside = np.where(both, inside, np.eye(partial.seen.shape[1]))
    white = np.linalg.inv(np.linalg.cholesky(inside))
    return np.asarray(np.where(both, white, 0.0) @ partial.basis)


def _take_out(
    rows: FloatArray, white: FloatArray, samples: PointSamples, use: BoolArray, whole: bool
) -> int:
    """Fit rows (k, m, 1 + p) in use by their groups' offsets and drifts, subtract; count those."""
    count = 0
    order = np.argsort(samples.group, kind="stable")
    starts = np.flatnonzero(np.diff(samples.group[order])) + 1
    bounds = np.concatenate([[0], starts, [order.size]])
    sizes = np.diff(bounds)
    complete = np.add.reduceat(use[order], bounds[:-1], dtype=np.int64) == sizes
    alike = complete & whole
    for size in np.unique(sizes[alike]):
        # Groups of one size, nothing of them left out: together, in bites of bounded memory.
        first = bounds[:-1][alike & (sizes == size)]
        bite = max(1, BITE // int(size * rows.shape[1] * rows.shape[2]))
        for some in range(0, first.size, bite):
            members = order[first[some : some + bite, None] + np.arange(size)]
            count += _take_out_alike(rows, white, samples.time, members)
    for begin, end in zip(bounds[:-1][~alike], bounds[1:][~alike], strict=True):
        members = order[begin:end]
        used = use[members]
        if not used.any():
            continue
        shared = _shared(white, samples.time, members[None], int(used.sum()))[0]
        width, part = shared.shape[2], rows[members]
        matrix, target = shared[used].reshape(-1, width), part[used].reshape(-1, part.shape[2])
        if whole:
            basis, triangle = np.linalg.qr(matrix)
            common = np.linalg.solve(triangle, basis.T @ target)
        else:
            scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
            common, _, rank, _ = np.linalg.lstsq(matrix / scale, target, rcond=SAME)
            common, width = common / scale[:, None], int(rank)
        rows[members] = part - shared @ common
        count += width
    return count


def _take_out_alike(
    rows: FloatArray, white: FloatArray, time: FloatArray, members: IntArray
) -> int:
    """Do so for groups (g, s) of s samples each."""
    count = 0
    drifting = np.ptp(time[members], axis=1) > 0.0
    for which in (drifting, ~drifting):
        here = members[which]
        if here.size == 0:
            continue
        shared = _shared(white, time, here, here.shape[1])
        groups, size, m, width = shared.shape
        part = rows[here].reshape(groups, size * m, -1)
        matrix = shared.reshape(groups, size * m, width)
        basis, triangle = np.linalg.qr(matrix)
        common = np.linalg.solve(triangle, basis.swapaxes(1, 2) @ part)
        rows[here] = (part - matrix @ common).reshape(groups, size, m, -1)
        count += groups * width
    return count


def _shared(white: FloatArray, time: FloatArray, members: IntArray, used: int) -> FloatArray:
    """(g, s, m, m or 2 m) columns of the groups' offsets, and drifts where they are estimated."""
    shared = white[members]
    since = time[members] - time[members].mean(axis=1, keepdims=True)
    spread = np.abs(since).max(axis=1, keepdims=True)
    if used >= DRIFT_SAMPLES and (spread > 0.0).all():
        shared = np.concatenate([shared, shared * (since / spread)[:, :, None, None]], axis=3)
    return shared


def start_stiffness(observations: Observations) -> FloatArray:
    """First guess of the stiffness: J diag(J^T w) c explains the motion, linear in compliance c.

    Returns:
        (6,) stiffness [N m/rad], with a very stiff guess where the data say nothing of a joint.
    """
    samples = observations.samples
    n = observations.robot.n
    rigid = Law(np.full(n, 1e12), np.zeros(n))
    line = observations.linearise(rigid)
    observations.forget()
    torque = line.balance.posture.torque(line.balance.wrench)
    columns = line.motion * torque[:, None, :]
    rows = whiten(line, columns, samples, np.ones(len(samples)))
    matrix = rows.columns.reshape(-1, n)
    scale = np.linalg.norm(matrix, axis=0)
    # A joint that moves no measured point is no part of the problem: not even by rounding.
    known = scale > 1e-9 * float(scale.max(initial=0.0))
    compliance = np.zeros(n)
    found = np.linalg.lstsq(matrix[:, known] / scale[known], rows.residual.ravel(), rcond=1e-6)[0]
    compliance[known] = found / scale[known]
    # A joint whose motion is below the noise starts with the stiffness that moves it by that noise.
    floor = np.where(known, 1.0 / np.where(known, scale, 1.0), 1e-9)
    return np.asarray(1.0 / np.clip(compliance, np.minimum(floor, 1e-3), 1.0))
