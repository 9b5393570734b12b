# SPDX-License-Identifier: Apache-2.0
"""Verdict on what the ladder chose: chi-square, scatter, score tests of wrong data beside it."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as fisher

from cabols_control.checks import FloatArray
from cabols_stiffness.identification.adequacy.small_mistakes import (
    SIZES,
    Doubt,
    SmallMistakes,
    likely,
)
from cabols_stiffness.identification.adequacy.suspects import suspects
from cabols_stiffness.identification.adequacy.texts import TEXTS, text_of
from cabols_stiffness.identification.adequacy.wrong_data import wrong_data
from cabols_stiffness.identification.gauss_newton import Fitted
from cabols_stiffness.identification.observations import Observations
from cabols_stiffness.ladder.choose import Fault
from cabols_stiffness.ladder.evidence import rows_of
from cabols_stiffness.ladder.fit import ElasticFit, prior_precision
from cabols_stiffness.ladder.scatter import weighted
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.verdict import Finding, Grade, Suspect, Verdict

CERTAIN = 1e-4
TOO_LARGE = 1.25
"""Residuals, in the stated noise, beyond which the chosen model does not explain the data."""

MATTERS = 0.02
"""Share of the motion that a cause must explain to be grave."""

FAR_TOO_LARGE = 3.0
"""Residuals of the joints alone, likewise, beyond which signs, units and orders may be wrong."""

LEAST_EXPLAINED = 0.5
MOSTLY = 0.9
"""Share of the motion's sum of squares below which they are tried."""

INDEPENDENT = 1e-4
"""Relative singular value below which a cause is what the model has already."""


Columns = dict[Suspect, FloatArray]


def suspects_of(observations: Observations, found: Fitted, fit: ElasticFit) -> Columns:
    """(r, m) columns of each suspect, whitened and weighted as the fit's rows.

    Args:
        observations: of the robot.
        found: fit of the joints alone.
        fit: of the chosen blocks.
    """
    n = fit.scatter.deviation.size
    tried = suspects(observations, found, False)
    parts = [fit.columns[..., :n], *tried.values()]
    ends = np.cumsum([one.shape[2] for one in parts])[:-1]
    rows = rows_of(observations, fit.residual, np.concatenate(parts, axis=2), fit.line, fit.use)
    joints, *others = np.split(rows.columns, ends, axis=1)
    whole = weighted(rows, joints, fit.scatter, np.hstack(others))
    return dict(zip(tried, np.split(whole, ends[1:] - n, axis=1), strict=True))


def small_mistakes(fit: ElasticFit, tried: Columns) -> Doubt:
    """What small mistakes in the data may have done to the fit's values.

    Args:
        fit: of the chosen blocks.
        tried: columns of the suspects.
    """
    rows, values = fit.rows, fit.arm.values
    prior = np.sqrt(prior_precision(fit.taken, fit.variance))
    held = prior > 0.0
    base = np.vstack([rows.columns, np.diag(prior)[held]])
    target = np.concatenate([rows.residual, (-prior * values)[held]])
    mistakes = SmallMistakes(base, target, max(fit.variance, 1.0))
    for suspect, columns in tried.items():
        if suspect in SIZES:
            nothing = np.zeros((int(held.sum()), columns.shape[1]))
            mistakes.add(suspect, np.vstack([columns, nothing]))
    return mistakes.doubt(fit.scatter.deviation.size)


def judge_elastic(
    observations: Observations,
    found: Fitted,
    fit: ElasticFit,
    joints: StiffnessResult,
    fault: Fault | None,
    tried: Columns,
    doubt: Doubt,
) -> Verdict:
    """Judge the chosen model.

    Args:
        observations: of the robot.
        found: fit of the joints alone.
        fit: of the chosen blocks.
        joints: result of the joints alone.
        fault: of the data, that the ladder met.
        tried: columns of the suspects.
        doubt: about the fit, by small mistakes.
    """
    n = joints.n
    motion = fit.columns @ fit.arm.values
    whole = rows_of(observations, motion, fit.columns[..., :n], fit.line, fit.use)
    moved = whole.residual
    left = rows_of(observations, fit.residual, fit.columns[..., :n], fit.line, fit.use).residual
    chi_square = float(left @ left)
    explained = 1.0 - chi_square / max(float((moved + left) @ (moved + left)), 1e-300)
    chance = float(chi2.sf(fit.variance * fit.freedom, fit.freedom))
    findings = _named(fit, tried, float(moved @ moved))
    findings += likely(doubt, {one.suspect for one in findings})
    if fault is not None:
        gain = (
            f"it predicts held-out configurations better than any other model, by {fault.gain:.0%}"
        )
        text = f"{TEXTS[fault.suspect]}; {gain}"
        findings.append(Finding(fault.suspect, text, fault.gain, 0.0, float("inf"), True))
    rms = float(np.sqrt(fit.variance))
    if chance < CERTAIN:
        grave = rms > TOO_LARGE and not any(one.grave for one in findings)
        text = text_of(Suspect.NOISE, rms)
        findings.append(Finding(Suspect.NOISE, text, 0.0, chance, 0.0, grave))
    if fit.scatter.any:
        largest = float(fit.scatter.deviation.max())
        text = text_of(Suspect.CONFIGURATIONS, largest)
        findings.append(Finding(Suspect.CONFIGURATIONS, text, 0.0, 0.0, largest, False))
    alone = float(np.sqrt(found.chi_square / max(found.freedom, 1)))
    if not alone <= FAR_TOO_LARGE and not (rms < TOO_LARGE and explained > MOSTLY):
        findings += wrong_data(observations.samples, observations.robot)
    findings.sort(key=lambda one: (not one.grave, one.probability, -one.improvement))
    grade = Grade.SCATTERED if fit.scatter.any else Grade.GOOD
    if any(one.grave for one in findings):
        grade = Grade.DOUBTFUL if explained > LEAST_EXPLAINED else Grade.HOPELESS
    m = fit.residual.shape[1]
    by_axis = _by_axis(left.reshape(-1, m), moved.reshape(-1, m))
    values = fit.arm.values[:n]
    share = (whole.columns * values).T @ moved / max(float(moved @ moved), 1e-300)
    return Verdict(
        grade=grade,
        chi_square=chi_square,
        degrees_of_freedom=fit.freedom,
        probability=chance,
        explained=explained,
        explained_by_axis=by_axis,
        share_of_joint=share,
        cochran_q=0.0,
        cochran_freedom=0,
        cochran_probability=0.0 if fit.scatter.any else 1.0,
        scatter=fit.scatter.deviation,
        leave_one_out=np.zeros((0, n)),
        findings=tuple(findings),
    )


def _by_axis(residual: FloatArray, motion: FloatArray) -> FloatArray:
    total = np.maximum(np.sum((residual + motion) ** 2, axis=0), 1e-300)
    return np.asarray(1.0 - np.minimum(np.sum(residual**2, axis=0) / total, 1.0))


def _named(fit: ElasticFit, tried: Columns, moved: float) -> list[Finding]:
    """Causes that the residuals still hold, beside all that was chosen."""
    rows = fit.rows
    left, singular, _ = np.linalg.svd(rows.columns, full_matrices=False)
    basis = left[:, singular > 1e-6 * singular[0]]
    rest = rows.residual - basis @ (basis.T @ rows.residual)
    squares, freedom = float(rest @ rest), float(fit.freedom)
    results = []
    for suspect, columns in tried.items():
        length = np.linalg.norm(columns, axis=0)
        own = columns[:, length > 0.0] / length[length > 0.0]
        directions, sizes, _ = np.linalg.svd(own - basis @ (basis.T @ own), full_matrices=False)
        directions = directions[:, sizes > INDEPENDENT]
        count = directions.shape[1]
        if count == 0 or freedom - count < 1.0:
            continue
        gain = float(np.sum((directions.T @ rest) ** 2))
        ratio = gain / count / max((squares - gain) / (freedom - count), 1e-300)
        chance = float(fisher.sf(ratio, count, freedom - count))
        if chance < CERTAIN:
            size = float(np.sqrt(gain / max(moved, 1e-300)))
            share = gain / max(squares, 1e-300)
            text = f"{TEXTS[suspect]}; it moves the tool by {100.0 * size:.1f} % of the deflection"
            results.append(Finding(suspect, text, share, chance, size, size > MATTERS))
    return results
