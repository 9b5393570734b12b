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

from cabols_control.checks import BoolArray, FloatArray
from cabols_stiffness.measurements.samples import PointSamples, Samples
from cabols_stiffness.model.balance import Balance, Law, balance
from cabols_stiffness.model.robot import JOINTS, RobotModel
from cabols_stiffness.model.screws import logarithm, point_motion

DRIFT_SAMPLES = 6
"""Least number of samples of a group for which a drift is estimated beside its offset."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """Measurements against a model at one set of parameters; m numbers for each of k samples.

    Attributes:
        residual: (k, m) measured minus predicted.
        motion: (k, m, 6) derivatives of the prediction by the joints' deflections.
        covariance: (k, m, m) of the residual: of the measurement, and of the wrench through it.
        balance: of the loaded arm.
    """

    residual: FloatArray
    motion: FloatArray
    covariance: FloatArray
    balance: Balance


class Observations:
    """Samples, ready to be compared with a robot's model."""

    def __init__(self, samples: PointSamples | Samples, robot: RobotModel) -> None:
        """Take checked samples."""
        self.samples = samples
        self.robot = robot
        self.follows = isinstance(samples, PointSamples)
        self._unloaded = robot.posture(samples.joints)
        self._before: FloatArray | None = None

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
        return Linearised(residual, motion, covariance, found)

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
        start = self._unloaded
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
    white = np.linalg.inv(np.linalg.cholesky(linearised.covariance))
    white = white * np.sqrt(np.where(weights > 0.0, weights, 1.0))[:, None, None]
    residual = np.einsum("kij,kj->ki", white, linearised.residual)
    rows = np.concatenate([residual[..., None], white @ columns], axis=2)
    shared = 0
    if isinstance(samples, PointSamples):
        shared = _take_out(rows, white, samples, weights > 0.0)
    first, others = np.split(rows, [1], axis=2)
    return Whitened(first.squeeze(axis=2), others, shared)


def _take_out(rows: FloatArray, white: FloatArray, samples: PointSamples, use: BoolArray) -> int:
    """Fit rows (k, m, 1 + p) in use by their groups' offsets and drifts, subtract; count those."""
    count = 0
    order = np.argsort(samples.group, kind="stable")
    starts = np.flatnonzero(np.diff(samples.group[order])) + 1
    for members in np.split(order, starts) if order.size else []:
        used = use[members]
        if not used.any():
            continue
        time = samples.time[members] - samples.time[members].mean()
        spread = np.abs(time).max()
        shared = white[members]
        if used.sum() >= DRIFT_SAMPLES and spread > 0.0:
            drift = shared * (time / spread)[:, None, None]
            shared = np.concatenate([shared, drift], axis=2)
        size, part = shared.shape[2], rows[members]
        basis, triangle = np.linalg.qr(shared[used].reshape(-1, size))
        common = np.linalg.solve(triangle, basis.T @ part[used].reshape(-1, part.shape[2]))
        rows[members] = part - shared @ common
        count += size
    return count


def start_stiffness(observations: Observations) -> FloatArray:
    """First guess of the stiffness: J diag(J^T w) c explains the motion, linear in compliance c.

    Returns:
        (6,) stiffness [N m/rad], with a very stiff guess where the data say nothing of a joint.
    """
    samples = observations.samples
    rigid = Law(np.full(JOINTS, 1e12), np.zeros(JOINTS))
    line = observations.linearise(rigid)
    observations.forget()
    torque = line.balance.posture.torque(line.balance.wrench)
    columns = line.motion * torque[:, None, :]
    rows = whiten(line, columns, samples, np.ones(len(samples)))
    matrix = rows.columns.reshape(-1, JOINTS)
    scale = np.linalg.norm(matrix, axis=0)
    known = scale > 0.0
    compliance = np.zeros(JOINTS)
    found = np.linalg.lstsq(matrix[:, known] / scale[known], rows.residual.ravel(), rcond=1e-6)[0]
    compliance[known] = found / scale[known]
    # A joint whose motion is below the noise starts with the stiffness that moves it by that noise.
    floor = np.where(known, 1.0 / np.where(known, scale, 1.0), 1e-9)
    return np.asarray(1.0 / np.clip(compliance, np.minimum(floor, 1e-3), 1.0))
