# SPDX-License-Identifier: Apache-2.0
"""Normal equations of a fit, configuration by configuration; Cochran's Q and random effects.

All parameters are relative to their scale, so that a change of 0.01 of a compliance is one per
cent. Sources: Cochran, Biometrics 10 (1954) 101, here for several joints at once; DerSimonian and
Laird, Controlled Clinical Trials 7 (1986) 177; restricted maximum likelihood by expectation
maximisation, Laird and Ware, Biometrics 38 (1982) 963.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as fisher

from cabols_control.checks import FloatArray, IntArray

CERTAIN = 1e-4
"""Probability of chi-square, or of Cochran's Q, below which chance does not explain it."""

NONE = 1e-9
"""Relative eigenvalue below which a configuration says nothing along a direction."""

CYCLES = 200
SETTLED = 1e-5
"""Relative change of the scatter's square that ends the rounds."""

NEGLIGIBLE = 1e-5
"""Scatter below which its change does not matter."""

FARTHEST = 50.0
MOST = 10.0
"""Of a scatter on the way, relative."""

START = 0.05
"""Scatter to begin with, relative."""

LEAST = 1e-7
LEAST_MEAN = 0.2
"""Of a pooled compliance, relative to the fit's."""

FAR = 2.0
"""Ratio of a joint's own compliance to the fit's from which on the own one is the unit."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Normal equations of c configurations in p parameters, for noise of unit size.

    Attributes:
        configuration: (c,) their numbers.
        matrix: (c, p, p).
        target: (c, p); the sum is about zero, at the fit.
        variance: of the residuals within configurations, in units of the stated noise.
        within_freedom: degrees of freedom of it.
    """

    configuration: IntArray
    matrix: FloatArray
    target: FloatArray
    variance: float
    within_freedom: int


@dataclass(frozen=True)
class Heterogeneity:
    """Cochran's Q.

    Attributes:
        q: weighted squares of the configurations' own parameters about the pooled ones.
        freedom: degrees of freedom.
        probability: of so large a Q if the configurations do not differ.
    """

    q: float
    freedom: int
    probability: float


@dataclass(frozen=True, eq=False)
class RandomEffects:
    """Pooled parameters where each configuration has its own.

    Attributes:
        change: (p,) of the pooled parameters, relative to the fit's.
        covariance: (p, p) of them, relative to the pooled ones.
        scatter: (n,) standard deviation between configurations, of the joints' compliance,
            likewise.
        freedom: (n,) degrees of freedom of each joint's interval.
    """

    change: FloatArray
    covariance: FloatArray
    scatter: FloatArray
    freedom: FloatArray


def blocks(
    columns: FloatArray, residual: FloatArray, numbers: FloatArray, configuration: IntArray
) -> Blocks:
    """Sum up whitened rows by configuration.

    Args:
        columns: (k, m, p) whitened, offsets and drifts taken out.
        residual: (k, m) likewise.
        numbers: degrees of freedom of each sample, (k,): measured, less its share of offsets.
        configuration: (k,) of each sample.
    """
    found = np.unique(configuration)
    p = columns.shape[2]
    matrix, target = np.empty((found.size, p, p)), np.empty((found.size, p))
    own, rank = 0.0, 0
    for i, each in enumerate(found):
        here = configuration == each
        rows = columns[here].reshape(-1, p)
        matrix[i], target[i] = rows.T @ rows, rows.T @ residual[here].ravel()
        explained, one = _own(matrix[i], target[i])
        own, rank = own + explained, rank + one
    freedom = round(float(numbers.sum())) - rank
    left = max(float(np.sum(residual**2)) - own, 0.0)
    # Where nothing is left over, the noise is what the measurement states.
    variance = left / freedom if freedom > 0 else 1.0
    return Blocks(found, matrix, target, max(variance, 1e-12), freedom)


def heterogeneity(found: Blocks) -> Heterogeneity:
    """Test whether configurations differ, against the residuals within them."""
    q, rank = _own_of_all(found.matrix, found.target)
    total, pooled = found.matrix.sum(axis=0), found.target.sum(axis=0)
    explained, one = _own(total, pooled)
    q, freedom = q - explained, rank - one
    if freedom < 1 or found.within_freedom < 1:
        return Heterogeneity(q, max(freedom, 0), 1.0)
    ratio = q / freedom / max(found.variance, 1e-300)
    return Heterogeneity(q, freedom, float(fisher.sf(ratio, freedom, found.within_freedom)))


def are_different(found: Blocks, test: Heterogeneity) -> bool:
    """Whether configurations differ beyond doubt.

    Also where the residuals within them are few, so that they say little of the noise, but agree
    with the stated one.

    Args:
        found: of all.
        test: of them.
    """
    if len(found.configuration) < 3:
        return False
    if test.probability < CERTAIN:
        return True
    inside = float(chi2.sf(found.variance * found.within_freedom, max(found.within_freedom, 1)))
    return inside > CERTAIN and float(chi2.sf(test.q, max(test.freedom, 1))) < CERTAIN


def leave_one_out(found: Blocks, joints: int) -> FloatArray:
    """(c, n) relative change of each joint's stiffness without each configuration.

    Args:
        found: of all.
        joints: number n; their compliances are the first parameters.
    """
    total, target = found.matrix.sum(axis=0), found.target.sum(axis=0)
    changes = [
        -np.linalg.pinv(total - matrix, rcond=NONE, hermitian=True) @ (target - one)
        for matrix, one in zip(found.matrix, found.target, strict=True)
    ]
    return np.array(changes)[:, :joints]


def random_effects(found: Blocks, joints: int) -> RandomEffects:
    """Pool configurations whose compliances scatter normally about their mean.

    Args:
        found: two or more configurations.
        joints: number n; their compliances are the first parameters.
    """
    unit = _units(found, joints)
    precision = found.matrix * np.outer(unit, unit) / found.variance
    score = found.target * unit / found.variance
    c, tau = len(found.configuration), np.full(joints, START**2)
    solved = _solved(precision, score, tau)
    for _ in range(CYCLES):
        # Two rounds, and as far as they lead (SQUAREM: Varadhan and Roland, Scandinavian Journal of
        # Statistics 35 (2008) 335), in logarithms: scatter that is none goes down for ever.
        first = solved.tau
        second = _solved(precision, score, first).tau
        step, bend = np.log(first / tau), np.log(second / first) - np.log(first / tau)
        size = float(np.linalg.norm(step)) / max(float(np.linalg.norm(bend)), 1e-300)
        size = float(np.clip(size, 1.0, FARTHEST))
        tau = np.clip(np.exp(np.log(tau) + 2.0 * size * step + size**2 * bend), LEAST**2, MOST**2)
        tau = _solved(precision, score, tau).tau
        solved = _solved(precision, score, tau)
        if (np.abs(solved.tau - tau) <= SETTLED * tau + NEGLIGIBLE**2).all():
            break
    tau, covariance, change = solved.tau, solved.covariance, solved.change
    fixed = np.diag(np.linalg.pinv(precision.sum(axis=0), rcond=NONE, hermitian=True))[:joints]
    total = np.diag(covariance)[:joints]
    share = np.clip(1.0 - fixed / np.maximum(total, 1e-300), 0.0, 1.0)
    freedom = 1.0 / (share**2 / (c - 1) + (1.0 - share) ** 2 / max(found.within_freedom, 1))
    change = change * unit
    # Relative to the pooled value now, which the linear model allows at any distance.
    mean = np.ones_like(unit)
    mean[:joints] = np.maximum(1.0 + change[:joints], LEAST_MEAN)
    to_mean = unit / mean
    return RandomEffects(
        change, covariance * np.outer(to_mean, to_mean), np.sqrt(tau) * to_mean[:joints], freedom
    )


@dataclass(frozen=True, eq=False)
class _Round:
    """Of expectation maximisation: (n,) squares of the scatter, mean and its covariance before."""

    tau: FloatArray
    covariance: FloatArray
    change: FloatArray


def _solved(precision: FloatArray, score: FloatArray, tau: FloatArray) -> _Round:
    """One round from the squares tau (n,) of the scatter."""
    joints = tau.size
    beside, across = precision[:, :, :joints], precision[:, :joints, :]
    inner = np.linalg.inv(precision[:, :joints, :joints] + np.diag(1.0 / tau))
    weight = precision - beside @ inner @ across
    pull = score - np.einsum("cij,cjk,ck->ci", beside, inner, score[:, :joints])
    covariance = np.linalg.pinv(weight.sum(axis=0), rcond=NONE, hermitian=True)
    change = covariance @ pull.sum(axis=0)
    effect = np.einsum("cij,cj->ci", inner, score[:, :joints] - across @ change)
    lead = inner @ across
    spread = inner + lead @ covariance @ lead.swapaxes(1, 2)
    found = np.mean(effect**2 + np.einsum("cjj->cj", spread), axis=0)
    return _Round(np.maximum(found, LEAST**2), covariance, change)


def whitened_by_scatter(joints: FloatArray, size: FloatArray, values: FloatArray) -> FloatArray:
    """(r, ...) rows of one configuration, whitened where its joints scatter.

    Args:
        joints: (r, n) columns of the joints' compliance.
        size: (n,) standard deviation of each between configurations, by that of the noise.
        values: (r, ...) rows.
    """
    own = joints * size
    # Of X X^T with X = U s V^T the part along U shrinks by 1 - 1 / sqrt(1 + s^2).
    square, vectors = np.linalg.eigh(own.T @ own)
    square = np.maximum(square, 0.0)
    root = np.sqrt(1.0 + square)
    # (1 - 1 / root) / square without its difference, which vanishes with square.
    inner = (vectors / (root * (1.0 + root))) @ vectors.T
    return np.asarray(values - own @ (inner @ (own.T @ values)))


def _units(found: Blocks, joints: int) -> FloatArray:
    """(p,) of the parameters: 1, or a joint's typical own compliance where the fit is far off it.

    A pooled fit of configurations that differ may end far from what each of them says, even at a
    compliance of nearly zero; relative to that nothing would have a usual size.
    """
    unit = np.ones(found.matrix.shape[1])
    own = np.array(
        [
            np.linalg.pinv(matrix, rcond=NONE, hermitian=True) @ target
            for matrix, target in zip(*_scaled(found), strict=True)
        ]
    )
    size = np.sqrt(np.maximum(np.einsum("cii->ci", found.matrix), 1e-300))
    middle = 1.0 + np.median(own / size, axis=0)[:joints]
    far = (middle > FAR) | ((middle > 0.0) & (middle < 1.0 / FAR))
    unit[:joints] = np.where(far, middle, 1.0)
    return unit


def _scaled(found: Blocks) -> tuple[FloatArray, FloatArray]:
    """Matrices and targets for columns of unit length."""
    size = np.sqrt(np.maximum(np.einsum("cii->ci", found.matrix), 1e-300))
    return found.matrix / (size[:, :, None] * size[:, None, :]), found.target / size


def _own_of_all(matrix: FloatArray, target: FloatArray) -> tuple[float, int]:
    """Sums of _own over configurations (c, p, p), (c, p)."""
    size = np.sqrt(np.maximum(np.einsum("cii->ci", matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / (size[:, :, None] * size[:, None, :]))
    known = values > NONE * np.maximum(values[:, -1:], 1e-300)
    along = np.einsum("cij,ci->cj", vectors, target / size)
    explained = np.where(known, along**2 / np.where(known, values, 1.0), 0.0)
    return float(explained.sum()), int(known.sum())


def _own(matrix: FloatArray, target: FloatArray) -> tuple[float, int]:
    """Sum of squares that a configuration's own parameters explain, and how many it determines."""
    size = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    known = values > NONE * max(float(values[-1]), 1e-300)
    along = vectors.T[known] @ (target / size)
    return float(np.sum(along**2 / values[known])), int(known.sum())
