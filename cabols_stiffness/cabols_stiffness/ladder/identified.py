# SPDX-License-Identifier: Apache-2.0
"""Joint stiffness and an elastic arm from samples, by the ladder of models: `identify_ladder`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_stiffness.identification.gauss_newton import fit as refit
from cabols_stiffness.identification.identify import (
    CONFIDENCE,
    WORST_RELATIVE,
    estimate,
    origin_of,
)
from cabols_stiffness.identification.observations import Observations
from cabols_stiffness.ladder.choose import Choice, Ladder
from cabols_stiffness.ladder.fit import ElasticFit, fit_choice
from cabols_stiffness.ladder.judgement import judge_elastic, small_mistakes, suspects_of
from cabols_stiffness.ladder.kinematics import Calibration, calibrate
from cabols_stiffness.measurements.samples import PointSamples, Samples
from cabols_stiffness.measurements.usable import usable_rows
from cabols_stiffness.model.elastic.blocks import Friction
from cabols_stiffness.model.elastic.prediction import ElasticModel
from cabols_stiffness.model.model_words import AUTO, LINEAR, Rung, rungs_of
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel

COMBINATIONS_WORST = 0.1
"""Relative deviation up to which a combination of compliances is reported."""


@dataclass(frozen=True, eq=False)
class Combination:
    """A combination of compliances that the data determine where single ones are not.

    Attributes:
        share: (n,) of each joint's relative compliance; unit length.
        deviation: standard deviation of the combination.
    """

    share: FloatArray
    deviation: float


@dataclass(frozen=True, eq=False)
class Identified:
    """What the ladder found.

    Attributes:
        calibration: of the robot's kinematics from the unloaded references; None: they say nothing.
        result: of the joints, with the elastic arm; a joint's compliance holds all that gives way
            about its axis.
        choice: which rungs, and why.
        fit: of them.
        lower_bound: (n,) stiffness that each joint has at least, one-sided at 95 % [N m/rad].
        combinations: that are known where single compliances are not.
        elastic: the identified arm.
    """

    result: StiffnessResult
    choice: Choice
    fit: ElasticFit
    lower_bound: FloatArray
    combinations: tuple[Combination, ...]
    elastic: ElasticModel
    calibration: Calibration | None


def identify_ladder(
    samples: PointSamples | Samples, robot: RobotModel, model: str = AUTO
) -> Identified:
    """Identify the joints' stiffness and whatever else gives way.

    Args:
        samples: of all configurations; of different loads at each, or of six directions and more:
            what is held out says nothing of loads that are the same everywhere.
        robot: with the tool that they are about.
        model: "auto", or rungs joined by "+".

    Raises:
        CabolsError: if the model is unknown.
        IdentificationError: if there are too few samples or too many outliers.
    """
    rungs = rungs_of(model)
    if robot.coupling is not None:
        raise CabolsError(
            "model: expected linear or cubic for a robot whose coupling is known, got the ladder; "
            "leave the coupling out and let the ladder find it (joints+coupling)"
        )
    usable = usable_rows(samples)
    observations = Observations(usable.samples, robot)
    found, model_alone, joints = estimate(observations, LINEAR, hysteresis=False)
    ladder = Ladder(observations, found)
    choice = ladder.climb() if rungs is None else ladder.only(rungs)
    fit = fit_choice(observations, found, choice)
    calibration = None
    if rungs is None or Rung.KINEMATICS in rungs:
        calibration = calibrate(observations, fit)
    if calibration is not None and calibration.taken:
        observations = Observations(calibration.samples, calibration.robot)
        found = refit(observations, model_alone, found.parameters, robust=False, use=found.use)
        fit = fit_choice(observations, found, choice, fit)
    tried = suspects_of(observations, found, fit)
    doubt = small_mistakes(fit, tried)
    fit = replace(fit, covariance=fit.covariance + doubt.covariance)
    elastic = ElasticModel(observations.robot, fit.arm, fit.covariance, fit.scatter.deviation)
    verdict = judge_elastic(observations, found, fit, joints, choice.fault, tried, doubt)
    verdict = replace(verdict, missing=usable.missing, repeated=usable.repeated)
    compliance = fit.arm.values[: robot.n] * ladder.scale
    relative = _relative(fit, robot.n)
    return Identified(
        result=replace(
            _joint_result(joints, fit, ladder.scale),
            samples=len(samples),
            outliers=usable.rows[~fit.use],
            verdict=verdict,
            origin=origin_of(usable.samples, robot),
            elastic=elastic,
        ),
        choice=choice,
        fit=fit,
        lower_bound=1.0 / (compliance * (1.0 + student.ppf(0.95, fit.scatter.freedom) * relative)),
        combinations=_combinations(fit, robot.n),
        elastic=elastic,
        calibration=calibration,
    )


def _relative(fit: ElasticFit, n: int) -> FloatArray:
    """(n,) standard deviation of each joint's compliance, relative to it."""
    return np.asarray(np.sqrt(np.diagonal(fit.covariance)[:n]) / np.abs(fit.arm.values[:n]))


def _joint_result(joints: StiffnessResult, fit: ElasticFit, scale: FloatArray) -> StiffnessResult:
    n, values = scale.size, fit.arm.values
    compliance = np.maximum(values[:n], 1e-3) * scale
    stiffness, relative = 1.0 / compliance, _relative(fit, n)
    identifiable = (relative <= WORST_RELATIVE) & (values[:n] > 0.0)
    half = student.ppf(0.5 + 0.5 * CONFIDENCE, fit.scatter.freedom) * relative
    ends = np.column_stack([1.0 / (1.0 + half), 1.0 / np.maximum(1.0 - half, 1e-9)])
    to_physical = -stiffness / np.abs(values[:n])
    physical = fit.covariance[:n, :n] * np.outer(to_physical, to_physical)
    known = np.outer(identifiable, identifiable)
    own = np.diag((fit.scatter.deviation * stiffness) ** 2)
    whole = np.zeros((2 * n, 2 * n))
    whole[:n, :n] = physical + own
    friction, deviation, reach = np.zeros(n), np.zeros(n), np.zeros(n)
    block = fit.arm.friction
    if isinstance(block, Friction):
        at = fit.arm.slices[fit.arm.blocks.index(block)]
        size = block.scale[block.joint] * stiffness[block.joint]
        friction[block.joint] = values[at] * size
        deviation[block.joint] = np.sqrt(np.diagonal(fit.covariance)[at]) * size
        reach[block.joint] = block.travel[block.joint]
    return replace(
        joints,
        stiffness=np.where(identifiable, stiffness, np.nan),
        covariance=np.where(known, physical, np.nan),
        identifiable=identifiable,
        interval=np.where(identifiable[:, None], stiffness[:, None] * ends, np.nan),
        residual_rms=float(np.sqrt(fit.variance)),
        degrees_of_freedom=fit.freedom,
        iterations=fit.steps,
        converged=fit.converged,
        parameters=np.concatenate([stiffness, np.zeros(n)]),
        parameter_covariance=whole,
        joint_range=np.abs(fit.state.deflection[fit.use]).max(axis=0, initial=0.0),
        friction=friction,
        friction_deviation=deviation,
        friction_reach=reach,
    )


def _combinations(fit: ElasticFit, n: int) -> tuple[Combination, ...]:
    """Directions of small deviation among joints whose own compliances are not identified."""
    unknown = np.flatnonzero(~(_relative(fit, n) <= WORST_RELATIVE))
    if unknown.size < 2:
        return ()
    relative = fit.covariance[np.ix_(unknown, unknown)]
    values, vectors = np.linalg.eigh(relative)
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        deviation = float(np.sqrt(max(value, 0.0)))
        if deviation <= COMBINATIONS_WORST:
            share = np.zeros(n)
            share[unknown] = vector * np.sign(vector[np.abs(vector).argmax()])
            found.append(Combination(share, deviation))
    return tuple(found)
