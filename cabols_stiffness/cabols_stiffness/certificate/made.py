# SPDX-License-Identifier: Apache-2.0
"""A certificate from samples, their result and a statement."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.naming import number
from cabols_stiffness.certificate.budget import budget
from cabols_stiffness.certificate.compliance import measured_compliance
from cabols_stiffness.certificate.document import Certificate
from cabols_stiffness.certificate.statement import Statement
from cabols_stiffness.identification.gauss_newton import IdentificationError
from cabols_stiffness.identification.identify import identify
from cabols_stiffness.identification.validation import validate
from cabols_stiffness.measurements.samples import PointSamples, Samples, select
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel


def certificate_of(
    result: StiffnessResult,
    samples: PointSamples | Samples,
    robot: RobotModel,
    statement: Statement,
    left_out: Sequence[str] = (),
) -> Certificate:
    """Put together what a certificate shows.

    Args:
        result: of an identification of the samples.
        samples: that it is from.
        robot: with its tool.
        statement: who, where, with what.
        left_out: what was not used before the samples were made, and why; sentences.
    """
    checked = validate(result, samples, robot)
    normalised = 1.96 * (checked.measured - checked.predicted) / checked.band
    largest = np.abs(normalised).argmax(axis=1)
    wrench = samples.wrench
    posture = robot.posture(samples.joints)
    if isinstance(samples, PointSamples):
        both = np.zeros((len(samples), 6, 6))
        both[:, :3, :3] = both[:, 3:, 3:] = posture.rotation
        wrench = np.einsum("kij,kj->ki", both, wrench)
    return Certificate(
        statement=statement,
        robot=robot,
        result=result,
        budget=budget(result, samples, robot, statement.sources),
        compliance=measured_compliance(result, samples, robot),
        left_out=[*left_out, *_left_out(result, samples)],
        residual=normalised[np.arange(len(samples)), largest],
        load=samples.load.astype(np.float64),
        configuration=samples.configuration.astype(np.float64),
        torque=posture.torque(wrench),
        singles=_singles(samples, robot),
    )


def _left_out(result: StiffnessResult, samples: PointSamples | Samples) -> list[str]:
    """Sentences about samples that were given and not used."""
    said = [
        f"load {number(int(samples.load[row]))} of configuration "
        f"{number(int(samples.configuration[row]))}: outlier, it does not fit the others"
        for row in result.outliers
    ]
    verdict = result.verdict
    if verdict is not None and verdict.missing:
        said.append(f"{verdict.missing} rows: no number was measured")
    if verdict is not None and verdict.repeated:
        said.append(f"{verdict.repeated} rows: they repeat an earlier one, number for number")
    return said


def _alone(samples: PointSamples | Samples, here: BoolArray, robot: RobotModel) -> StiffnessResult:
    # One branch for each kind of table, which `select` keeps.
    if isinstance(samples, PointSamples):
        return identify(select(samples, here), robot, judged=False, hysteresis=False)
    return identify(select(samples, here), robot, judged=False, hysteresis=False)


def _singles(samples: PointSamples | Samples, robot: RobotModel) -> FloatArray:
    """(c, n, 3) stiffness and interval from each configuration alone; NaN where it shows none."""
    found = []
    for configuration in np.unique(samples.configuration):
        here = samples.configuration == configuration
        try:
            one = _alone(samples, here, robot)
        except IdentificationError:
            found.append(np.full((robot.n, 3), np.nan))
            continue
        found.append(np.column_stack([one.stiffness, one.interval]))
    return np.array(found)
