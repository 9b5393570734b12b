# SPDX-License-Identifier: Apache-2.0
"""Fit of the chosen blocks to the exact balance, with covariance, scatter, the choice's doubt."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from cabols_control.checks import BoolArray, FloatArray
from cabols_stiffness.identification.elastic_observations import (
    covariance_of,
    draw,
    motion_of,
    residual_of,
)
from cabols_stiffness.identification.gauss_newton import Fitted
from cabols_stiffness.identification.observations import Linearised, Observations
from cabols_stiffness.ladder.candidates import FLAT, Candidate
from cabols_stiffness.ladder.choose import Choice
from cabols_stiffness.ladder.evidence import Rows, rows_of, solve
from cabols_stiffness.ladder.scatter import Scatter, scatter_of, weighted
from cabols_stiffness.model.elastic.arm import ACCURACY, Arm, settle
from cabols_stiffness.model.elastic.blocks import Friction, Joints, Statics
from cabols_stiffness.model.model_words import Rung

STEPS = 8
CONVERGED = 0.03
"""Length of a step, in standard deviations, below which the fit has converged."""

ON_THE_WAY = 1e-6
"""Accuracy of the balance before the last step, relative to the largest deflection."""

DRAWN = 3
"""Steps before each of which friction is drawn anew along the deflections."""

SMOOTHED = 1.75
"""Factor on the deviation of the prior of compliance that varies, for its covariance.

The prior that predicts best smooths: it draws the values towards zero by as much as it saves in
noise. A covariance with the same prior holds that on the average over robots drawn from the prior,
but not for one robot whose stiffness varies at a few joints. So the covariance is that of smoothing
less (undersmoothing: Hall, Annals of Statistics 20 (1992) 675)."""

WIDEST = 10.0
"""Most by which held-out errors widen the covariance."""

OUTLIER = 0.01
"""Chance that a campaign without outliers loses a sample as one."""


@dataclass(frozen=True, eq=False)
class ElasticFit:
    """Blocks, fitted.

    Attributes:
        arm: blocks and their values.
        covariance: (p, p) of the values, with the scatter and the doubt about friction's form.
        scatter: between configurations.
        variance: of the residuals, in the stated noise.
        freedom: numbers measured less parameters and offsets.
        use: (k,) samples in use.
        state: of the samples.
        rows: of the samples in use, at the fit, weighted by the scatter.
        line: a linearisation with the samples' covariances.
        columns: (k, m, p) what is measured, by the values.
        residual: (k, m).
        steps: Gauss-Newton steps.
        converged: whether the last one was short enough.
        taken: the chosen blocks, with the priors that the data make likely.
        widened: factor on the covariance by held-out errors.
    """

    arm: Arm
    covariance: FloatArray
    scatter: Scatter
    variance: float
    freedom: int
    use: BoolArray
    state: Statics
    rows: Rows
    line: Linearised
    columns: FloatArray
    residual: FloatArray
    steps: int
    converged: bool
    taken: tuple[Candidate, ...]
    widened: float = 1.0


def fit_choice(
    observations: Observations, found: Fitted, choice: Choice, start: ElasticFit | None = None
) -> ElasticFit:
    """Fit what the ladder chose.

    Args:
        observations: of the robot.
        found: fit of the joints alone.
        choice: of the ladder.
        start: of the same choice and samples, to begin with; it saves time only.
    """
    fit = _fitted(observations, found, choice, found.use if start is None else start.use, start)
    use = _inliers(observations, fit)
    if (use != fit.use).any():
        fit = _fitted(observations, found, choice, use, fit)
    fit = _calibrated(fit)
    for rival, kept in choice.rivals:
        fit = _doubted(observations, fit, choice, rival, kept)
    return fit


def prior_precision(taken: tuple[Candidate, ...], noise: float) -> FloatArray:
    """(p,) precision of the values about zero, for residuals of unit size.

    Args:
        taken: blocks with their priors.
        noise: variance of the residuals.
    """
    parts = [
        np.full(one.block.size, 0.0 if one.prior >= FLAT else noise / one.prior**2) for one in taken
    ]
    return np.concatenate(parts)


def _fitted(
    observations: Observations,
    found: Fitted,
    choice: Choice,
    use: BoolArray,
    start: ElasticFit | None,
) -> ElasticFit:
    samples, robot = observations.samples, observations.robot
    n, m = robot.n, observations.size
    blocks = tuple(one.block for one in choice.taken)
    size = sum(block.size for block in blocks)
    values = np.zeros(size) if start is None else start.arm.values
    line, taken, deflection = found.line, choice.taken, found.deflection
    if start is not None:
        taken, deflection = start.taken, start.state.deflection
    else:
        joints = blocks[0]
        assert isinstance(joints, Joints)
        values[:n] = found.parameters.compliance / joints.scale
    converged, steps = False, 0
    drawn = np.zeros_like(deflection) if start is None else start.state.friction
    bodies = None if start is None else start.state.bodies
    # From the end of an earlier fit friction is drawn once more, and the priors stay.
    rounds, first = (DRAWN, 1) if start is None else (1, 0)
    scatter = Scatter(np.zeros(n), max(choice.rms**2, 1e-12), np.zeros(n))
    while True:
        arm = Arm(blocks, values)
        friction = arm.friction
        if friction is not None and steps < rounds:
            drawn = draw(observations, deflection, friction.form, friction.travel, choice.kept)
        accuracy = ACCURACY if converged or steps == STEPS else ON_THE_WAY
        state = settle(
            robot, arm, samples.joints, samples.wrench, observations.follows, drawn, deflection,
            accuracy, bodies,
        )  # fmt: skip
        deflection, bodies = state.deflection, state.bodies
        residual = residual_of(observations, arm, state)
        columns = motion_of(observations, state) @ arm.columns(state)
        if steps == first:
            line = replace(line, covariance=covariance_of(observations, arm, state))
        rows = rows_of(observations, residual, columns, line, use)
        if steps >= first:
            scatter = scatter_of(rows, rows.residual, rows.columns[:, :n], quick=not converged)
        precision = prior_precision(taken, scatter.variance)
        matrix = weighted(rows, rows.columns[:, :n], scatter, rows.columns)
        left = weighted(rows, rows.columns[:, :n], scatter, rows.residual)
        gram = matrix.T @ matrix + np.diag(precision)
        step = solve(gram, matrix.T @ left - precision * values)
        if converged or steps == STEPS:
            break
        size_of_step = float(step @ gram @ step)
        converged = steps > first and size_of_step <= CONVERGED**2 * scatter.variance
        values = values + step
        if 0 < steps <= DRAWN and start is None:
            spread = scatter.variance * np.diagonal(solve(gram, np.eye(size)))
            taken = _with_likely_priors(taken, values, spread)
        steps += 1
    inverse = solve(gram, np.eye(size))
    effective = size - float(np.sum(precision * np.diagonal(inverse)))
    covariance = solve(gram - np.diag(_oversmoothed(taken, precision)), np.eye(size))
    freedom = max(rows.freedom - effective, 1.0)
    variance = scatter.variance
    if not scatter.any:
        variance = float(rows.residual @ rows.residual) / freedom
        scatter = replace(scatter, freedom=np.full(n, freedom))
    return ElasticFit(
        arm=arm,
        covariance=variance * covariance,
        scatter=scatter,
        variance=variance,
        freedom=round(freedom),
        use=use,
        state=state,
        rows=replace(rows, residual=left, columns=matrix),
        line=line,
        columns=columns.reshape(-1, m, size),
        residual=residual,
        steps=steps,
        converged=converged,
        taken=taken,
    )


def _oversmoothed(taken: tuple[Candidate, ...], precision: FloatArray) -> FloatArray:
    """(p,) part of the priors' precision that the covariance leaves out; see SMOOTHED."""
    varying = [np.full(one.block.size, one.rung is Rung.VARYING) for one in taken]
    return np.where(np.concatenate(varying), (1.0 - 1.0 / SMOOTHED**2) * precision, 0.0)


def _with_likely_priors(
    taken: tuple[Candidate, ...], values: FloatArray, spread: FloatArray
) -> tuple[Candidate, ...]:
    """A step of expectation maximisation of the priors' sizes, where a block has one.

    Held-out cells chose among a few sizes; a prior that is too tight would bend what is large.
    """
    found, at = [], 0
    for one in taken:
        here = slice(at, at + one.block.size)
        at = here.stop
        if one.prior >= FLAT:
            found.append(one)
            continue
        likely = float(np.sqrt(np.mean(values[here] ** 2 + spread[here])))
        # One pair of joints may be coupled and all others not: the size of all says little of it.
        least = one.prior if one.rung is Rung.COUPLING else one.prior / 3.0
        found.append(replace(one, prior=float(np.clip(likely, least, 3.0 * one.prior))))
    return tuple(found)


def _inliers(observations: Observations, fit: ElasticFit) -> BoolArray:
    """Samples that the chosen model does not contradict; the joints alone leave out more."""
    numbers = np.maximum(observations.numbers, 1)
    limit = chi2.ppf((1.0 - OUTLIER) ** (1.0 / numbers.size), numbers)
    typical = np.median(fit.rows.distances / chi2.ppf(0.5, numbers))
    return np.asarray(fit.rows.distances <= limit * max(float(typical), 1.0))


def _calibrated(fit: ElasticFit) -> ElasticFit:
    """Widen the covariance where held-out cells miss by more than it and the noise explain."""
    rows, precision = fit.rows, prior_precision(fit.taken, fit.variance)
    target = rows.residual + rows.columns @ fit.arm.values
    fold = rows.fold[rows.cell]
    gram, right = rows.columns.T @ rows.columns + np.diag(precision), rows.columns.T @ target
    excess = stated = 0.0
    for f in range(int(rows.fold.max(initial=0)) + 1):
        out = fold == f
        mine, left = rows.columns[out], target[out]
        inside = gram - mine.T @ mine
        error = left - mine @ solve(inside, right - mine.T @ left)
        numbers = float(rows.numbers[rows.fold == f].sum())
        excess += float(error @ error) - fit.variance * numbers
        stated += fit.variance * float(np.sum(mine.T * solve(inside, mine.T)))
    factor = float(np.clip(excess / max(stated, 1e-300), 1.0, WIDEST))
    return replace(fit, covariance=factor * fit.covariance, widened=factor)


def _doubted(
    observations: Observations, fit: ElasticFit, choice: Choice, rival: Candidate, kept: bool
) -> ElasticFit:
    """Add how far another form of friction moves the other values, as another source of variance.

    Both forms count as equally likely: the variance of two is a quarter of their difference's
    square. Friction's own values have another meaning in each form and are left as they are.
    """
    form = rival.block
    assert isinstance(form, Friction)
    own = np.concatenate(
        [np.full(one.block.size, one.rung is Rung.FRICTION) for one in choice.taken]
    )
    drawn = draw(observations, fit.state.deflection, form.form, form.travel, kept)
    columns = form.columns(replace(fit.state, friction=drawn))
    measured = motion_of(observations, fit.state) @ columns
    theirs = rows_of(observations, fit.residual, measured, fit.line, fit.use).columns
    mine = fit.rows.columns
    target = fit.rows.residual + mine @ fit.arm.values
    precision = prior_precision(fit.taken, fit.variance)[~own]
    both = np.hstack([mine[:, ~own], theirs])
    gram = both.T @ both + np.diag(np.append(precision, np.zeros(form.size)))
    value = solve(gram, both.T @ target)[: precision.size]
    apart = np.zeros(own.size)
    apart[~own] = value - fit.arm.values[~own]
    doubt = 0.25 * np.outer(apart, apart) / max(len(choice.rivals), 1)
    return replace(fit, covariance=fit.covariance + doubt)
