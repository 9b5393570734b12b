# SPDX-License-Identifier: Apache-2.0
"""Predicted against measured deflection (figure 4.13), and the model chosen on held-out loads."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.errors import CabolsError
from cabols_stiffness.identification.elastic_observations import (
    covariance_of,
    motion_of,
    residual_of,
    settled,
)
from cabols_stiffness.identification.gauss_newton import Fitted, Model, fit
from cabols_stiffness.identification.identify import estimate
from cabols_stiffness.identification.observations import Linearised, Observations, whiten
from cabols_stiffness.measurements.samples import PointSamples, Samples
from cabols_stiffness.model.elastic.prediction import ElasticModel, covariance_at
from cabols_stiffness.model.model_words import CUBIC, LINEAR
from cabols_stiffness.model.prediction import law_of, parameter_covariance
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import logarithm

FOLDS = 5


@dataclass(frozen=True, eq=False)
class Validation:
    """Deflections of samples outside the identification: m numbers for each of k.

    Points: displacements of the reflectors, against the offset and drift of their pass. Poses:
    6-DOF deflections of the tool.

    Attributes:
        measured: (k, m) [m, rad].
        predicted: (k, m) [m, rad].
        band: (k, m) half width of the 95 % band of measured minus predicted: stiffness, wrench and
            tracker [m, rad].
        normalised_rms: of measured minus predicted in its own standard deviations; 1 if all is
            right.
        error_rms: (m,) of measured minus predicted [m, rad].
        explained: share of the measured deflection's sum of squares, weighted, that the prediction
            removes.
    """

    measured: FloatArray
    predicted: FloatArray
    band: FloatArray
    normalised_rms: float
    error_rms: FloatArray
    explained: float


def validate(
    result: StiffnessResult, samples: PointSamples | Samples, robot: RobotModel
) -> Validation:
    """Compare a result's prediction with measurements, best of loads not used to identify.

    Args:
        result: of an identification.
        samples: measured, best of loads not used to identify.
        robot: with the tool that they are of.

    Raises:
        CabolsError: if there is no sample.
    """
    if len(samples) == 0:
        raise CabolsError("samples: expected one or more to validate with, got none")
    observations = Observations(samples, robot)
    line = observations.linearise(law_of(result))
    if result.elastic is not None:
        line, moved = _of_elastic_arm(result.elastic, observations, line)
        total = line.covariance
    else:
        spread = parameter_covariance(result, line.balance)
        total = line.covariance + line.motion @ spread @ line.motion.swapaxes(1, 2)
        line = replace(line, covariance=total)
        moved = np.einsum("kij,kj->ki", line.motion, line.balance.deflection)
    root = np.linalg.cholesky(total)
    rows = whiten(line, moved[..., None], samples, np.ones(len(samples)))
    residual = np.einsum("kij,kj->ki", root, rows.residual)
    column = rows.columns.squeeze(axis=-1)
    predicted = np.einsum("kij,kj->ki", root, column)
    freedom = max(rows.residual.size - rows.shared, 1)
    explained = 1.0 - np.sum(rows.residual**2) / np.sum((rows.residual + column) ** 2)
    return Validation(
        measured=predicted + residual,
        predicted=predicted,
        band=norm.ppf(0.975) * np.sqrt(np.einsum("kii->ki", total)),
        normalised_rms=float(np.sqrt(np.sum(rows.residual**2) / freedom)),
        error_rms=np.asarray(np.sqrt(np.mean(residual**2, axis=0))),
        explained=float(explained),
    )


def _of_elastic_arm(
    elastic: ElasticModel, observations: Observations, line: Linearised
) -> tuple[Linearised, FloatArray]:
    """Residuals and covariances by all that gives way, and (k, m) what it moves."""
    model = elastic.with_tool_of(observations.robot)
    mine = Observations(observations.samples, model.robot)
    state = settled(mine, model.arm)
    motion, posture = motion_of(mine, state), state.frames.posture
    spread = covariance_at(model, state)
    total = covariance_of(mine, model.arm, state) + motion @ spread @ motion.swapaxes(1, 2)
    before = model.robot.posture(mine.samples.joints)
    turned = logarithm(posture.rotation @ before.rotation.swapaxes(1, 2))
    twist = np.concatenate([posture.position - before.position, turned], axis=1)
    residual = residual_of(mine, model.arm, state)
    return (
        replace(line, residual=residual, covariance=total),
        np.einsum("kij,kj->ki", motion, twist),
    )


@dataclass(frozen=True, eq=False)
class ModelChoice:
    """Linear or cubic, by loads that were held out.

    Attributes:
        model: the better one; linear unless cubic is better beyond doubt.
        results: of each model, from all samples.
        held_out_rms: of each model, error of held-out loads in the measurement's own standard
            deviations.
        held_out_error: of each model, root mean square error of held-out loads [m] (of poses: of
            their translation).
        gain: mean improvement of the squared normalised error by the cubic model.
        gain_deviation: its standard deviation, over the loads.
    """

    model: str
    results: dict[str, StiffnessResult]
    held_out_rms: dict[str, float]
    held_out_error: dict[str, float]
    gain: float
    gain_deviation: float


def choose_model(samples: PointSamples | Samples, robot: RobotModel) -> ModelChoice:
    """Fit both models to four fifths of the loads and predict the rest, in turn.

    A load is held out at all reflectors and on both branches' samples of its number; outliers of
    the whole fit count nowhere. Cubic is chosen if it predicts better by more than two standard
    deviations of the improvement.

    Args:
        samples: to fit and to predict.
        robot: with the tool that they are of.

    Raises:
        IdentificationError: if there are too few samples.
    """
    folds = _folds(samples)
    results, scores, errors = {}, {}, {}
    use = np.ones(len(samples), dtype=np.bool_)
    for model in (LINEAR, CUBIC):
        observations = Observations(samples, robot)
        found, wanted, results[model] = estimate(observations, model)
        use &= found.use
        scores[model], errors[model] = _held_out(observations, wanted, found, folds)
    gain = (scores[LINEAR] - scores[CUBIC])[use]
    mean, deviation = float(gain.mean()), float(gain.std() / np.sqrt(max(gain.size - 1, 1)))
    size = 3 if isinstance(samples, PointSamples) else 6
    return ModelChoice(
        CUBIC if mean > 2.0 * deviation else LINEAR,
        results,
        {name: float(np.sqrt(score[use].mean() / size)) for name, score in scores.items()},
        {name: float(np.sqrt(error[use].mean())) for name, error in errors.items()},
        mean,
        deviation,
    )


def _folds(samples: PointSamples | Samples) -> FloatArray:
    """(k,) fold of each sample; all samples of a load of a configuration are in the same one."""
    keys = np.column_stack([samples.configuration, samples.load])
    _, load = np.unique(keys, axis=0, return_inverse=True)
    order = np.random.default_rng(0).permutation(int(load.max(initial=0)) + 1)
    return np.asarray(order[load.ravel()] % FOLDS)


def _held_out(
    observations: Observations, model: Model, found: Fitted, folds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(k,) squared normalised errors, and (k,) squared distances [m^2], of samples left out."""
    scores, errors = np.zeros(folds.size), np.zeros(folds.size)
    for fold in range(FOLDS):
        out = folds == fold
        train = found.use & ~out
        part = fit(observations, model, found.parameters, robust=False, use=train)
        scores[out] = part.distances[out]
        errors[out] = _squares(part.line, observations, train)[out]
    return scores, errors


def _squares(line: Linearised, observations: Observations, use: BoolArray) -> FloatArray:
    rows = whiten(line, line.motion[..., :0], observations.samples, use.astype(np.float64))
    residual = np.einsum("kij,kj->ki", np.linalg.cholesky(line.covariance), rows.residual)
    return np.asarray(np.sum(residual[:, :3] ** 2, axis=1))
