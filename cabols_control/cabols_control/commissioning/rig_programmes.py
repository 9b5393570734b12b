# SPDX-License-Identifier: Apache-2.0
"""Commissioning programmes for a limb of a given rig, within what its parts bear."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray
from cabols_control.commissioning.programmes import (
    CommissioningConfig,
    RampProgramme,
    StepProgramme,
)
from cabols_control.kinematics import structure_matrix

if TYPE_CHECKING:
    from cabols_control.rig import Rig


def make_step(rig: Rig, limb: int, config: CommissioningConfig) -> StepProgramme:
    """Return the step programme for a limb of a rig.

    Args:
        rig: configuration: largest tension, winding speeds.
        limb: index from 0.
        config: how to excite.
    """
    control = rig.control
    return StepProgramme(
        limb, config, control.tension_max, control.pretension_speed, control.free_speed
    )


def make_ramp(
    rig: Rig, limb: int, config: CommissioningConfig, position: ArrayLike, rotation: ArrayLike
) -> RampProgramme:
    """Return the ramp programme for a limb of a rig, no higher than its sensor and cables bear.

    Args:
        rig: configuration.
        limb: index from 0.
        config: how to excite.
        position: (3,) of the platform [m].
        rotation: (3, 3) from platform to base axes.
    """
    column = structure_matrix(rig.geometry, position, rotation)[:, limb]
    requested = min(config.ramp_tension, rig.control.tension_max)
    peak = largest_ramp(column, rig.control.rated, requested)
    return RampProgramme(limb, config, rig.control.tension_max, rig.holding_tension, peak)


def largest_ramp(column: FloatArray, rated: FloatArray, peak: float, margin: float = 0.9) -> float:
    """Highest tension that the force/torque sensor can measure on one cable.

    Args:
        column: (6,) of the structure matrix.
        rated: (6,) range of the sensor [N, N m].
        peak: requested tension of the ramp [N].
        margin: share of the range that may be used.

    Returns:
        peak, or less [N].
    """
    reach = margin * rated / np.maximum(np.abs(column), 1e-9)
    return float(min(peak, reach.min()))
