# SPDX-License-Identifier: Apache-2.0
"""What a bridge says of a platform that hangs on its cables, by its files."""

from __future__ import annotations

import numpy as np

from cabols_control.rig import Rig
from cabols_control.supervision.faults import Fault, FaultName
from cabols_hw.card.config import CardConfig
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.faults import NOT_HELD


def not_held(rig: Rig, safety: SafetyConfig, card: CardConfig) -> Fault | None:
    """Return the notice of a rig whose platform hangs on its cables; None: something holds it.

    The files may prove that the gears hold it with the amplifiers off. That is one condition of
    several, so that no notice is left out for it (docs/safety.md).

    Args:
        rig: geometry, limbs, envelope.
        safety: with platform_held and the range of positions.
        card: with the mass that hangs on the sensor.
    """
    if safety.platform_held:
        return None
    if not card.tool_mass > 0.0:
        return Fault(FaultName.NOT_HELD, f"{NOT_HELD}. frames.yaml gives no tool_mass")
    from cabols_control.workspace.suspension import judge_suspension  # heavy; seldom used

    away = np.array(safety.position_range)
    found = judge_suspension(rig, card.tool_mass, np.array(card.tool_centre_of_mass), away)
    return Fault(FaultName.NOT_HELD, f"{NOT_HELD}. Of its gears: {found.told()}")
