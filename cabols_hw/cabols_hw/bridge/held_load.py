"""What load the gears hold while the motors are off, in words; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.naming import limb_name, limb_names
from cabols_hw.bridge.bridge import Bridge

HELD_N = 10.0
"""Tension that counts as a load; unloaded limbs are left at a few newtons [N]."""
STEP_N = 5.0
"""What is said is rounded, so that noise changes nothing [N]."""


def held_load(bridge: Bridge) -> str:
    """Tell what the gears hold; empty where the cables are known to be unloaded.

    Args:
        bridge: with its newest sample, at rest.
    """
    pulling = np.flatnonzero(bridge.zeroed & (bridge.tension > HELD_N))
    unknown = np.flatnonzero(~bridge.zeroed & bridge.switch_closed)
    parts = []
    if pulling.size:
        worst = int(pulling[np.argmax(bridge.tension[pulling])])
        parts.append(
            f"{limb_names(pulling)} pull, {limb_name(worst)} most, "
            f"about {_rounded(bridge.tension[worst])} N"
        )
    if unknown.size:
        parts.append(f"{limb_names(unknown)} pull by their switches, how much is not known")
    if not parts:
        return ""
    if bridge.tared:
        parts.append(
            f"the sensor shows about {_rounded(float(np.linalg.norm(bridge.wrench[:3])))} N"
        )
    return f"the gears hold: {'; '.join(parts)}. FREE_MOVING takes it off"


def _rounded(newtons: float) -> int:
    return int(STEP_N * round(float(newtons) / STEP_N))
