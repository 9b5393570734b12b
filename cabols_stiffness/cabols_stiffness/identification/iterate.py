# SPDX-License-Identifier: Apache-2.0
"""Stiffness from measured loads: frames, corrections for the deflection, identification."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_stiffness.identification.identify import identify
from cabols_stiffness.measurements.deflected_arm import without_tool_weight
from cabols_stiffness.measurements.measured_load import MeasuredLoad
from cabols_stiffness.measurements.measuring_rig import MeasuringRig
from cabols_stiffness.measurements.reflector_points import Frames, frames_of, to_points
from cabols_stiffness.measurements.samples import PointSamples
from cabols_stiffness.model.model_words import LINEAR
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel

STANDARD_GRAVITY = 9.80665
PASSES = 5
SETTLED = 1e-9
"""Relative change of the parameters from pass to pass that ends them. What a pass corrects is a
thousandth of the stiffness, so each comes a thousand times nearer."""


@dataclass(frozen=True, eq=False)
class LoadsResult:
    """Result of identifying loads.

    Attributes:
        result: of the last pass.
        frames: of tracker and reflectors.
        samples: that it was identified from.
    """

    result: StiffnessResult
    frames: Frames
    samples: PointSamples


def corrected(
    loads: Sequence[MeasuredLoad],
    frames: Frames,
    rig: MeasuringRig,
    robot: RobotModel,
    parameters: FloatArray | None,
) -> PointSamples:
    """Loads as samples, the tool's weight taken off in its true orientation.

    Args:
        loads: one or more.
        frames: of tracker and reflectors.
        rig: with the tool's mass.
        robot: with the platform as its tool.
        parameters: (12,) of a first result; None: none yet, the samples stay as they are.
    """
    samples = to_points(loads, frames)
    if parameters is None or not rig.tool_mass > 0.0:
        return samples
    weight = STANDARD_GRAVITY * rig.tool_mass
    return without_tool_weight(samples, robot, parameters, weight, rig.tool_centre_of_mass)


def identify_loads(
    loads: Sequence[MeasuredLoad],
    rig: MeasuringRig,
    robot: RobotModel,
    model: str = LINEAR,
    start: StiffnessResult | None = None,
) -> LoadsResult:
    """Identify in passes; each corrects the data by the result of the one before.

    Args:
        loads: one or more.
        rig: nominal values.
        robot: with the platform as its tool.
        model: as for identify.
        start: an earlier result; it saves passes only.

    Raises:
        IdentificationError: if there are too few loads.
    """
    result = start
    for _ in range(PASSES):
        parameters = None if result is None else result.parameters
        frames = frames_of(loads, rig, robot, parameters)
        samples = corrected(loads, frames, rig, robot, parameters)
        before = parameters
        result = identify(samples, robot, model, start=result, judged=False)
        if before is not None and np.allclose(result.parameters, before, rtol=SETTLED, atol=0.0):
            break
    assert result is not None
    return LoadsResult(identify(samples, robot, model, start=result), frames, samples)
