# SPDX-License-Identifier: Apache-2.0
"""Uncertainty budget of joint stiffness: type A from the fit, type B through sensitivities.

A systematic effect moves every measured number by a known amount; what the fit then takes for
stiffness is its sensitivity. Sources: JCGM 100:2008 (GUM), 5.1 and 5.2; effective degrees of
freedom by Welch and Satterthwaite, annex G.4.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_stiffness.certificate.statement import UNITS, Kind, Source
from cabols_stiffness.identification.adequacy.suspects import suspects
from cabols_stiffness.identification.gauss_newton import Fitted
from cabols_stiffness.identification.identify import estimate
from cabols_stiffness.identification.observations import Observations, whiten
from cabols_stiffness.measurements.samples import PointSamples, Samples
from cabols_stiffness.measurements.usable import usable_rows
from cabols_stiffness.model.balance import Law
from cabols_stiffness.model.model_words import LINEAR
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.verdict import Suspect

PROBABILITY = 0.95
STEP_RAD = 1e-4
"""Turn of a joint's zero for a difference."""

COLUMNS: dict[Kind, tuple[Suspect, slice]] = {
    Kind.FORCE_GAIN: (Suspect.WRENCH_GAIN, slice(0, 3)),
    Kind.TORQUE_GAIN: (Suspect.WRENCH_GAIN, slice(3, 6)),
    Kind.SENSOR_AXES: (Suspect.WRENCH_FRAME, slice(0, 3)),
    Kind.SENSOR_POINT: (Suspect.WRENCH_POINT, slice(0, 3)),
    Kind.TOOL_POINT: (Suspect.TOOL_POINT, slice(0, 3)),
    Kind.TRACKER_AXES: (Suspect.BASE_FRAME, slice(0, 3)),
    Kind.DRIFT: (Suspect.CREEP, slice(0, 3)),
}
"""Columns that the verdict's score tests use, too."""


@dataclass(frozen=True, eq=False)
class Row:
    """One line of the budget.

    Attributes:
        name: of the source.
        evidence: that it rests on.
        kind: "A" or "B".
        standard_uncertainty: of the source, in `unit`; NaN for type A.
        unit: of it.
        relative: (n,) standard uncertainty of each joint's stiffness by it, relative.
        freedom: (n,) degrees of freedom; infinite if exactly known.
    """

    name: str
    evidence: str
    kind: str
    standard_uncertainty: float
    unit: str
    relative: FloatArray
    freedom: FloatArray


@dataclass(frozen=True, eq=False)
class Budget:
    """Of all joints.

    Attributes:
        rows: type A first.
        covariance: (n, n) combined, relative.
        freedom: (n,) effective.
        coverage: (n,) factor k of 95 %.
    """

    rows: tuple[Row, ...]
    covariance: FloatArray
    freedom: FloatArray
    coverage: FloatArray

    @property
    def combined(self) -> FloatArray:
        """(n,) standard uncertainty of each joint's stiffness, relative."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))

    @property
    def expanded(self) -> FloatArray:
        """(n,) at 95 %, relative."""
        return np.asarray(self.coverage * self.combined)

    @property
    def correlation(self) -> FloatArray:
        """(n, n) between the joints."""
        size = np.maximum(self.combined, 1e-300)
        return np.asarray(self.covariance / np.outer(size, size))


def budget(
    result: StiffnessResult,
    samples: PointSamples | Samples,
    robot: RobotModel,
    sources: list[Source],
) -> Budget:
    """Combine what the fit states with what is stated of instruments and frames.

    Args:
        result: of an identification of the samples.
        samples: that it is from.
        robot: with its tool.
        sources: of type B.

    Raises:
        CabolsError: if a source has no meaning for these samples.
    """
    n = robot.n
    observations = Observations(usable_rows(samples).samples, robot)
    found, _, _ = estimate(observations, LINEAR, hysteresis=False)
    stiffness = np.where(result.identifiable, result.stiffness, np.nan)
    covariance = result.covariance[:n, :n] / np.outer(stiffness, stiffness)
    rows = [
        Row(
            name="fit: noise of tracker and sensor, scatter between configurations",
            evidence="residuals of this measurement",
            kind="A",
            standard_uncertainty=float("nan"),
            unit="-",
            relative=np.sqrt(np.diagonal(covariance)),
            freedom=_freedom(result),
        )
    ]
    guessed = suspects(observations, found, False)
    for source in sources:
        moves = _moves(source.kind, observations, found, guessed)
        shift = _shift(observations, found, moves, n)
        size = moves.shape[2]
        inside = np.full((size, size), source.correlation)
        np.fill_diagonal(inside, 1.0)
        part = source.standard_uncertainty**2 * shift @ inside @ shift.T
        covariance = covariance + part
        freedom = source.freedom if source.freedom > 0.0 else np.inf
        rows.append(
            Row(
                name=source.kind.value.replace("_", " "),
                evidence=source.evidence,
                kind="B",
                standard_uncertainty=source.standard_uncertainty,
                unit=UNITS[source.kind],
                relative=np.sqrt(np.diagonal(part)),
                freedom=np.full(n, freedom),
            )
        )
    total = np.diagonal(covariance)
    parts = sum((row.relative**4 / row.freedom for row in rows), np.zeros(n))
    effective = total**2 / np.maximum(parts, 1e-300)
    coverage = student.ppf(0.5 + 0.5 * PROBABILITY, np.maximum(effective, 1.0))
    return Budget(tuple(rows), covariance, effective, coverage)


def _freedom(result: StiffnessResult) -> FloatArray:
    """Degrees of freedom of each joint's own interval, from its width."""
    n = result.n
    low, high = result.interval.T
    half = 0.5 * (1.0 / low - 1.0 / high) * result.stiffness
    relative = result.standard_deviation / result.stiffness
    factor = half / relative
    tried = np.concatenate([np.arange(1.0, 60.0), [100.0, 1e3, 1e6]])
    table = student.ppf(0.5 + 0.5 * PROBABILITY, tried)
    nearest = np.abs(table[:, None] - np.nan_to_num(factor, nan=2.0)).argmin(axis=0)
    return np.asarray(np.minimum(tried[nearest], float(result.degrees_of_freedom)).reshape(n))


def _moves(
    kind: Kind,
    observations: Observations,
    found: Fitted,
    guessed: dict[Suspect, FloatArray],
) -> FloatArray:
    """(k, m, q) what one unit of each component of an effect moves."""
    if kind in COLUMNS:
        suspect, which = COLUMNS[kind]
        if suspect not in guessed:
            raise CabolsError(
                f"{kind.value}: expected positions in passes, got poses; leave this source out"
            )
        return np.asarray(guessed[suspect][:, :, which])
    motion = np.einsum("kij,kj->ki", found.line.motion, found.deflection)[:, :, None]
    if kind is Kind.KINEMATICS:
        return _by_zeros(observations, found)
    return np.asarray(motion)


def _by_zeros(observations: Observations, found: Fitted) -> FloatArray:
    """(k, m, n) by the zero of each joint, by differences."""
    samples = observations.samples
    law = Law(1.0 / found.parameters.compliance, found.parameters.cubic)
    before = observations.linearise(law).residual
    parts = []
    for j in range(observations.robot.n):
        joints = samples.joints.copy()
        joints[:, j] += STEP_RAD
        moved = Observations(replace(samples, joints=joints), observations.robot)
        parts.append((before - moved.linearise(law).residual) / STEP_RAD)
    return np.stack(parts, axis=2)


def _shift(observations: Observations, found: Fitted, moves: FloatArray, n: int) -> FloatArray:
    """(n, q) relative change of each joint's stiffness by one unit of each component."""
    columns = np.concatenate([found.columns[:, :, :n], moves], axis=2)
    use = found.use
    rows = whiten(found.line, columns, observations.samples, use.astype(np.float64))
    matrix = rows.columns[use].reshape(-1, columns.shape[2])
    own, other = matrix[:, :n], matrix[:, n:]
    return np.asarray(-np.linalg.lstsq(own, other, rcond=1e-9)[0])
