# SPDX-License-Identifier: Apache-2.0
"""Study of a campaign's loads: pooled stiffness, stiffness by configuration, validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_stiffness.campaign.plan import CampaignPlan
from cabols_stiffness.errors import CampaignError
from cabols_stiffness.identification.gauss_newton import IdentificationError
from cabols_stiffness.identification.identify import identify
from cabols_stiffness.identification.iterate import corrected, identify_loads
from cabols_stiffness.identification.validation import (
    ModelChoice,
    Validation,
    choose_model,
    validate,
)
from cabols_stiffness.ladder.identified import Identified, identify_ladder
from cabols_stiffness.measurements.measured_load import MeasuredLoad
from cabols_stiffness.measurements.poses import poses
from cabols_stiffness.measurements.reflector_points import Frames, robot_of
from cabols_stiffness.measurements.samples import PointSamples, Samples, select
from cabols_stiffness.model.model_words import LINEAR, MODELS
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel


@dataclass(frozen=True, eq=False)
class Study:
    """Everything that an analysis finds.

    Attributes:
        plan: of the campaign.
        loads: that it is from.
        robot: with the platform as its tool.
        frames: of tracker and reflectors.
        samples: for the identification.
        result: from all of them.
        by_configuration: configuration and (6,) stiffness [N m/rad], NaN where it cannot be
            identified, as the columns of table 4.3.
        climbed: what the ladder of models found; None: it was not asked for.
        choice: between the linear and the cubic model by held-out loads; None: too few loads.
        held_back: samples of the validation; None: none were measured.
        point_validation: their reflectors' displacements, predicted and measured; None likewise.
        pose_samples: 6-DOF deflections of the validation's loads, as figure 4.13; None likewise.
        pose_validation: predicted and measured, of those.
    """

    plan: CampaignPlan
    loads: list[MeasuredLoad]
    robot: RobotModel
    frames: Frames
    samples: PointSamples
    result: StiffnessResult
    by_configuration: list[tuple[int, FloatArray]]
    climbed: Identified | None
    choice: ModelChoice | None
    held_back: PointSamples | None
    point_validation: Validation | None
    pose_samples: Samples | None
    pose_validation: Validation | None


def study(loads: Sequence[MeasuredLoad], plan: CampaignPlan, model: str = "") -> Study:
    """Identify and validate.

    Args:
        loads: finished, of all runs.
        plan: of the campaign; its validation configurations are held back.
        model: linear, cubic or as_published; auto, or rungs of the ladder joined by +; empty: the
            plan's.

    Raises:
        CampaignError: if there is no load to identify from.
        IdentificationError: if they are too few.
    """
    robot = robot_of(plan.rig)
    mine = [load for load in loads if not plan.is_validation(load.configuration)]
    if not mine:
        raise CampaignError("loads: expected some that are not for validation, got none")
    wanted = model or plan.model
    pooled = identify_loads(mine, plan.rig, robot, wanted if wanted in MODELS else LINEAR)
    result, frames, samples = pooled.result, pooled.frames, pooled.samples
    climbed = None
    if wanted not in MODELS:
        climbed = identify_ladder(samples, robot, wanted)
        result = climbed.result
    others = [load for load in loads if plan.is_validation(load.configuration)]
    held_back = None
    if others:
        held_back = corrected(others, frames, plan.rig, robot, result.parameters)
    deflections = _poses(held_back, robot)
    return Study(
        plan=plan,
        loads=list(loads),
        robot=robot,
        frames=frames,
        samples=samples,
        result=result,
        by_configuration=_by_configuration(samples, robot, plan),
        climbed=climbed,
        choice=_choice(samples, robot),
        held_back=held_back,
        point_validation=validate(result, held_back, robot) if held_back is not None else None,
        pose_samples=deflections,
        pose_validation=validate(result, deflections, robot) if deflections is not None else None,
    )


def _by_configuration(
    samples: PointSamples, robot: RobotModel, plan: CampaignPlan
) -> list[tuple[int, FloatArray]]:
    found = []
    for configuration in plan.configurations:
        here = samples.configuration == configuration
        if not here.any():
            continue
        try:
            stiffness = identify(select(samples, here), robot).stiffness
        except IdentificationError:
            stiffness = np.full(6, np.nan)
        found.append((configuration, stiffness))
    return found


def _choice(samples: PointSamples, robot: RobotModel) -> ModelChoice | None:
    try:
        return choose_model(samples, robot)
    except IdentificationError:
        return None


def _poses(held_back: PointSamples | None, robot: RobotModel) -> Samples | None:
    """6-DOF deflections, where each load was seen at three reflectors between references."""
    if held_back is None:
        return None
    try:
        return poses(held_back, robot)
    except CabolsError:
        return None
