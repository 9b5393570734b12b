# SPDX-License-Identifier: Apache-2.0
"""Whether a platform may hang on its cables, by a rig's files."""

from __future__ import annotations

import numpy as np

from cabols_control.rig import Rig
from cabols_control.supervision.faults import Fault, FaultName
from cabols_hw.card.config import CardConfig
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.faults import NOT_HELD


def not_held(rig: Rig, safety: SafetyConfig, card: CardConfig) -> Fault | None:
    """Return the notice of a rig whose platform hangs on its cables; None: it may.

    Args:
        rig: geometry, limbs, envelope, what hangs.
        safety: with platform_held, the range of positions, what the site declares.
        card: with the mass that hangs on the sensor.
    """
    if safety.platform_held:
        return None
    if not card.tool_mass > 0.0:
        return Fault(FaultName.NOT_HELD, f"{NOT_HELD}. frames.yaml gives no tool_mass")
    # Heavy; seldom used.
    from cabols_control.workspace.suspension import judge_suspension
    from cabols_hw.safety.hanging_conditions import missing_condition

    missing = missing_condition(rig, safety, card)
    if not missing:
        return None
    away = np.array(safety.position_range)
    found = judge_suspension(rig, card.tool_mass, np.array(card.tool_centre_of_mass), away)
    return Fault(FaultName.NOT_HELD, f"{NOT_HELD}. {missing}. Of its gears: {found.told()}")
