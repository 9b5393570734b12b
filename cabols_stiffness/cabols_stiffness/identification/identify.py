# SPDX-License-Identifier: Apache-2.0
"""Joint stiffness from samples: `identify`.

Which errors are handled how. In the source's regression (4.17) the regressor is the measured
deflection, so the tracker's noise sits in the matrix and pulls every stiffness down, the more the
less a joint deflects (attenuation; joint 1 deflects by a few times the noise). Here the measured
wrench is the regressor and the deflection the response. That is the errors-in-variables model with
both errors kept: the maximum likelihood over the true wrenches, profiled to first order, weights
the residual by C_m + G C_w G^T (see observations.py). The first order suffices because the wrench
is known to about one part in ten thousand; a test compares with the full problem, true wrenches
and all, solved by scipy. Total least squares on (4.17) would need the ratio of the two noises to
be the same for all rows; instruments would discard the information of the wrench's covariance.

Intervals are Student's t on the compliance with the noise's size taken from the residuals, not
from the stated covariances alone: they stay honest when tracker or sensor do worse than they say.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import t as student

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.errors import CabolsError
from cabols_stiffness.identification.adequacy.judge import judge, wrong_magnitude
from cabols_stiffness.identification.adequacy.normal import LEAST_MEAN, RandomEffects
from cabols_stiffness.identification.adequacy.span import wrong_span
from cabols_stiffness.identification.adequacy.wrong_data import wrong_data
from cabols_stiffness.identification.friction_doubt import with_doubt
from cabols_stiffness.identification.gauss_newton import (
    Fitted,
    IdentificationError,
    Model,
    OutliersError,
    Parameters,
    fit,
)
from cabols_stiffness.identification.hysteresis import FINER, TRAVELS, detect, has_branches
from cabols_stiffness.identification.observations import (
    DRIFT_SAMPLES,
    Observations,
    start_stiffness,
)
from cabols_stiffness.identification.outliers import fit_without_outliers
from cabols_stiffness.measurements.samples import PointSamples, Samples
from cabols_stiffness.measurements.usable import usable_rows
from cabols_stiffness.model.model_words import AS_PUBLISHED, LINEAR, MODELS
from cabols_stiffness.model.result import Origin, StiffnessResult
from cabols_stiffness.model.robot import RobotModel

WORST_RELATIVE = 0.2
"""Relative standard deviation of a joint's stiffness above which it is not identified."""

WORST_CUBIC = 0.1
"""Standard deviation of the cubic torque at the joint's largest deflection, relative to the linear
torque there, above which the cubic term is not identified."""

CONFIDENCE = 0.95

UNFITTED = (
    "samples: expected motions that a robot's joints can make under these wrenches, got such that "
    "no stiffness can be fitted; check the units of position, force and torque"
)

BELOW = (
    ". Numbers whose stated deviation is far beyond the motion do not count: if they were "
    "measured, check the unit of the motion and the stated deviations"
)

FRICTION_ROUNDS = 6
"""Most rounds of detecting friction and fitting again."""


def identify(
    samples: PointSamples | Samples,
    robot: RobotModel,
    model: str = LINEAR,
    *,
    start: StiffnessResult | None = None,
    robust: bool = True,
    hysteresis: bool = True,
    judged: bool = True,
) -> StiffnessResult:
    """Joint stiffness with its uncertainty from measured motions under measured wrenches.

    Args:
        samples: of one configuration, or of all pooled.
        robot: with the tool that the samples are about.
        model: "linear" and "cubic": exact balance J(q + d)^T w = A d^3 + B d, A zero or not;
            "as_published": (4.15), for comparison; its cubic term is about a third of the true one.
        start: an earlier result to begin from; None: a linear solution. It saves time only.
        robust: whether to look for outliers.
        hysteresis: whether to look for friction where there is an unloading branch; what is found
            is estimated with the stiffness, so that it does not bend the elastic curve. Never
            "as_published", which ignores it.
        judged: whether to judge the model; False saves time, and leaves out the random effects.

    Returns:
        The result; NaN for what the data cannot identify. Its `verdict` says whether the model
        explains the data, and where configurations differ, intervals and covariances hold that.

    Raises:
        CabolsError: if the model is unknown.
        IdentificationError: if there are too few samples or too many outliers.
    """
    usable = usable_rows(samples)
    observations = Observations(usable.samples, robot)
    try:
        found, estimated, result = estimate(
            observations, model, start=start, robust=robust, hysteresis=hysteresis
        )
    except OutliersError as error:
        raise OutliersError("; ".join([str(error), *_causes(observations)])) from error
    except np.linalg.LinAlgError as error:
        raise IdentificationError("; ".join([UNFITTED, *_causes(observations)])) from error
    if model != AS_PUBLISHED and judged:
        opinion = judge(observations, found, estimated, result.friction_reach)
        verdict = replace(opinion.verdict, missing=usable.missing, repeated=usable.repeated)
        result = summarise(found, model, result.friction_reach, opinion.between, opinion.doubt)
        result = replace(result, verdict=verdict)
    return replace(
        result,
        samples=len(samples),
        outliers=usable.rows[result.outliers],
        origin=origin_of(usable.samples, robot),
    )


def _causes(observations: Observations) -> list[str]:
    """What may be wrong with data that no fit explains, for people."""
    samples, robot = observations.samples, observations.robot
    found = [*wrong_span(samples, robot), *wrong_data(samples, robot)]
    found += wrong_magnitude(start_stiffness(observations))
    return [one.text for one in found]


def origin_of(samples: PointSamples | Samples, robot: RobotModel) -> Origin:
    """Robot and range of the data.

    Args:
        samples: that were used.
        robot: that they are of.
    """
    ends = [samples.joints.min(axis=0), samples.joints.max(axis=0)]
    return Origin(
        robot=robot.name,
        joint_names=robot.joint_names,
        kinematics=robot.kinematics,
        joints=np.column_stack(ends),
        wrench=np.abs(samples.wrench).max(axis=0),
    )


def estimate(
    observations: Observations,
    model: str,
    *,
    start: StiffnessResult | None = None,
    robust: bool = True,
    hysteresis: bool = True,
) -> tuple[Fitted, Model, StiffnessResult]:
    """Do as identify; return also the fit and the estimated model.

    Args:
        observations: of one campaign.
        model: as identify.
        start: as identify.
        robust: as identify.
        hysteresis: as identify.
    """
    if model not in MODELS:
        raise CabolsError(f"model: expected one of {', '.join(MODELS)}, got {model!r}")
    samples = observations.samples
    _check_count(observations, model)
    begin = _start(observations, model, start)
    nothing = np.zeros(observations.robot.n, dtype=np.bool_)
    estimated = Model(model != LINEAR, model == AS_PUBLISHED, None, nothing)
    if robust and model != AS_PUBLISHED:
        found = fit_without_outliers(observations, estimated, begin)
    else:
        found = fit(observations, estimated, begin, robust)
    travel = np.zeros(observations.robot.n)
    if hysteresis and model != AS_PUBLISHED and has_branches(samples):
        found, estimated, travel = _with_friction(observations, estimated, found, robust)
        found = with_doubt(observations, found, estimated)
    return found, estimated, summarise(found, model, travel)


def _start(observations: Observations, model: str, start: StiffnessResult | None) -> Parameters:
    n = observations.robot.n
    nothing = np.zeros(n)
    if start is None:
        return Parameters(1.0 / start_stiffness(observations), nothing, nothing)
    cubic = start.parameters[n:].copy() if start.model == model else nothing
    return Parameters(1.0 / start.parameters[:n], cubic, nothing)


def _with_friction(
    observations: Observations, model: Model, found: Fitted, robust: bool
) -> tuple[Fitted, Model, FloatArray]:
    n = observations.robot.n
    travel, travels = np.zeros(n), np.repeat(TRAVELS, n, axis=1)
    for _ in range(FRICTION_ROUNDS):
        before = travel
        candidate, model = detect(observations, found, model, travels)
        travel = np.where(model.has_friction, candidate, 0.0)
        if model.friction_state is None and not before.any():
            break
        friction = np.where(model.has_friction, found.parameters.friction, 0.0)
        # Samples left out so far may only have lacked friction: they are judged again at the end.
        begin = replace(found.parameters, friction=friction)
        found = fit(observations, model, begin, robust=False, use=found.use)
        if np.allclose(travel, before, rtol=0.01, atol=0.0):
            break
        # Joints without friction so far may show it once the others' friction is known.
        coarse = TRAVELS[np.linspace(0, len(TRAVELS) - 1, FINER.size).astype(int)]
        travels = np.where(travel > 0.0, FINER[:, None] * travel, coarse)
    if robust and travel.any():
        found = fit(observations, model, found.parameters, use=found.use)
    return found, model, travel


def _check_count(observations: Observations, model: str) -> None:
    samples, k = observations.samples, len(observations.samples)
    numbers = int(observations.numbers.sum())
    axes = int(observations.numbers.max(initial=0))
    value = samples.position if isinstance(samples, PointSamples) else samples.deflection
    measured = int(np.isfinite(value).sum())
    n = observations.robot.n
    unknowns = n if model == LINEAR else 2 * n
    if isinstance(samples, PointSamples):
        sizes = np.unique(samples.group, return_counts=True)[1]
        unknowns += int(np.where(sizes >= DRIFT_SAMPLES, 2 * axes, axes).sum())
        what = f"{sizes.size} groups' offsets and drifts and the joints"
    else:
        what = "the joints"
    if not numbers > unknowns:
        raise IdentificationError(
            f"samples: expected more than {unknowns} measured numbers for as many unknowns "
            f"({what}), got {numbers} from {k} samples; measure more loads"
            + (BELOW if numbers < measured else "")
        )


def summarise(
    found: Fitted,
    model: str,
    travel: FloatArray,
    between: RandomEffects | None = None,
    mistakes: FloatArray | None = None,
) -> StiffnessResult:
    """Summarise a fit: stiffness and cubic terms, covariances, intervals, identifiability.

    Args:
        found: the fit.
        model: linear, cubic or as_published.
        travel: (n,) reach of the joints' friction [rad].
        between: how configurations that differ are pooled; None: they do not differ.
        mistakes: (p, p) covariance of the fitted parameters by small mistakes; None: none.
    """
    n, freedom = travel.size, max(found.freedom, 1)
    variance = found.chi_square / freedom
    parameters, width = found.parameters, student.ppf(0.5 + 0.5 * CONFIDENCE, freedom)
    normalised, scatter = variance * found.covariance, np.zeros(n)
    if between is not None:
        estimated = np.flatnonzero(np.diagonal(found.covariance) > 0.0)
        normalised = normalised.copy()
        normalised[np.ix_(estimated, estimated)] = between.covariance
        change = np.maximum(between.change[:n], LEAST_MEAN - 1.0)
        parameters = replace(parameters, compliance=parameters.compliance * (1.0 + change))
        width, scatter = student.ppf(0.5 + 0.5 * CONFIDENCE, between.freedom), between.scatter
    if found.doubt is not None:
        normalised = normalised + variance * found.doubt
    if mistakes is not None:
        estimated = np.flatnonzero(np.diagonal(found.covariance) > 0.0)
        scale = np.ones(found.scale.size)
        scale[:n] = parameters.compliance / found.parameters.compliance
        normalised = normalised.copy()
        part = mistakes / np.outer(scale[estimated], scale[estimated])
        normalised[np.ix_(estimated, estimated)] += part
    relative = np.sqrt(np.diagonal(normalised))
    with_cubic = model != LINEAR
    identifiable = ~found.unidentifiable[:n] & (relative[:n] <= WORST_RELATIVE)
    cubic_known = ~found.unidentifiable[n : 2 * n] & (relative[n : 2 * n] <= WORST_CUBIC)
    cubic_known &= with_cubic

    stiffness = 1.0 / parameters.compliance
    # From (c, a) in units of `scale` to (b, a): db = -b^2 dc, and the scale of c is c itself.
    to_physical = np.concatenate([-stiffness, found.scale[n : 2 * n]])
    physical = normalised[: 2 * n, : 2 * n] * np.outer(to_physical, to_physical)
    # A prediction is about one configuration: it has the scatter between them beside the mean's.
    own = np.diag(np.concatenate([scatter * stiffness, np.zeros(n)]) ** 2)
    known = np.concatenate([identifiable, cubic_known])
    shown = np.where(np.outer(known, known), physical, np.nan)

    half = width * relative[:n]
    ends = np.column_stack([1.0 / (1.0 + half), 1.0 / np.maximum(1.0 - half, 1e-9)])
    interval = np.where(identifiable[:, None], stiffness[:, None] * ends, np.nan)
    cubic_interval = None
    if with_cubic:
        half = np.max(width) * np.sqrt(np.diagonal(physical)[n:])
        around = parameters.cubic[:, None] + half[:, None] * np.array([-1.0, 1.0])
        cubic_interval = np.where(cubic_known[:, None], around, np.nan)
    return StiffnessResult(
        model=model,
        stiffness=np.where(identifiable, stiffness, np.nan),
        cubic=np.where(cubic_known, parameters.cubic, np.nan) if with_cubic else None,
        covariance=shown if with_cubic else shown[:n, :n],
        identifiable=identifiable,
        cubic_identifiable=cubic_known,
        interval=interval,
        cubic_interval=cubic_interval,
        residual_rms=float(np.sqrt(variance)),
        degrees_of_freedom=found.freedom,
        samples=int(found.use.size),
        outliers=np.flatnonzero(~found.use),
        iterations=found.iterations,
        converged=found.converged,
        parameters=np.concatenate([stiffness, parameters.cubic]),
        parameter_covariance=physical + own,
        joint_range=_range(found.deflection, found.use),
        friction=np.where(travel > 0.0, parameters.friction, 0.0),
        friction_deviation=relative[2 * n :] * found.scale[2 * n :],
        friction_reach=travel,
    )


def _range(deflection: FloatArray, use: BoolArray) -> FloatArray:
    return np.asarray(np.abs(deflection[use]).max(axis=0, initial=0.0))
