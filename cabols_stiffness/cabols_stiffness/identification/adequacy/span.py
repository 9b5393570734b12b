# SPDX-License-Identifier: Apache-2.0
"""Whether the unloaded robot's positions span what its kinematics say: a unit that hides.

Positions in another unit than stated fit as well as in the right one, as motion and noise are
scaled alike: only the stiffness is off by the factor. But the reflector's own way from
configuration to configuration is known from the joints.
"""

from __future__ import annotations

import numpy as np

from cabols_stiffness.measurements.samples import REFERENCE, PointSamples, Samples
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.verdict import Finding, Suspect

LEAST_GROUPS = 4
LEAST_SPAN = 0.02
"""Root mean square way of the reflector between groups from which on it is judged [m]."""

ALIKE = 0.98
"""Least correlation of measured and computed positions for which their sizes are compared; without
it positions are relative to each configuration's own origin."""

WRONG = 0.1
"""Relative difference of the sizes beyond which the unit is wrong."""


def wrong_span(samples: PointSamples | Samples, robot: RobotModel) -> list[Finding]:
    """One finding if positions are in another unit than stated, else none.

    Args:
        samples: points; poses have no positions.
        robot: with its tool.
    """
    if not isinstance(samples, PointSamples):
        return []
    rows = (samples.branch == REFERENCE) & np.isfinite(samples.position).all(axis=1)
    _, first = np.unique(samples.group[rows], return_index=True)
    chosen = np.flatnonzero(rows)[first]
    if chosen.size < LEAST_GROUPS:
        return []
    posture = robot.posture(samples.joints[chosen])
    there = posture.position + np.einsum("kij,kj->ki", posture.rotation, samples.offset[chosen])
    computed = there - there.mean(axis=0)
    measured = samples.position[chosen] - samples.position[chosen].mean(axis=0)
    size, own = float(np.linalg.norm(computed)), float(np.linalg.norm(measured))
    if not (size > LEAST_SPAN * np.sqrt(chosen.size) and own > 0.0):
        return []
    alike = float(np.sum(computed * measured)) / (size * own)
    ratio = own / size
    if not alike > ALIKE or abs(np.log(ratio)) <= WRONG:
        return []
    text = (
        f"positions of the unloaded robot span {ratio:.4g} times what its joints say: they seem to "
        f"be in units of {1.0 / ratio:.4g} of the stated one, or the robot is another one"
    )
    return [Finding(Suspect.UNIT, text, 1.0, 0.0, float("inf"), True)]
