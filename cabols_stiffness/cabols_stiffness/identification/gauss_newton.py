# SPDX-License-Identifier: Apache-2.0
"""Numerics of `identify`: weighted Gauss-Newton, outliers, and what the data determine.

Parameters are the joints' compliance c = 1/b, in which the deflection is linear, so that estimates
are unbiased and their intervals right even where they are wide; the cubic terms a; and friction
torques h of joints with hysteresis. Each is scaled by what would matter: c by itself, a by
b / (largest deflection)^2, h by the largest torque.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.errors import CabolsError
from cabols_stiffness.identification.observations import Linearised, Observations, whiten
from cabols_stiffness.model.balance import Law

STEPS = 30
CONVERGED = 1e-6
"""Length of a step, in standard deviations, below which the fit has converged."""

FAST = 0.1
"""Ratio of two steps' lengths below which the third is no more than the second by it."""

EXACT = 1e-8
"""Length of a step, relative to the parameters, below which it has converged, too: exact data."""

FREE = 1e-2
"""Singular values of the scaled, whitened columns below this are directions that the data leave
unidentifiable: a hundred times the parameters' own size along them is one standard deviation."""

HUBER = 2.0
"""Distances beyond this many typical ones get less weight while outliers are looked for."""

HUBER_STEPS = 8
"""Steps of that fit, which need not converge."""

FALSE_ALARM = 0.01
"""Chance that a campaign without outliers loses a sample as one."""

TOO_MANY = 0.3
"""Share of outliers beyond which the data are refused."""


class IdentificationError(CabolsError):
    """The samples cannot be used for an identification."""


class OutliersError(IdentificationError):
    """More samples than a few do not fit the others."""


@dataclass(frozen=True, eq=False)
class Parameters:
    """Of the joints: compliance (6,) [rad/(N m)], cubic (6,) [N m/rad^3], friction (6,) [N m]."""

    compliance: FloatArray
    cubic: FloatArray
    friction: FloatArray

    def law(self, friction_state: FloatArray | None, published: bool) -> Law:
        """Return the joints' law.

        Args:
            friction_state: (k, 6) each sample's share of the friction torque, -1 to 1; None: none.
            published: whether to take the source's (4.15) instead of the exact balance.
        """
        friction = None if friction_state is None else self.friction * friction_state
        return Law(1.0 / self.compliance, self.cubic, friction, published)


@dataclass(frozen=True, eq=False)
class Model:
    """What is estimated.

    Attributes:
        cubic: whether cubic terms are.
        published: whether by the source's (4.15).
        friction_state: (k, 6) see Parameters.law; None: no friction is estimated.
        has_friction: (6,) joints whose friction is estimated.
    """

    cubic: bool
    published: bool
    friction_state: FloatArray | None
    has_friction: BoolArray

    @property
    def estimated(self) -> BoolArray:
        """(18,) which of compliance, cubic, friction are estimated."""
        n = self.has_friction.size
        cubic = np.full(n, self.cubic)
        return np.concatenate([np.ones(n, dtype=np.bool_), cubic, self.has_friction])


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fit.

    Attributes:
        parameters: found.
        scale: (18,) of the parameters, in which `covariance` and `unidentifiable` are.
        covariance: (18, 18) for noise of the stated size, zero where not estimated.
        unidentifiable: (18,) not determined by the data; their covariance is a floor.
        use: (k,) samples that were used.
        chi_square: of the normalised residuals.
        freedom: numbers measured minus numbers estimated.
        distances: (k,) squared, of each sample from the model, normalised.
        deflection: (k, 6) of the joints [rad].
        line: the last linearisation.
        columns: (k, m, p) its scaled derivatives by the p estimated parameters.
        elastic: (p,) False for the frictions among them.
        iterations: Gauss-Newton steps.
        converged: whether the last one was short enough.
        doubt: (18, 18) covariance beside that of the noise: by friction's form; None: none.
    """

    parameters: Parameters
    scale: FloatArray
    covariance: FloatArray
    unidentifiable: BoolArray
    use: BoolArray
    chi_square: float
    freedom: int
    distances: FloatArray
    deflection: FloatArray
    line: Linearised
    columns: FloatArray
    elastic: BoolArray
    iterations: int
    converged: bool
    doubt: FloatArray | None = None


def fit(
    observations: Observations,
    model: Model,
    start: Parameters,
    robust: bool = True,
    use: BoolArray | None = None,
) -> Fitted:
    """Fit a model; leave out outliers.

    Samples count as outliers when their squared distance exceeds what all k samples of a normal
    campaign stay below with probability 1 - FALSE_ALARM, in units of a robust scale (so that a
    poor model does not make outliers of good samples). They are looked for from a fit with Huber's
    weights, which single gross errors cannot pull far, and judged again after each refit.

    Args:
        observations: of the robot.
        model: what to estimate.
        start: first guess; not estimated parameters keep it.
        robust: False: take all samples in use.
        use: (k,) samples to begin with; None: all. A robust fit may take others up again.

    Raises:
        IdentificationError: if more samples than TOO_MANY do not fit the others.
    """
    k, m = len(observations.samples), observations.numbers
    everything = np.ones(k, dtype=np.bool_)
    begin = everything if use is None else use
    found = _gauss_newton(observations, model, start, begin)
    if not robust or (inliers(found.distances, m) == begin).all():
        return found

    def huber(distances: FloatArray) -> FloatArray:
        typical = np.sqrt(max(_robust_scale(distances, m), 1e-12) * np.maximum(m, 1))
        ratio = np.sqrt(np.maximum(distances, 1e-300)) / (HUBER * typical)
        return np.asarray(1.0 / np.maximum(ratio, 1.0))

    # From the first guess: a gross error may have driven a joint's compliance to nothing, where its
    # column vanishes and no later step brings it back.
    weights = huber(found.distances)
    found = _gauss_newton(observations, model, start, everything, huber, HUBER_STEPS, weights)
    for _ in range(5):
        use = inliers(found.distances, m)
        if too_many(observations, use):
            raise OutliersError(
                f"samples: expected at most {100 * TOO_MANY:.0f} % outliers, got {(~use).sum()} of "
                f"{k}; check units, axes and signs of wrench and deflection"
            )
        found = _gauss_newton(observations, model, found.parameters, use)
        if (use == inliers(found.distances, m)).all():
            break
    return found


def inliers(distances: FloatArray, m: IntArray) -> BoolArray:
    """(k,) samples that are no outliers.

    Args:
        distances: (k,) squared, from the model, normalised.
        m: (k,) numbers that were measured in each.
    """
    limit = chi2.ppf((1.0 - FALSE_ALARM) ** (1.0 / distances.size), np.maximum(m, 1))
    return np.asarray(distances <= limit * max(_robust_scale(distances, m), 1.0))


def too_many(observations: Observations, use: BoolArray) -> bool:
    """Whether so many samples do not fit the others that the data are refused.

    Args:
        observations: of the samples; unloaded ones fit any stiffness and are not counted.
        use: (k,) samples that fit.
    """
    loaded = (observations.samples.wrench != 0.0).any(axis=1)
    return not (~use).sum() <= TOO_MANY * max(int(loaded.sum()), 1)


def _robust_scale(distances: FloatArray, m: IntArray) -> float:
    seen = m > 0
    return float(np.median(distances[seen] / chi2.ppf(0.5, m[seen]))) if seen.any() else 1.0


def _gauss_newton(
    observations: Observations,
    model: Model,
    start: Parameters,
    use: BoolArray,
    weigh: Callable[[FloatArray], FloatArray] | None = None,
    limit: int = STEPS,
    weights: FloatArray | None = None,
) -> Fitted:
    """Iterate; weigh, if given, makes weights (k,) from squared distances (k,) at every step."""
    parameters, steps, converged, last = start, 0, False, 0.0
    weights = use.astype(np.float64) if weights is None else weights
    chosen = np.flatnonzero(model.estimated)
    while True:
        line = observations.linearise(parameters.law(model.friction_state, model.published))
        scale = _scales(parameters, line)
        columns = _columns(line, parameters, model)[:, :, chosen] * scale[chosen]
        rows = whiten(line, columns, observations.samples, weights)
        # Of unit variance again: also those of less weight, and those left out.
        distances = np.sum(rows.residual**2, axis=1) / np.where(weights > 0.0, weights, 1.0)
        used = weights > 0.0
        matrix = rows.columns[used].reshape(-1, chosen.size)
        target = rows.residual[used].ravel()
        left, singular, right = np.linalg.svd(matrix, full_matrices=False)
        known = singular > FREE
        if converged or steps == limit:
            break
        step = (left.T @ target)[known]
        moved = right[known].T @ (step / singular[known])
        before, parameters = parameters, _moved(parameters, moved, chosen, scale, line)
        steps += 1
        if weigh is not None:
            weights = weigh(distances)
        size = float(np.linalg.norm(step))
        # Steps shrink in a constant ratio: the next one is known where they shrink fast.
        ratio = size / last if weigh is None and last > 0.0 else 1.0
        expected = size * ratio if ratio < FAST else size
        last = size
        short = bool(expected <= CONVERGED or np.linalg.norm(moved) <= EXACT)
        converged = short and _close(before, parameters)
    inverse = right.T / np.maximum(singular, FREE)
    covariance = np.zeros((scale.size, scale.size))
    covariance[np.ix_(chosen, chosen)] = inverse @ inverse.T
    unidentifiable = np.zeros(scale.size, dtype=np.bool_)
    unidentifiable[chosen] = (np.abs(right[~known]) > 1e-3).any(axis=0)
    # A softening that was stopped at its bound is no estimate, nor is the slope beside it.
    bound = model.cubic & (parameters.cubic <= 0.999 * _least_cubic(parameters.compliance, line))
    n = parameters.compliance.size
    unidentifiable[: 2 * n] |= np.tile(bound, 2)
    return Fitted(
        parameters, scale, covariance, unidentifiable, use,
        float(target @ target),
        int(observations.numbers[used].sum()) - rows.shared - int(known.sum()),
        distances, line.balance.deflection, line, columns, chosen < 2 * n, steps, converged,
    )  # fmt: skip


def _close(before: Parameters, after: Parameters) -> bool:
    # A step cut short at a bound is no sign of convergence.
    return bool(np.allclose(before.compliance, after.compliance, rtol=0.1, atol=0.0))


def _scales(parameters: Parameters, line: Linearised) -> FloatArray:
    reach = _reach(line)
    stiffness = 1.0 / parameters.compliance
    return np.concatenate([parameters.compliance, stiffness / reach**2, stiffness * reach])


def _reach(line: Linearised) -> FloatArray:
    """(6,) largest deflection of each joint [rad]."""
    return np.asarray(np.maximum(np.abs(line.balance.deflection).max(axis=0, initial=0.0), 1e-9))


def _least_cubic(compliance: FloatArray, line: Linearised) -> FloatArray:
    """(6,) bound of cubic terms [N m/rad^3].

    Softening so strong that the torque falls again within the data has no balance.
    """
    return np.asarray(-0.25 / (compliance * _reach(line) ** 2))


def _columns(line: Linearised, parameters: Parameters, model: Model) -> FloatArray:
    """(k, m, 18) derivatives of the prediction by compliance, cubic, friction."""
    rest = line.balance
    by_compliance = line.motion @ rest.by_stiffness / -(parameters.compliance**2)
    friction_state = (
        np.zeros_like(rest.deflection) if model.friction_state is None else model.friction_state
    )
    by_friction = -line.motion @ rest.softness * friction_state[:, None, :]
    return np.concatenate([by_compliance, line.motion @ rest.by_cubic, by_friction], axis=2)


def _moved(
    parameters: Parameters,
    step: FloatArray,
    chosen: IntArray,
    scale: FloatArray,
    line: Linearised,
) -> Parameters:
    full = np.zeros(scale.size)
    full[chosen] = step
    full *= scale
    old, n = parameters.compliance, parameters.compliance.size
    compliance = np.clip(old + full[:n], 0.2 * old, 5.0 * old)
    least = _least_cubic(compliance, line)
    cubic = np.maximum(parameters.cubic + full[n : 2 * n], least)
    return replace(
        parameters,
        compliance=compliance,
        cubic=cubic,
        friction=parameters.friction + full[2 * n :],
    )
